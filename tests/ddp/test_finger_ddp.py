"""DDP on the paper's problem (section V): stationarity, quadratic tail, starts, less noise, no gravity."""

import functools

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp import ddp

pytestmark = pytest.mark.slow

N, H, SIGMA = 75, 0.05, 0.1
X0 = scene("flicking_finger").x0
ZERO = np.zeros((N, 2))
SIGMAS = (0.1, 0.07, 0.05, 0.035, 0.02, 0.01)
WEIGHTS = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}  # sixth-order central difference (Richardson, twice)


@functools.cache
def problem(device, limits=None):
    sim = simulator("flicking_finger", device, wp.float64, "none")
    params = sim.params.replace(step_size=H, sigma=SIGMA)
    return ddp.Problem(sim, slcp.tasks.flicking_finger().cost, N, params, control_limits=limits)


@functools.cache
def canonical(device):
    """From u = 0, default schedule."""
    return ddp.solve(problem(device), X0, ZERO)


def smooth_noise(count, seed=0, time=8.0):
    """Controls (count, N, 2) of unit variance, correlated over `time` steps."""
    white = np.random.default_rng(seed).standard_normal((count, N, 2))
    keep, out = np.exp(-1.0 / time), np.empty_like(white)
    value = white[:, 0]
    for k in range(N):
        value = keep * value + np.sqrt(1.0 - keep**2) * white[:, k]
        out[:, k] = value
    return out


def cost_of(states, controls):
    """Section V's cost, written down again: (B, N+1, 6), (B, N, 2) -> (B,)."""
    return (-states[:, :-1, 2]).sum(axis=1) + 0.05 * (controls**2).sum(axis=(1, 2))


def test_canonical_start_converges_to_a_minimum(device):
    result = canonical(device)
    assert result.converged and result.gradient <= 1e-6
    assert result.positive_definite and result.min_pivot > 0.0
    assert result.cost <= -52.9
    traj = problem(device).dynamics.rollout(X0[None], result.us[None], problem(device).params)
    assert traj.status[0] == 0
    np.testing.assert_allclose(traj.states[0], result.xs, atol=1e-8)
    np.testing.assert_allclose(cost_of(result.xs[None], result.us[None])[0], result.cost, rtol=1e-12)


def test_the_minimum_is_one(device):
    """No controls nearby do better: the cost along random directions has slope 0 and curves upwards."""
    result, sim = canonical(device), problem(device).dynamics
    directions = smooth_noise(20, seed=3)
    costs = []
    for size in (-0.002, 0.002):
        us = result.us + size * directions
        costs.append(cost_of(sim.rollout(np.tile(X0, (20, 1)), us, problem(device).params).states, us))
    assert (np.array(costs) > result.cost).all()
    assert np.abs((costs[1] - costs[0]) / (costs[1] + costs[0] - 2.0 * result.cost)).max() < 0.2


def test_cost_never_rises_and_the_tail_is_superlinear(device):
    trace, passes = canonical(device).trace, int(canonical(device).iterations)
    assert (np.diff(trace.cost[: passes + 1]) <= 0.0).all()
    reductions = trace.reduction[np.isfinite(trace.reduction) & (trace.reduction > 0.0)]
    ratios = reductions[-2:] / reductions[-3:-1]
    assert ratios.max() < 0.1, reductions[-5:]
    gradients = trace.gradient[np.isfinite(trace.gradient)]
    assert gradients[-1] < 0.05 * gradients[-2] < 0.05 * 0.2 * gradients[-3], gradients[-5:]
    assert trace.step_size[passes - 1] == 1.0 and trace.regularization[passes] < 1e-3


def test_near_the_minimum_the_gradient_is_squared(device):
    """From any side; how the last of a hundred passes from far away come near it hangs on rounding."""
    minimum = canonical(device).us
    starts = minimum + 0.002 * smooth_noise(4)
    plain = ddp.Options(max_iterations=10, regularization=ddp.Regularization(1e-9))
    result = ddp.solve(problem(device), np.tile(X0, (4, 1)), starts, plain)
    gradient = result.trace.gradient
    first, then = gradient[:, 1], gradient[:, 2]
    assert (first > 1e-5).all() and (then < np.minimum(1000.0 * first**2, 0.05 * first)).all(), gradient
    np.testing.assert_allclose(result.cost, canonical(device).cost, rtol=0, atol=1e-9)


@pytest.mark.parametrize("feedback", [False, True], ids=["open-loop", "policy"])
def test_value_gradient_is_the_slope_of_the_cost(device, feedback):
    """Envelope theorem: dJ/dx0 at a minimum, controls held or corrected by the policy."""
    result, p = canonical(device), problem(device)
    step, moves = 1e-4, [(j, k) for j in range(6) for k in (-3, -2, -1, 1, 2, 3)]
    x0 = np.array([X0 + k * step * np.eye(6)[j] for j, k in moves])
    if feedback:
        traj = p.dynamics.rollout(x0, policy=ddp.TrackingPolicy(result), steps=N, params=p.params,
                                  record=("controls",))  # fmt: skip
        costs = cost_of(traj.states, traj.controls)
    else:
        us = np.tile(result.us, (len(moves), 1, 1))
        costs = cost_of(p.dynamics.rollout(x0, us, p.params).states, us)
    slope = np.zeros(6)
    for (j, k), cost in zip(moves, costs, strict=True):
        slope[j] += np.sign(k) * WEIGHTS[abs(k)] * (cost - result.cost) / step
    np.testing.assert_allclose(result.Vx[0], slope, atol=1e-5 * np.abs(slope).max())


