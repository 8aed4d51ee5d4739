"""The solver's loop: rates, monotonicity, masks, statuses, warm starts, continuation."""

import gc
import weakref

import numpy as np
import pytest
import warp as wp
from ddp_examples import cart_pole, fragile_problem, make_cart_pole, random_linear_problem

import slcp_warp as slcp
from slcp_warp import ddp


def test_second_order_converges_quadratically_and_gauss_newton_linearly(device):
    problem, x0, u0 = cart_pole(device)
    start = ddp.solve(problem, x0, u0, ddp.Options(gradient_tolerance=1e-2))  # into one basin
    full = ddp.solve(problem, x0, start.us, ddp.Options(gradient_tolerance=1e-11))
    gauss = ddp.solve(problem, x0, start.us, ddp.Options(method="gauss-newton", gradient_tolerance=1e-11))
    assert full.converged and gauss.status in (ddp.Status.CONVERGED, ddp.Status.SMALL_IMPROVEMENT)
    np.testing.assert_allclose(full.cost, gauss.cost, rtol=1e-12)
    assert gauss.iterations > 4 * full.iterations
    tail = full.trace.gradient[-4:]
    assert (tail[1:] < 1000.0 * tail[:-1] ** 2).all()  # the error squares, up to a constant of the problem
    assert tail[-1] < 1e-4 * tail[-2]
    ratios = gauss.trace.gradient[-7:-3] / gauss.trace.gradient[-8:-4]
    assert (ratios > 0.3).all()


@pytest.mark.parametrize("method", ["second-order", "gauss-newton", "first-order"])
def test_cost_never_increases(device, method):
    problem, x0, u0 = cart_pole(device)
    result = ddp.solve(problem, x0, u0, ddp.Options(method=method, max_iterations=60))
    assert (np.diff(result.trace.cost) <= 0.0).all()
    assert result.cost == result.trace.cost[-1]
    assert result.cost < 0.5 * result.trace.cost[0] or method != "second-order"
    accepted = result.trace.step_size[:-1] > 0
    assert (result.trace.reduction[:-1][accepted] > 0).all()


def test_float32_reaches_the_same_minimum(device):
    single, double = (
        ddp.solve(*cart_pole(device, dtype), ddp.Options(max_iterations=100))
        for dtype in ("float32", "float64")
    )
    assert single.xs.dtype == np.float32
    assert single.status in (ddp.Status.CONVERGED, ddp.Status.SMALL_IMPROVEMENT)
    np.testing.assert_allclose(single.cost, double.cost, rtol=1e-4)


def test_batch_equals_singles_bit_for_bit(device):
    problem, x0, u0 = cart_pole(device)
    starts = x0 + 0.3 * np.random.default_rng(0).normal(size=(5, 4))
    options = ddp.Options(max_iterations=30)
    batch = ddp.solve(problem, starts, u0, options)
    for i, start in enumerate(starts):
        alone = ddp.solve(problem, start, u0, options)
        for name in (
            "xs",
            "us",
            "K",
            "k",
            "Vx",
            "Vxx",
            "cost",
            "status",
            "iterations",
            "gradient",
            "min_pivot",
        ):
            np.testing.assert_array_equal(getattr(batch, name)[i], getattr(alone, name), err_msg=name)
        np.testing.assert_array_equal(batch.trace.cost[i, : alone.iterations + 1], alone.trace.cost)


def test_a_failed_problem_is_reported_and_does_not_touch_its_neighbours(device):
    problem = fragile_problem(device)
    good, bad = [[1.0, 0.0], [-2.0, 1.0]], [3.9, 5.0]
    result = ddp.solve(problem, [good[0], bad, good[1]], np.zeros((20, 1)))
    assert list(result.status) == [ddp.Status.CONVERGED, ddp.Status.DYNAMICS_FAILED, ddp.Status.CONVERGED]
    assert result.cost[1] == np.inf
    assert np.isfinite(result.xs).all()  # the last valid state is kept
    alone = ddp.solve(problem, good, np.zeros((20, 1)))
    for name in ("xs", "us", "K", "Vx", "cost"):
        np.testing.assert_array_equal(getattr(result, name)[[0, 2]], getattr(alone, name), err_msg=name)


