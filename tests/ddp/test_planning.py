"""A plan of a task in one call; and no task has a place in code that all share."""

import importlib
import re
import runpy
import warnings
from dataclasses import replace

import numpy as np
import pytest
from ddp_examples import cart_pole
from plan import LAYERS, ROOT, source_files

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.planning import noise_scale, plan_starts, random_starts
from slcp_warp.ddp.planning.set_points import set_points

CONSTRUCTORS = ("slcp_warp/tasks/", "slcp_warp/scenes/")  # what the names stand for is made there


@pytest.fixture(scope="module")
def planned():
    task = slcp.tasks.push_to_mark()
    sim = task.simulator(device="cpu")
    options = ddp.Options(max_iterations=40)
    first = ddp.plan(task, 4, seed=1, sim=sim, options=options, methods=("gauss-newton",))
    return task, sim, options, first, ddp.plan(task, 4, seed=1, sim=sim, options=options)


def test_a_problem_is_the_tasks(planned):
    task, sim, *_ = planned
    problem = ddp.problem_of(task, sim)
    assert problem.dynamics is sim and problem.cost is task.cost and problem.horizon == task.horizon
    assert [limit.tolist() for limit in problem.limit_rows()] == [[[-20.0]], [[20.0]]]


def test_one_call_plans_a_task_where_zero_controls_are_flat(planned):
    """The block ends at its mark, in a rollout of its own; from zero controls nothing would touch it."""
    task, sim, _, _, best = planned
    run = sim.rollout(task.start[0], best.best.us)
    assert run.states[-1][task.scene.state_index("block.x")] == pytest.approx(0.6, abs=0.05)
    assert float(best.best.cost) < 1.0 and np.abs(best.best.us).max() <= 20.0
    still = ddp.plan(task, np.zeros((1, task.horizon, 1)), sim=sim, methods=("gauss-newton",))
    assert still.best.status == ddp.Status.FLAT and float(still.best.cost) == pytest.approx(72.0, rel=1e-3)


def test_the_second_method_goes_on_from_the_best_and_never_gets_worse(planned):
    task, sim, options, first, best = planned
    costs = np.sort(first.all.cost)
    assert len(costs) == 5 and len(best.all.cost) == 3  # a sampled one too; the zero one again
    assert (best.all.cost[:2] <= costs[:2] + 1e-12).all() and best.all.cost[2] == pytest.approx(
        72.0, rel=1e-3
    )
    assert first.best.cost == costs[0] == first.all.cost[first.index]
    again = ddp.plan(task, first.all.us, sim=sim, options=options, methods=("second-order",))
    assert float(again.best.cost) <= costs[0]


def test_passes_are_told_as_they_are_made(planned):
    task, sim, options, first, best = planned
    told = []
    again = ddp.plan(task, 4, seed=1, sim=sim, options=options, progress=lambda *found: told.append(found))
    np.testing.assert_array_equal(again.best.us, best.best.us)
    methods, passes, going, cost = zip(*told)
    assert list(dict.fromkeys(methods)) == ["gauss-newton", "second-order"]
    parts = [[each[1:] for each in told if each[0] == method] for method in dict.fromkeys(methods)]
    for part in parts:
        made, left, lowest = zip(*part)
        assert list(made) == list(range(made[0], made[0] + len(part))) and min(left) >= 0
        assert list(lowest) == sorted(lowest, reverse=True)
    assert cost[-1] == pytest.approx(float(best.best.cost), rel=1e-9)
    assert parts[0][-1][2] == pytest.approx(float(first.best.cost), rel=1e-9)
    with pytest.raises(slcp.InputError, match="progress is .*; it must take 4 arguments"):
        ddp.plan(task, 4, sim=sim, progress=lambda done: None)


def test_planning_ends_where_progress_says_so(planned):
    """With the best plan so far, a rollout with gains, and no further method."""
    task, sim, options, first, best = planned
    told = []
    ended = ddp.plan(
        task,
        4,
        seed=1,
        sim=sim,
        options=options,
        progress=lambda *found: told.append(found) or len(told) == 3,
    ).best
    assert [each[0] for each in told] == ["gauss-newton"] * 3 and ended.iterations == told[-1][1]
    assert ended.status == ddp.Status.MAX_ITERATIONS and ended.K.any()
    assert float(ended.cost) == pytest.approx(told[-1][3], rel=1e-9) and ended.cost >= best.best.cost
    np.testing.assert_allclose(sim.rollout(ended.xs[0], ended.us).states, ended.xs, atol=1e-9)


