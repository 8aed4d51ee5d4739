"""Limits on states: an augmented Lagrangian to a tolerance, or soft; against quadratic programmes."""

import numpy as np
import pytest
import scipy.optimize
from ddp_examples import cart_pole, condense, random_linear_problem

import slcp_warp as slcp
from slcp_warp import ddp


def double_integrator(limits, horizon=30, batch=None):
    """A cart of 1 kg brought from -1 m to rest at 0 with a limit on its speed."""
    h = 0.1
    dynamics = ddp.linear_system([[1.0, h], [0.0, 1.0]], [[0.5 * h * h], [h]], device="cpu")
    cost = ddp.costs.quadratic(np.zeros((2, 2)), [[0.01]], np.diag([100.0, 10.0]))
    problem = ddp.Problem(dynamics, cost, horizon, state_limits=limits)
    return problem, np.array([-1.0, 0.0])


def quadratic_programme(problem, data, lower, upper):
    """Controls and cost of `random_linear_problem` with limits on its states: SciPy on the dense form."""
    N, (nx, nu) = problem.horizon, data["B"].shape
    H, g, constant = condense(data, N)
    S = np.zeros((N, nx, N * nu))
    offset, x = np.zeros((N, nx)), data["x0"]
    for k in range(N):
        x = data["A"] @ x + data["c"]
        offset[k] = x
        S[k] = data["A"] @ S[k - 1] if k else 0.0
        S[k][:, k * nu : (k + 1) * nu] += data["B"]
    rows, free = S.reshape(N * nx, -1), offset.ravel()
    ends = [(sign * row, sign * (bound - f)) for row, f, low, high in
            zip(rows, free, np.tile(lower, N), np.tile(upper, N), strict=True)
            for sign, bound in ((1.0, low), (-1.0, high)) if np.isfinite(bound)]  # fmt: skip
    G, r = (np.array(part) for part in zip(*ends, strict=True))
    found = scipy.optimize.minimize(
        lambda u: 0.5 * u @ H @ u + g @ u + constant, np.zeros(N * nu),
        jac=lambda u: H @ u + g, method="SLSQP",
        constraints=[{"type": "ineq", "fun": lambda u: G @ u - r, "jac": lambda u: G}],
        options={"ftol": 1e-12, "maxiter": 500})  # fmt: skip
    assert (G @ found.x >= r - 1e-7).all()
    return found.x.reshape(N, nu), float(found.fun)


def test_a_quadratic_programme_is_solved():
    """Cost, controls and active limits are those of SciPy's solution of the dense problem."""
    free, data = random_linear_problem(1)
    start = np.zeros((15, 2))
    loose = ddp.solve(free, data["x0"], start)
    upper = np.full(4, np.inf)
    upper[0] = np.quantile(loose.xs[1:, 0], 0.6)
    lower = np.full(4, -np.inf)
    lower[1] = np.quantile(loose.xs[1:, 1], 0.3)
    problem = ddp.Problem(free.dynamics, free.cost, 15, state_limits=(lower, upper))
    found = ddp.solve(problem, data["x0"], start, ddp.Options(limit_tolerance=1e-6, limit_rounds=40))
    us, cost = quadratic_programme(problem, data, lower, upper)
    assert found.converged and cost > loose.cost + 1e-3
    assert found.cost == pytest.approx(cost, rel=1e-5)
    np.testing.assert_allclose(found.us, us, atol=1e-3)
    assert (found.xs[1:, 0] <= upper[0] + 1e-5).all() and (found.xs[1:, 1] >= lower[1] - 1e-5).all()


def test_limits_hold_and_soft_ones_do_not():
    problem, x0 = double_integrator(([-np.inf, -np.inf], [np.inf, 0.4]))
    start = np.zeros((30, 1))
    held = ddp.solve(problem, x0, start)
    assert held.converged and held.xs[:, 1].max() <= 0.4 + 1e-3
    assert (held.xs[:, 1] > 0.4 - 1e-2).sum() > 10
    soft = ddp.solve(problem, x0, start, ddp.Options(limit_rounds=0, limit_weight=1.0))
    free = ddp.solve(double_integrator(None)[0], x0, start)
    assert soft.converged and 0.41 < soft.xs[:, 1].max() < free.xs[:, 1].max()
    assert free.cost < soft.cost < held.cost
    again = ddp.solve(double_integrator(None)[0], x0, held.us, ddp.Options(max_iterations=0))
    assert held.cost == pytest.approx(float(again.cost), rel=1e-9)  # penalties are no part of it


