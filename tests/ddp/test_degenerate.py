"""Values exactly at limits, far from zero, or other ones for every problem: against what is known."""

import dataclasses

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest

ONE = np.ones((1, 1))


def line(cost, horizon, limits=None, **more):
    """x' = x + u."""
    return ddp.Problem(ddp.linear_system(ONE, ONE), cost, horizon, control_limits=limits, **more)


def test_shooting_starts_within_control_limits():
    problem = line(ddp.costs.quadratic([[0.0]], [[1e-3]], ONE, target=[100.0]), 3, (-1.0, 1.0))
    found = ddp.solve(problem, [0.0], np.full((3, 1), 5.0), xs0=[[0.0], [5.0], [10.0], [15.0]])
    assert found.status == ddp.Status.CONVERGED
    np.testing.assert_array_equal(found.us, 1.0)


def make_periodic(dtype, VX, VU):
    @wp.func
    def running(x: VX, u: VU, k: int):
        return dtype(0.05) * u[0] * u[0]

    @wp.func
    def final(x: VX):
        return dtype(2.0) - wp.cos(x[0]) + dtype(0.4) * wp.sin(dtype(2.0) * x[0])

    return running, final


def test_a_cost_of_an_angle_does_not_depend_on_whole_turns():
    problem = line(ddp.costs.plain(make_periodic), 2)
    starts = 2.0 * np.pi * np.array([[0.0], [10.0], [300.0], [1000.0]]) + 0.3
    found = ddp.solve(problem, starts, np.zeros((2, 1)))
    np.testing.assert_allclose(found.cost, found.cost[0], rtol=1e-9)
    np.testing.assert_allclose(found.us, found.us[:1].repeat(4, 0), atol=1e-5)


def make_uneven(dtype, VX, VU):
    """Two steps of 1e9, which rest at their minimum, and others of 1, which do not."""
    heavy, far = dtype(1e9), dtype(0.3)

    @wp.func
    def running(x: VX, u: VU, k: int):
        e, one = u[0] - far, dtype(1.0)
        if k == 0:
            return heavy * (u[0] - one) * (u[0] - one)
        if k == 1:
            return heavy * (x[0] + one) * (x[0] + one) + e * e
        return e * e

    @wp.func
    def final(x: VX):
        return dtype(0.0)

    return running, final


def test_a_heavy_step_does_not_hide_what_the_others_have_to_gain():
    found = ddp.solve(line(ddp.costs.plain(make_uneven), 6), [0.0], np.zeros((6, 1)))
    assert found.status == ddp.Status.CONVERGED
    np.testing.assert_allclose(found.us[1:], 0.3, atol=5e-3)  # 64 epsilons of 2e9 are left to gain at most


def make_rim(dtype, VX, VU):
    """Its minimum is at a limit, where a control's cost bends down."""
    tenth = dtype(0.1)

    @wp.func
    def running(x: VX, u: VU, k: int):
        return dtype(10.0) - u[0] * u[0] + tenth * x[0] * x[0]

    @wp.func
    def final(x: VX):
        return tenth * x[0] * x[0]

    return running, final


def test_a_held_control_whose_cost_bends_down_is_no_flat_one():
    found = ddp.solve(line(ddp.costs.plain(make_rim), 3, (-1.0, 1.0)), [0.2], np.ones((3, 1)))
    assert found.status == ddp.Status.CONVERGED
    np.testing.assert_array_equal(np.abs(found.us), 1.0)


def make_slope(dtype, VX, VU):
    @wp.func
    def running(x: VX, u: VU, k: int):
        return dtype(0.0)

    @wp.func
    def final(x: VX):
        return x[0]

    return running, final


@pytest.mark.parametrize(
    "limit, start", [(1.0, 0.003), (0.7, 0.442), (0.7, 0.5), (1e-3, 0.959), (1.0, 0.0), (1.0, -0.7)]
)
def test_controls_arrive_at_their_limits(limit, start):
    """start + (limit - start) misses it by rounding in the first four: the optimum, and held by nothing."""
    problem = line(ddp.costs.plain(make_slope), 3, (-limit, limit))
    found = ddp.solve(problem, [0.0], np.full((3, 1), start * limit))
    np.testing.assert_array_equal(found.us, -limit)
    assert found.status == ddp.Status.CONVERGED and found.gradient == 0.0