def test_step_sizes_that_break_the_dynamics_are_passed_over(device):
    problem = fragile_problem(device)
    far = ddp.costs.quadratic(
        np.zeros((2, 2)), [[1e-4]], 10.0 * np.eye(2), [30.0, 0.0]
    )  # the goal is out of reach
    result = ddp.solve(ddp.Problem(problem.dynamics, far, 20), [0.0, 0.0], np.zeros((20, 1)))
    assert np.isfinite(result.cost) and result.cost < result.trace.cost[0] + 1e-12
    assert result.trace.step_size[0] < 1.0
    assert abs(result.xs[:, 0]).max() <= 4.0


def make_liar(dtype, VX, VU):
    """An integrator with Jacobians of the wrong sign, and none at all for x[0] > 2."""
    MXX, MXU, MZZ = (wp.types.matrix(shape, dtype) for shape in ((1, 1), (1, 1), (2, 2)))
    one, two = dtype(1.0), dtype(2.0)

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        return VX(x[0] + u[0])

    @wp.func
    def jacobians(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        if x[0] > two:
            return MXX(wp.log(-one)), MXU(one)
        return MXX(one), MXU(-one)

    @wp.func
    def curvature(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, i: int):
        return MZZ()

    return ddp.DynamicsFunctions(step, jacobians, curvature)


def test_wrong_or_missing_derivatives_are_reported(device):
    dynamics = ddp.WarpDynamics(make_liar, 1, 1, device=device)
    problem = ddp.Problem(dynamics, ddp.costs.quadratic([[1.0]], [[0.1]], [[1.0]]), 4)
    result = ddp.solve(problem, [[1.0], [3.0], [0.0]], np.zeros((4, 1)))
    assert list(result.status) == [
        ddp.Status.LINE_SEARCH_FAILED,
        ddp.Status.DYNAMICS_FAILED,
        ddp.Status.CONVERGED,
    ]
    np.testing.assert_array_equal(result.us[:2], 0.0)  # nothing was accepted
    assert not result.K[1].any()
    assert all(ddp.Status(s).explanation for s in result.status)


def test_a_finished_solve_is_left_alone(device):
    problem, x0, u0 = cart_pole(device)
    first = ddp.solve(problem, x0, u0)
    again = ddp.solve(problem, x0, first.us)
    assert again.iterations == 0
    for name in ("xs", "us", "cost"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


def test_feedback_rollout_from_the_same_state_reproduces_the_nominal(device):
    problem, x0, u0 = cart_pole(device)
    solution = ddp.solve(problem, x0, u0)
    replay = ddp.solve(
        problem, x0, solution.us, ddp.Options(max_iterations=0), xs0=solution.xs, K0=solution.K
    )
    for name in ("xs", "us", "cost"):
        np.testing.assert_array_equal(getattr(solution, name), getattr(replay, name))


def test_feedback_in_the_warm_start_beats_open_loop(device):
    problem, x0, u0 = cart_pole(device)
    solution = ddp.solve(problem, x0, u0)
    moved = x0 + [0.02, 0.02, 0.0, 0.02]
    none = ddp.Options(max_iterations=0)
    closed = ddp.solve(problem, moved, solution.us, none, xs0=solution.xs, K0=solution.K)
    opened = ddp.solve(problem, moved, solution.us, none)
    best = ddp.solve(problem, moved, solution.us, xs0=solution.xs, K0=solution.K)
    assert best.cost <= closed.cost < opened.cost
    np.testing.assert_array_equal(ddp.solve(problem, moved, solution, none).us, closed.us)
    with pytest.raises(ValueError, match="u0 is a ddp.Result, .* leave out xs0, K0"):
        ddp.solve(problem, moved, solution, K0=solution.K)
    # the quadratic value predicts the closed loop's cost to third order
    d = moved - x0
    predicted = solution.cost + solution.Vx[0] @ d + 0.5 * d @ solution.Vxx[0] @ d
    assert abs(closed.cost - predicted) < 0.2 * abs(closed.cost - solution.cost)


def test_gains_of_what_has_converged_are_not_regularised(device):
    """Solving again from a solution ends with its first pass, whatever that is regularised by."""
    problem, x0, u0 = cart_pole(device)
    solution = ddp.solve(problem, x0, u0)
    assert solution.status == ddp.Status.CONVERGED
    for initial in (1e-3, 1.0, 100.0):
        options = ddp.Options(regularization=ddp.Regularization(initial=initial))
        again = ddp.solve(problem, x0, solution, options)
        assert again.status == ddp.Status.CONVERGED and (again.us == solution.us).all()
        np.testing.assert_allclose(again.K, solution.K, rtol=1e-6, atol=1e-6 * np.abs(solution.K).max())
        np.testing.assert_allclose(again.Vxx, solution.Vxx, rtol=1e-6, atol=1e-6 * np.abs(solution.Vxx).max())


def make_wavy_cost(dtype, VX, VU):
    """Of a second control that moves nothing, with a maximum at 0."""

    @wp.func
    def running(x: VX, u: VU, k: int):
        return dtype(0.5) * (x[0] * x[0] + u[0] * u[0]) + wp.cos(dtype(3.0) * (u[1] - dtype(0.1)))

    @wp.func
    def final(x: VX):
        return dtype(5.0) * x[0] * x[0]

    return running, final


def test_a_control_that_moves_nothing_is_regularised_by_itself(device):
    """mu f_u' f_u bends no such direction: with the default alone passes end at its limit, without a gain."""
    dynamics = ddp.linear_system(np.eye(1), np.array([[0.1, 1e-9]]), device=device)
    problem = ddp.Problem(dynamics, ddp.costs.plain(make_wavy_cost), 20)
    x0, u0 = np.ones(1), np.zeros((20, 2))
    solution = ddp.solve(problem, x0, u0)
    assert solution.status in (ddp.Status.CONVERGED, ddp.Status.SMALL_IMPROVEMENT)
    np.testing.assert_allclose(np.cos(3.0 * (solution.us[:, 1] - 0.1)), -1.0, atol=1e-10)
    both = ddp.solve(problem, np.array([[1.0], [0.5]]), np.zeros((2, 20, 2)))
    np.testing.assert_allclose(both.us[0], solution.us, atol=1e-12)
    said = ddp.Regularization(initial=1e-2)
    assert (
        ddp.solve(problem, x0, u0, ddp.Options(regularization=said)).status == ddp.Status.REGULARIZATION_LIMIT
    )


def test_returned_policy_belongs_to_the_returned_trajectory_at_the_iteration_limit(device):
    problem, x0, u0 = cart_pole(device)
    stopped = ddp.solve(problem, x0, u0, ddp.Options(max_iterations=3))
    assert stopped.status == ddp.Status.MAX_ITERATIONS
    assert stopped.iterations == 3
    schedule = ddp.Regularization(initial=stopped.trace.regularization[-1])
    fresh = ddp.solve(problem, x0, stopped.us, ddp.Options(max_iterations=0, regularization=schedule))
    np.testing.assert_array_equal(stopped.K, fresh.K)
    np.testing.assert_array_equal(stopped.Vx, fresh.Vx)


def test_per_problem_parameters_weights_limits_and_schedules(device):
    problem, x0, u0 = cart_pole(device)
    steps, bounds, initial = (
        np.array([0.04, 0.05, 0.05]),
        np.array([[5.0], [8.0], [np.inf]]),
        np.array([0.0, 1e-3, 1.0]),
    )
    weights = problem.cost.weights * np.array([[1.0], [1.0], [2.0]])
    options = ddp.Options(max_iterations=15, regularization=ddp.Regularization(initial=initial))
    both = ddp.Problem(
        problem.dynamics,
        problem.cost.with_weights(weights),
        problem.horizon,
        problem.params.replace(step_size=steps),
        (-bounds, bounds),
    )
    batch = ddp.solve(both, np.tile(x0, (3, 1)), u0, options)
    for i in range(3):
        one = ddp.Problem(
            problem.dynamics,
            problem.cost.with_weights(weights[i]),
            problem.horizon,
            problem.params.replace(step_size=steps[i]),
            (-bounds[i], bounds[i]),
        )
        alone = ddp.solve(
            one, x0, u0, ddp.Options(max_iterations=15, regularization=ddp.Regularization(initial[i]))
        )
        np.testing.assert_array_equal(batch.us[i], alone.us)
        assert abs(alone.us).max() <= bounds[i]


def test_workspace_goes_with_its_last_reference(device):
    """A receding horizon up to the end of a run makes one a cycle: gigabytes until a collection comes."""
    problem, data = random_linear_problem(3, batch=3, device=device)
    workspace = ddp.Workspace(problem, 3)
    workspace.solve(data["x0"], np.zeros((3, 15, 2)))
    gone = weakref.ref(workspace)
    gc.disable()
    try:
        del workspace
        assert gone() is None
    finally:
        gc.enable()


def test_workspace_is_reusable_and_takes_device_arrays(device):
    problem, data = random_linear_problem(3, batch=3, device=device)
    workspace = ddp.Workspace(problem, 3)
    starts = np.zeros((3, 15, 2))
    first = workspace.solve(data["x0"], starts)
    other = workspace.solve(-data["x0"], starts)
    assert abs(first.us - other.us).max() > 0.1
    x0 = wp.array(data["x0"], dtype=wp.float64, device=device)
    again = workspace.solve(x0, wp.array(starts, dtype=wp.float64, device=device))
    for name in ("xs", "us", "K", "cost", "status", "iterations"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    np.testing.assert_array_equal(workspace.us.numpy(), again.us)
    brief = workspace.solve(data["x0"], starts, max_iterations=0)
    assert (brief.status == ddp.Status.MAX_ITERATIONS).all() and not brief.us.any()


def test_continuation_follows_a_parameter(device):
    problem, x0, u0 = cart_pole(device)
    levels = [0.04, 0.045, 0.05]
    path = ddp.solve_continuation(problem, x0, u0, levels, parameter="step_size")
    assert [r.status for r in path] == [ddp.Status.CONVERGED] * 3
    direct = ddp.solve(problem.with_params(step_size=0.045), x0, path[1].us)
    np.testing.assert_allclose(path[1].cost, direct.cost, rtol=1e-10)
    cold = ddp.solve(problem.with_params(step_size=0.05), x0, u0)
    assert path[2].iterations < cold.iterations


def test_multistart_keeps_the_best(device):
    problem, x0, u0 = cart_pole(device)
    schedules = ddp.Regularization(
        initial=[0.0, 1e-2, 10.0], state_weight=[1.0, 0.0, 1.0], control_weight=[0.0, 1.0, 0.0]
    )
    starts = np.stack([u0, -u0, np.zeros_like(u0)])
    found = ddp.solve_multistart(problem, x0, starts, ddp.Options(max_iterations=60), schedules)
    assert found.all.cost.shape == (9,)
    assert found.best.cost == found.all.cost[found.all.converged].min()
    start, schedule = divmod(found.index, 3)
    one = ddp.Regularization(
        **{n: getattr(schedules, n)[schedule] for n in ("initial", "state_weight", "control_weight")}
    )
    alone = ddp.solve(problem, x0, starts[start], ddp.Options(max_iterations=60, regularization=one))
    np.testing.assert_array_equal(alone.us, found.best.us)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"method": "newton"}, "method must be one of second-order"),
        ({"max_iterations": -1}, "max_iterations is -1"),
        ({"step_sizes": ()}, "step_sizes must be"),
        ({"step_sizes": (1.0, 2.0)}, "step_sizes must be"),
        ({"gradient_tolerance": float("nan")}, "gradient_tolerance must be"),
        ({"sigma_schedule": (0.1, 0.2)}, "sigma_schedule must decrease"),
    ],
)
def test_illegal_options(changes, message):
    with pytest.raises(ValueError, match=message):
        ddp.Options(**changes)