def test_many_starts_and_schedules(device):
    starts = np.concatenate([ZERO[None], smooth_noise(7)])
    found = ddp.solve_multistart(problem(device), X0, starts, ddp.Options(max_iterations=300))
    assert found.best.converged and found.best.positive_definite
    assert found.best.cost <= -68.0
    assert found.all.converged.mean() > 0.9
    assert len(np.unique(found.all.cost.round(3))) > 5  # many minima: a cost by itself proves little
    assert found.best.cost <= found.all.cost[: len(found.all.cost) // 8].min()


def test_less_noise_by_continuation_where_the_direct_way_stalls(device):
    levels = ddp.solve_continuation(problem(device), X0, canonical(device).us, SIGMAS)
    costs = np.array([level.cost for level in levels])
    assert all(level.converged and level.positive_definite for level in levels)
    assert (np.diff(costs) < -0.1).all(), costs
    assert max(int(level.iterations) for level in levels[1:]) <= 30
    for sigma, reached in ((0.02, costs[4]), (0.01, costs[5])):
        direct = ddp.solve(problem(device).with_params(sigma=sigma), X0, ZERO)
        assert direct.cost > reached + 15.0, "u = 0 hardly moves the ellipse"
        assert direct.cost > -33.0


def test_continuation_is_an_option_of_the_solver(device):
    options = ddp.Options(sigma_schedule=SIGMAS)
    last = ddp.solve(problem(device), X0, canonical(device).us, options)
    levels = ddp.solve_continuation(problem(device), X0, canonical(device).us, SIGMAS)
    assert last.cost == levels[-1].cost


def test_second_order_against_gauss_newton_in_one_basin(device):
    start = canonical(device).us + 0.02 * smooth_noise(1, seed=9)[0]
    full = ddp.solve(problem(device), X0, start)
    crawling = ddp.solve(problem(device), X0, start, ddp.Options(method="gauss-newton", max_iterations=60))
    np.testing.assert_allclose(full.cost, canonical(device).cost, atol=1e-8)  # the same minimum
    assert full.converged and full.iterations <= 8
    assert crawling.cost > full.cost and np.abs(crawling.us - full.us).max() < 0.5  # in its basin
    assert not crawling.converged and crawling.gradient > 1e3 * full.gradient
    assert crawling.trace.cost[int(full.iterations)] > full.cost + 1e-6


def test_control_limits(device):
    bound = 1.5
    result = ddp.solve(problem(device, (-bound, bound)), X0, ZERO, ddp.Options(max_iterations=100))
    assert np.abs(result.us).max() <= bound
    assert (np.abs(result.us) == bound).mean() > 0.02, "the limits bind"
    assert canonical(device).cost < result.cost < -32.0
    clamped = result.us[:, :, None] == np.array([-bound, bound])
    assert (np.diff(result.trace.cost[: int(result.iterations) + 1]) <= 0.0).all()
    assert not result.K[clamped.any(axis=2)].any()  # no feedback on a control at its limit


def test_without_gravity_zero_controls_never_touch(device):
    """Section VI: no gradient tells of the ellipse. Noise or much smoothing finds the contact."""
    p = problem(device).with_params(gravity=(0.0, 0.0))
    resting = ddp.solve(p, X0, ZERO)
    assert resting.status == ddp.Status.FLAT and not resting.converged and resting.iterations == 0
    np.testing.assert_allclose(resting.cost, -N * X0[2], rtol=1e-9)  # -30: the ellipse stays where it is

    starts = smooth_noise(7, seed=0)
    noisy = ddp.solve_multistart(p, X0, starts)
    assert noisy.best.converged and noisy.best.cost < -35.0
    assert (noisy.all.cost > -30.5).mean() > 0.3, "most starts of this size fall back to rest"

    scaffold = ddp.solve_continuation(p, X0, ZERO, (3.0, 1.0, 0.3, 0.1))
    assert scaffold[-1].converged and scaffold[-1].cost < -40.0
    low = ddp.solve_continuation(p, X0, ZERO, (0.5, 0.2, 0.1))
    assert low[-1].cost > -30.01, "a scaffold must reach the ellipse"
    p01 = p.params.replace(sigma=0.1)
    impulse = p.dynamics.rollout(X0[None], scaffold[-1].us[None], p01, record=("impulse",)).impulse
    assert impulse[..., 4:].max() > 0.1


@pytest.mark.full
def test_trapezoidal_steps_converge_from_zero_controls(device):
    """Full second order through the differences: a quadratic tail ends in a stationary trajectory."""
    sim = slcp.Simulator(
        scene("flicking_finger"), slcp.Options(scaling="none", integrator="trapezoidal"), device=device
    )
    problem = ddp.Problem(sim, slcp.tasks.flicking_finger().cost, horizon=75)
    result = ddp.solve(problem, sim.scene.x0, np.zeros((75, 2)), ddp.Options(max_iterations=200))
    assert result.status == ddp.Status.CONVERGED
    assert result.cost < -30.0