def test_passes_of_all_methods_count(planned, tmp_path):
    """Also where the last one begins at what is stationary already: it was told as made in 0 passes."""
    _, _, _, first, best = planned
    last = best.all.select(best.index)
    before = first.all.select(int(np.argsort(first.all.cost)[best.index]))
    assert best.index < 2 and before.iterations > 0
    assert best.best.iterations == before.iterations + last.iterations
    costs = best.best.trace.cost
    np.testing.assert_array_equal(costs[: before.iterations], before.trace.cost[: before.iterations])
    np.testing.assert_array_equal(costs[before.iterations :], last.trace.cost[: last.iterations + 1])
    again = ddp.Result.load(best.best.save(tmp_path / "plan.npz"))
    assert again.iterations == best.best.iterations


def rungs(planned, passes=40, **more):
    """Six starts on the way to the mark, and the same where all but two end after five passes."""
    task, sim, *_ = planned
    problem = ddp.problem_of(task.replace(**more), sim)
    starts = np.concatenate(
        [plan_starts(problem, task.start[0], 4, seed=1), np.full((1, task.horizon, 1), 5.0)]
    )
    options = ddp.Options(method="gauss-newton", max_iterations=passes)
    work = ddp.Workspace(problem, len(starts), options)
    short = ddp.Workspace(problem, len(starts), replace(options, max_iterations=5))
    runs = work.solve(task.start[0], starts), work.solve(task.start[0], starts, rungs=[(5, 2)])
    return *runs, short.solve(task.start[0], starts), work


def test_what_is_left_behind_ends_there_and_what_is_kept_is_as_without_rungs(planned):
    """Bit for bit: the trajectories, their gains and the values; what has ended by itself is let be."""
    whole, halved, short, _ = rungs(planned)
    cost = np.where(whole.iterations >= 5, whole.trace.cost[:, 5], whole.cost)
    kept = np.isin(np.arange(len(cost)), np.argsort(cost, kind="stable")[:2]) | (whole.iterations < 5)
    assert 0 < (~kept).sum() and halved.iterations[~kept].tolist() == [5] * (~kept).sum()
    assert (halved.status[~kept] == ddp.Status.MAX_ITERATIONS).any()
    for name in ("us", "xs", "K", "Vx", "Vxx", "cost", "status", "gradient"):
        mine, long, ended = (getattr(each, name) for each in (halved, whole, short))
        assert mine[kept].tobytes() == long[kept].tobytes(), name
        assert mine[~kept].tobytes() == ended[~kept].tobytes(), name


@pytest.mark.parametrize(
    "given, text", [([(5, -1)], "problems of rungs is -1"), ([(5, 0)], "problems of rungs is 0"),
                    ([(-1, 2)], "passes of rungs is -1"), ([5], r"rungs is \[5\]; pairs"), (3, "rungs is 3")]
)  # fmt: skip
def test_bad_rungs_are_refused(planned, given, text):
    work = ddp.Workspace(ddp.problem_of(*planned[:2]), 2, ddp.Options(method="gauss-newton"))
    with pytest.raises(slcp.InputError, match=text):
        work.solve(planned[0].start[0], None, rungs=given)


@pytest.mark.full
def test_what_is_left_behind_gets_no_rounds_for_its_limits_of_states(planned):
    """The others keep them, in rounds of which those that were left behind are no part."""
    place = planned[0].scene.state_index("block.vx")
    fastest = 0.6 * float(planned[3].best.xs[:, place].max())
    whole, halved, _, work = rungs(planned, 400, state_limits={"block.vx": (-np.inf, fastest)})
    behind = (halved.status == ddp.Status.MAX_ITERATIONS) & (halved.iterations == 5)
    assert behind.any() and (whole.iterations[behind] > 5).any()
    best = int(np.argmin(np.where(behind, np.inf, halved.cost)))
    assert work.beyond_limits()[best] <= work.options.limit_tolerance
    assert work.beyond_limits()[behind].max() > work.options.limit_tolerance


def test_the_best_plan_keeps_its_limits_of_states(planned):
    """Those that were left behind do not, and cost less."""
    task, sim, *_ = planned
    place = task.scene.state_index("block.vx")
    fastest = 0.6 * float(planned[3].best.xs[:, place].max())
    problem = ddp.problem_of(task.replace(state_limits={"block.vx": (-np.inf, fastest)}), sim)
    options = ddp.Options(max_iterations=400)
    found = ddp.plan(problem, 8, x0=task.start[0], methods=("gauss-newton",), options=options)
    assert found.best.cost > found.all.cost.min() and found.best.status != ddp.Status.MAX_ITERATIONS
    assert found.best.xs[:, place].max() <= fastest + options.limit_tolerance * max(1.0, fastest)