def test_illegal_schedules():
    with pytest.raises(ValueError, match="factor must be a finite number above 1"):
        ddp.Options(regularization=ddp.Regularization(factor=1.0))
    with pytest.raises(ValueError, match=r"different numbers of problems: \[2, 3\]"):
        ddp.Options(regularization=ddp.Regularization(initial=[0.0, 1.0], factor=[2.0, 3.0, 4.0]))
    with pytest.raises(ValueError, match="positive state_weight or control_weight"):
        ddp.Options(regularization=ddp.Regularization(state_weight=0.0))


def test_illegal_arguments():
    problem, x0, u0 = cart_pole()
    with pytest.raises(ValueError, match=r"x0 must have shape \(1, 4\) or \(4,\), got \(3,\)"):
        ddp.solve(problem, x0[:3], u0)
    with pytest.raises(ValueError, match=r"u0 must have shape \(1, 40, 1\)"):
        ddp.solve(problem, x0, u0[:-1])
    with pytest.raises(ValueError, match="x0 must be finite; 1 of its values"):
        ddp.solve(problem, [0.0, np.nan, 0.0, 0.0], u0)
    with pytest.raises(ValueError, match="K0 is given without xs0"):
        ddp.solve(problem, x0, u0, K0=np.zeros((1, 40, 1, 4)))
    with pytest.raises(ValueError, match="params are for 2 problems, the batch has 3"):
        ddp.solve(problem.with_params(step_size=[0.1, 0.2]), np.tile(x0, (3, 1)), u0)