def test_every_level_of_a_continuation_states_its_own_noise():
    task = slcp.tasks.flicking_finger()
    problem = dataclasses.replace(ddp.problem_of(task), horizon=4)
    levels = ddp.solve_continuation(problem, task.start[0], None, [0.3, 0.05], ddp.Options(max_iterations=1))
    stated = [np.unique(each.simulated.parameters["sigma"]) for each in levels]
    np.testing.assert_array_equal(stated, [[0.3], [0.05]])


@pytest.mark.parametrize(
    "use", [ddp.Workspace, lambda p, n, o: ddp.solve_multistart(p, [0.0], np.zeros((n, 2, 1)), o)]
)
def test_a_schedule_of_noise_is_refused_where_nobody_follows_it(use):
    problem = line(ddp.costs.quadratic(ONE, ONE, ONE), 2)
    with pytest.raises(slcp.InputError, match="sigma_schedule is .*; it is for ddp.solve"):
        use(problem, 2, ddp.Options(sigma_schedule=(0.3, 0.1)))


def test_samples_of_a_problem_are_drawn_by_its_own_limits():
    def problem(low, high):
        cost = ddp.costs.quadratic(ONE, [[0.01]], [[10.0]], target=[3.0])
        return line(cost, 10, (low, high))

    low, high = np.array([[0.0], [-1.0], [-0.1]]), np.array([[0.0], [1.0], [0.1]])
    batch = ddp.sample(problem(low, high), np.zeros((3, 1)))
    for b in range(3):
        alone = ddp.sample(problem(float(low[b, 0]), float(high[b, 0])), np.zeros(1))
        np.testing.assert_array_equal(batch.us[b], alone.us)
        assert batch.cost[b] == alone.cost


def make_pendulum(dtype, VX, VU):
    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        h = dtype(0.1)
        v = x[1] + h * (u[0] - params[row, 0] * wp.sin(x[0]))
        return VX(x[0] + h * v, v)

    return step


def test_neighbours_change_nothing_where_states_are_limited():
    """Neither the passes of a problem that takes many rounds, nor those that it has left to make."""
    dynamics = ddp.WarpDynamics(make_pendulum, 2, 1, {"g": 1.0})
    cost = ddp.costs.quadratic(np.diag([1, 0.1]), [[0.01]], np.diag([100, 10.0]), target=[np.pi, 0])
    options, x0 = ddp.Options(max_iterations=15), np.array([[0.0, 0.0], [0.5, 0.0], [-0.4, 0.3]])
    gravity = np.array([[1.0], [20.0], [5.0]])

    def solve(which):
        params = dynamics.params.replace(g=gravity[which, 0])
        limits = ([-np.inf, -2.0], [np.inf, 2.0])
        problem = ddp.Problem(dynamics, cost, 25, params, state_limits=limits)
        return ddp.solve(problem, x0[which], np.zeros((len(which), 25, 1)), options)

    batch = solve([0, 1, 2])
    for b in range(3):
        alone = solve([b])
        for name in ("us", "K", "Vx", "status", "iterations", "cost"):
            np.testing.assert_array_equal(getattr(batch, name)[b], getattr(alone, name)[0], err_msg=name)
    assert {int(n) for n in batch.iterations} != {15}


def test_passes_end_where_the_listener_says_so_and_are_told_as_they_are():
    """Every round of state limits began again, and the passes of a batch were told beyond those allowed."""
    dynamics = ddp.WarpDynamics(make_pendulum, 2, 1, {"g": 1.0})
    cost = ddp.costs.quadratic(np.diag([1, 0.1]), [[0.01]], np.diag([100, 10.0]), target=[np.pi, 0])
    params = dynamics.params.replace(g=np.array([1.0, 20.0]))
    problem = ddp.Problem(dynamics, cost, 25, params, state_limits=([-np.inf, -2.0], [np.inf, 2.0]))
    work, told = ddp.Workspace(problem, 2, ddp.Options(max_iterations=15)), []
    made = work.run(np.array([[0.0, 0.0], [0.5, 0.0]]), None, progress=lambda *each: told.append(each[0]))
    assert max(told) == made == work.passes.numpy().max() <= 15
    stopped = []

    def stop(passes, going, cost):
        stopped.append(passes)
        return len(stopped) == 3

    work.run(np.array([[0.0, 0.0], [0.5, 0.0]]), None, progress=stop)
    assert stopped == [1, 2, 3]