def test_limits_that_cannot_hold_are_said():
    """The cart would have to be still and yet come half a metre far."""
    held, x0 = double_integrator(([-0.6, -np.inf], [np.inf, np.inf]), horizon=3)
    problem = ddp.Problem(
        held.dynamics, held.cost, 3, control_limits=(-1.0, 1.0), state_limits=held.state_limits
    )
    found = ddp.solve(problem, x0, np.zeros((3, 1)))
    assert found.status == ddp.Status.STATE_LIMITS and not found.converged


def test_the_cost_of_a_plan_beyond_its_limits_is_its_own():
    """Penalties of 1e9 are a million times the cost, and single precision has no digits left beside them."""
    held, x0 = double_integrator(([-0.6, -np.inf], [np.inf, np.inf]), horizon=3)
    dynamics = ddp.linear_system([[1.0, 0.1], [0.0, 1.0]], [[0.005], [0.1]], device="cpu", dtype="float32")
    problem = ddp.Problem(dynamics, held.cost, 3, control_limits=(-1.0, 1.0), state_limits=held.state_limits)
    found = ddp.solve(problem, x0, np.zeros((3, 1)))
    assert found.status == ddp.Status.STATE_LIMITS
    u, (x, v) = found.us.astype(float), found.xs[-1].astype(float)
    assert found.cost == pytest.approx(
        0.5 * (0.01 * (u @ u.T).trace() + 100.0 * x**2 + 10.0 * v**2), rel=1e-6
    )


def test_every_problem_has_limits_of_its_own():
    upper = np.array([[np.inf, 0.3], [np.inf, 0.4], [np.inf, np.inf]])
    problem, x0 = double_integrator((np.full((3, 2), -np.inf), upper))
    found = ddp.solve(problem, np.tile(x0, (3, 1)), np.zeros((3, 30, 1)))
    assert found.converged.all()
    assert found.xs[:, :, 1].max(1)[:2] == pytest.approx([0.3, 0.4], abs=2e-3)
    alone = ddp.solve(double_integrator((-np.inf, upper[1]))[0], x0, np.zeros((30, 1)))
    assert found.cost[1] == pytest.approx(float(alone.cost), rel=1e-9)


def test_the_plan_and_its_feedback_keep_the_limits():
    """A pole swung up between walls that only the limits know of; then played with its own feedback."""
    free, x0, u0 = cart_pole("cpu", limits=(-15.0, 15.0))
    loose = ddp.solve(free, x0, u0, ddp.Options(max_iterations=400))
    reach = 0.7 * np.abs(loose.xs[:, 0]).max()
    limits = (np.array([-reach, -np.inf, -np.inf, -np.inf]), np.array([reach, np.inf, np.inf, np.inf]))
    problem = ddp.Problem(free.dynamics, free.cost, 40, control_limits=(-15.0, 15.0), state_limits=limits)
    plan = ddp.solve(problem, x0, u0, ddp.Options(max_iterations=600))
    assert plan.status != ddp.Status.STATE_LIMITS
    assert np.abs(plan.xs[1:, 0]).max() <= reach + 1e-3 * max(1.0, reach)
    assert np.abs(plan.us).max() <= 15.0 and plan.cost > loose.cost
    pushed = np.clip(x0 + np.array([0.0, 0.0, 0.02, 0.02]), -np.inf, np.inf)
    closed = ddp.solve(free, pushed, plan.us, ddp.Options(max_iterations=0), xs0=plan.xs, K0=plan.K)
    assert np.abs(closed.us).max() <= 15.0
    assert np.abs(closed.xs[1:, 0]).max() <= 1.1 * reach


def test_sampling_pays_for_limits():
    problem, x0 = double_integrator(([-np.inf, -np.inf], [np.inf, 0.4]))
    free = double_integrator(None)[0]
    found, loose = (ddp.sample(p, x0, options=ddp.Sampling(scale=1.0)) for p in (problem, free))
    assert found.xs[:, 1].max() < loose.xs[:, 1].max()


@pytest.mark.parametrize(
    "limits, text",
    [
        ((1.0, -1.0), "state_limits: a lower limit is above"),
        ((0.0, np.nan), "state_limits: upper limit is nan"),
        (([0.0] * 3, 1.0), r"state_limits: lower limit must be a number, \(2,\)"),
        (3.0, "state_limits must be"),
        (((np.zeros((2, 2))), 1.0), "state_limits are for 2 problems, the batch has 1"),
    ],
)
def test_limits_that_are_none(limits, text):
    with pytest.raises(slcp.InputError, match=text):
        problem, x0 = double_integrator(limits)
        ddp.solve(problem, x0, np.zeros((30, 1)))


@pytest.mark.parametrize(
    "given", [{"limit_weight": 0.0}, {"limit_factor": 1.0}, {"limit_rounds": -1}, {"limit_tolerance": 0.0}]
)
def test_options_of_limits(given):
    with pytest.raises(slcp.InputError, match=next(iter(given))):
        ddp.Options(**given)