def test_starts_are_noise_of_the_size_of_the_limits():
    task = slcp.tasks.push_to_mark().replace(control_limits=(-20.0, np.inf))
    assert noise_scale(task) == [1.0]
    assert noise_scale(task.replace(control_limits=(-5.0, 10.0))) == [2.0]
    starts = random_starts(2000, 40, 1, np.array([2.0]), seed=0)
    assert (starts[0] == 0.0).all()
    assert starts[1:].std(axis=0) == pytest.approx(2.0, abs=0.2)  # at every step
    near = np.mean(starts[1:, 20] * starts[1:, 21]) / 4.0
    assert near == pytest.approx(np.exp(-1.0 / 8.0), abs=0.06)


def test_starts_are_narrow_and_wide_in_turn():
    """A lever that a fifth of the limits never reaches was left alone by every plan."""
    problem, x0, _ = cart_pole("cpu")
    quick = ddp.Sampling(samples=8, iterations=1)
    us = plan_starts(problem, x0, 400, seed=3, scale=0.4, sampling=quick)[:400]
    assert not us[0].any()
    sizes = [us[first::3].std() for first in (1, 2, 3)]
    assert sizes == pytest.approx([0.4, 1.0, 2.0], rel=0.1)
    nothing, methods = ddp.Options(max_iterations=0), ("gauss-newton",)
    found = ddp.plan(problem, 6, 3, x0=x0, explore=0.4, options=nothing, methods=methods)
    np.testing.assert_array_equal(found.all.us[:6], us[:6])
    with pytest.raises(slcp.InputError, match="explore: scale must be a number of at least 0"):
        ddp.plan(problem, 6, x0=x0, explore=-1.0)
    with pytest.raises(slcp.InputError, match=r"explore: scale has shape \(3,\)"):
        ddp.plan(problem, 6, x0=x0, explore=[1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    "given, text",
    [
        ({"starts": 0}, "starts is 0"),
        ({"starts": np.zeros((2, 3, 1))}, "starts"),
        ({"starts": np.zeros((0, 80, 1))}, "at least one start"),
        ({"seed": -1}, "seed is -1"),
        ({"x0": np.zeros(3)}, "x0"),
        ({"methods": ()}, "methods is"),
        ({"methods": ("newton",)}, "newton"),
        ({"finish": 0}, "finish is 0"),
        ({"task": 1}, "task is a int"),
    ],
)
def test_what_cannot_be_planned(planned, given, text):
    task, sim, *_ = planned
    with pytest.raises(slcp.InputError, match=text):
        ddp.plan(given.pop("task", task), sim=sim, **given)


def test_shared_code_names_no_task():
    """Commands, stages and the solver treat every task alike; the paper's studies are of the finger."""
    known = "|".join(set(slcp.tasks.NAMED) - {"flicking_finger"})
    names = re.compile(rf"(?:tasks\.|[\"'])({known})\b")  # not the verb to catch
    found = {
        str(path.relative_to(ROOT)): sorted(set(names.findall(path.read_text(encoding="utf-8"))))
        for path in source_files(*LAYERS)
    }
    assert {path: words for path, words in found.items() if words and not path.startswith(CONSTRUCTORS)} == {}


def test_a_tasks_limits_of_states_are_the_problems(planned):
    """By name, and the plan keeps them where the one without them does not."""
    task, sim, _, first, _ = planned
    place = task.scene.state_index("block.vx")
    fastest = 0.6 * float(first.best.xs[:, place].max())
    slow = task.replace(state_limits={"block.vx": (-np.inf, fastest)})
    lower, upper = ddp.problem_of(slow, sim).state_limit_rows()
    assert upper[0, place] == fastest and np.isfinite(upper).sum() == 1 and not np.isfinite(lower).any()
    found = ddp.solve(
        ddp.problem_of(slow, sim), task.start[0], first.best.us, ddp.Options(method="gauss-newton")
    )
    assert found.xs[:, place].max() <= fastest + 2e-3 and found.cost > first.best.cost
    run = sim.rollout(task.start[0], policy=ddp.TrackingPolicy(found), steps=task.horizon)
    assert run.states[:, place].max() <= fastest + 2e-3


def test_a_problem_of_ones_own_is_planned_from_sampled_and_stabilised_starts_too():
    """Altro's cart-pole: both are among the starts, and the plan is the best of all."""
    problem, x0, _ = cart_pole("cpu", limits=(-15.0, 15.0))
    starts = plan_starts(problem, x0, 4, seed=0)
    assert starts.shape == (5, 40, 1) and np.abs(starts).max() <= 15.0  # hanging is stable
    balanced = plan_starts(problem, np.array([0.0, 0.1, 0.0, 0.0]), 4, seed=0)
    assert balanced.shape == (6, 40, 1)
    rolled = ddp.solve(problem, np.array([0.0, 0.1, 0.0, 0.0]), balanced[-1], ddp.Options(max_iterations=0))
    assert np.abs(rolled.xs[:, 1]).max() < 0.3  # it stands
    found = ddp.plan(problem, x0=x0)
    assert found.best.converged and found.best.cost <= ddp.solve(problem, x0).cost + 1e-9
    with pytest.raises(slcp.InputError, match="is planned from an x0"):
        ddp.plan(problem)


@pytest.mark.full
def test_a_scene_that_only_generic_kernels_take_is_planned():
    """Eight boxes have 34 rows; starts are zeros, noise and what sampling finds."""
    task = runpy.run_path(str(ROOT / "examples/tasks/push_stack.py"))["push_stack"](8)
    options = ddp.Options(max_iterations=2)
    found = ddp.plan(task, 4, x0=task.scene.x0, options=options, methods=("gauss-newton",), finish=1)
    plan = found.best
    assert plan.status != ddp.Status.DYNAMICS_FAILED and plan.xs.shape == (61, 50)
    sim = slcp.Simulator(task.scene, task.options, device="cpu")
    np.testing.assert_allclose(sim.rollout(task.scene.x0, plan.us).states, plan.xs, atol=1e-8)


def test_a_start_beyond_a_limit_is_told(monkeypatch):
    """A plan would live on what throws it back."""
    monkeypatch.setattr(
        importlib.import_module(f"{ddp.__name__}.planning.plan"), "plan_late", lambda *_: None
    )
    bodies = (
        slcp.Body("arm", 1.0, 0.05, lower=-0.5, upper=0.5),
        slcp.Body("hand", 0.5, 0.02, parent="arm", anchor=(0.4, 0.0), upper=1.2),
    )
    scene = slcp.Scene("arm", bodies, actuators=(slcp.Actuator("arm"),))
    cost = slcp.costs.terms(scene, [slcp.costs.effort(1.0)])
    task = slcp.Task(name="reach", scene=scene, cost=cost, horizon=3, start={"hand.angle": 1.311})
    with pytest.warns(RuntimeWarning, match="x0 has hand.angle 0.111 above its upper limit"):
        ddp.plan(task)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ddp.plan(task, x0=[0.5, 1.2, 3.0, 4.0])
    with pytest.warns(RuntimeWarning, match="x0 has arm.angle 0.25 below its lower limit"):
        ddp.plan(task, x0=[-0.75, 0.0, 0.0, 0.0])


def servoed():
    """A lift whose joint has a servo, an arm with a limited one, and a wrist that a torque turns."""
    lift, up = slcp.servo(slcp.Body("lift", 1.0, 0.1, joint="prismatic"), 300.0)
    arm = slcp.Body("arm", 1.0, 0.1, "lift", com=(0.2, 0.0))
    wrist = slcp.Body("wrist", 0.1, 0.01, "arm", anchor=(0.4, 0.0), stiffness=5.0)
    drive, motor = slcp.limited_servo(arm, 40.0, 9.0)
    motors = (up, motor, slcp.Actuator("wrist", gear=2.0))
    return slcp.Scene("servoed", (lift, arm, wrist), actuators=motors, tendons=(drive,), step_size=0.01)


def test_plans_of_servos_begin_where_they_are(device):
    """About the set-points of the first state's place; others about nothing, as ever."""
    scene, x0 = servoed(), np.array([0.3, -1.2, 0.5, 0.1, 0.0, 0.0])
    np.testing.assert_allclose(set_points(scene, x0), [0.3, -1.2, 0.0])
    sim = slcp.Simulator(scene, slcp.Options("hard"), dtype="float64", device=device)
    start = np.array([0.3, -1.2, 0.0, 0.0, 0.0, 0.0])
    still = sim.step(start[None], set_points(scene, start)[None]).state[0]
    np.testing.assert_allclose(still, start + [0, 0, 0, *(still - start)[3:]], atol=0.1)
    assert np.abs(still[3:]).max() < 0.2  # 9.81 m/s2 for .01 s; zeros pull with 90 N and 9 N m
    cost = slcp.costs.terms(scene, [slcp.costs.effort(1.0)])
    problem = ddp.Problem(sim, cost, 30, None, (-0.9, 0.9))
    us = plan_starts(problem, x0, 3, seed=2, scale=0.01)
    np.testing.assert_allclose(us[0], np.broadcast_to([0.3, -0.9, 0.0], (30, 3)))
    noise = np.clip(
        random_starts(3, 30, 3, 0.01, 2) * [[[5.0]], [[1.0]], [[2.5]]] + [0.3, -1.2, 0.0], -0.9, 0.9
    )
    np.testing.assert_allclose(us, noise)
    assert not set_points(slcp.scenes.flicking_finger(), np.ones(6)).any()
    assert not set_points(slcp.scenes.hopper(), np.ones(2 * slcp.scenes.hopper().nv)).any()