def entries(scene, plan, offset=1, order=slice(None)):
    """A library of runs: pairs of entries at the cart's places 0 and 1/4, numbered 0, 1, 10, 11, 20, .."""
    x, count = np.zeros((2 * len(plan), 4)), 2 * len(plan)
    x[1::2, 0] = 0.25
    u = (10.0 * np.repeat(np.arange(len(plan)), 2) + np.arange(count) % 2)[:, None]
    header = {"scene": scene.name, "digest": scene_digest(scene), "end": 5, "offset": offset,
              "step_size": scene.step_size}  # fmt: skip
    zero = np.zeros(count)
    return ddp.Library(
        x=x[order], u=1e-3 * u[order], K=np.zeros((count, 1, 4)), cost=zero, gain=zero, age=zero.astype(int),
        chain=zero.astype(int), plan=np.repeat(plan, 2)[order], period=scene.state_period, header=header,
    )  # fmt: skip


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
def test_a_step_without_entries_asks_the_nearest_that_has_some_about_its_state(order, dtype):
    scene = slcp.scenes.cart_pole()
    policy = entries(scene, [0, 2, 3, 7], order=order).policy()
    for place, one in ((0.0, 0), (0.25, 1)):
        run = slcp.Simulator(scene, device="cpu", dtype=dtype).rollout(
            [place, 0.0, 0.0, 0.0], policy=policy, steps=10, record="controls"
        )
        due = [0, 0, 10, 20, 20, 20, 30, 30, 30, 30]
        np.testing.assert_allclose(1e3 * run.controls.ravel(), np.array(due) + one, rtol=1e-6)


def test_runs_of_other_steps_are_not_joined():
    scene = slcp.scenes.cart_pole()
    with pytest.raises(slcp.InputError, match="steps of different runs"):
        ddp.concatenate([entries(scene, [0, 2]), entries(scene, [0, 2], offset=4)])


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_a_plan_of_other_steps_is_a_start_in_time(rate):
    scene, cost = slcp.scenes.cart_pole(), ddp.costs.quadratic(np.eye(4), ONE, np.eye(4))
    sim = slcp.Simulator(scene, slcp.Options("hard"), device="cpu", dtype="float64")
    problem = ddp.Problem(sim, cost, 8)
    plan = ddp.solve(
        problem, [0.1, 0.0, 0.0, 0.0], 0.1 * np.arange(8)[:, None], ddp.Options(max_iterations=0)
    )
    other = problem.with_params(step_size=rate * scene.step_size)
    controller = ddp.MPC(
        other, starts=["plan"], plan=plan, replan=4, passes=0, options=ddp.Options(max_iterations=0)
    )
    run = sim.rollout(
        [0.1, 0.0, 0.0, 0.0], policy=controller, steps=4, params=other.params, record="controls"
    )
    expected = ddp.TrackingPolicy(plan).at(rate * scene.step_size)
    expected = sim.rollout(
        [0.1, 0.0, 0.0, 0.0], policy=expected, steps=4, params=other.params, record="controls"
    )
    np.testing.assert_allclose(run.controls, expected.controls, atol=1e-12)
    np.testing.assert_allclose(run.controls.ravel(), 0.1 * np.floor(rate * np.arange(4)), atol=0.05)


def test_a_plan_is_not_tracked_in_a_scene_of_other_names():
    scene, cost = slcp.scenes.cart_pole(), ddp.costs.quadratic(np.eye(4), ONE, np.eye(4))
    sim = slcp.Simulator(scene, slcp.Options("hard"), device="cpu", dtype="float64")
    plan = ddp.solve(ddp.Problem(sim, cost, 8), scene.x0, np.zeros((8, 1)), ddp.Options(max_iterations=0))
    bodies = tuple(dataclasses.replace(body, name=f"other_{body.name}", parent=None) for body in scene.bodies)
    actuators = tuple(dataclasses.replace(a, body=f"other_{a.body}") for a in scene.actuators)
    other = slcp.Scene("other", bodies, actuators=actuators, step_size=scene.step_size)
    with pytest.raises(slcp.InputError, match="the plan is of scene 'cart_pole', with state_names"):
        slcp.Simulator(other, slcp.Options("hard"), device="cpu").rollout(
            other.x0, policy=ddp.TrackingPolicy(plan), steps=2
        )
    with pytest.raises(slcp.InputError, match="a ddp.Result, its `best`"):
        ddp.TrackingPolicy(ddp.solve_multistart(ddp.Problem(sim, cost, 8), scene.x0, np.zeros((1, 8, 1))))