def test_illegal_problems():
    problem, _, _ = cart_pole()
    dynamics, cost = problem.dynamics, problem.cost
    with pytest.raises(ValueError, match="horizon is 0; a whole number of at least 1"):
        ddp.Problem(dynamics, cost, 0)
    with pytest.raises(TypeError, match="cost must be a ddp.Cost, got str"):
        ddp.Problem(dynamics, "quadratic", 5)
    with pytest.raises(TypeError, match="dynamics must have 'nx'"):
        ddp.Problem(object(), cost, 5)
    with pytest.raises(ValueError, match="cost is for nx = 6, the dynamics has nx = 4"):
        ddp.Problem(dynamics, slcp.tasks.flicking_finger().cost, 5)
    with pytest.raises(ValueError, match="control_limits: a lower limit is above the upper one"):
        ddp.Problem(dynamics, cost, 5, control_limits=(1.0, -1.0))
    with pytest.raises(ValueError, match="control_limits: upper limit is nan; NaN is no limit"):
        ddp.Problem(dynamics, cost, 5, control_limits=(-1.0, float("nan")))
    moving = ddp.costs.quadratic(np.eye(4), np.eye(1), target=np.zeros((6, 4)))
    assert ddp.Problem(dynamics, moving, 5).cost is moving
    for horizon in (4, 6, 20):  # neither cut off nor held at its last row
        with pytest.raises(ValueError, match=f"cost is for 6 nodes, horizon {horizon} has {horizon + 1}"):
            ddp.Problem(dynamics, moving.with_weights(2.0 * moving.weights), horizon)
    with pytest.raises(ValueError, match=r"unknown parameter 'sigma'; known: \['step_size'\]"):
        problem.with_params(sigma=0.1)
    with pytest.raises(ValueError, match="dtype must be float32 or float64, got 'float16'"):
        ddp.WarpDynamics(make_cart_pole, 4, 1, dtype="float16")
