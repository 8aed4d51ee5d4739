"""Plans and model predictive control of controls that act some steps after they are sent."""

from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.multistart.travel import digest_of, read_starts, write_starts
from slcp_warp.ddp.planning import Late

DELAY = 3


@pytest.fixture(scope="module")
def planned():
    task = slcp.tasks.push_to_mark()
    sim, options = task.simulator(device="cpu"), ddp.Options(max_iterations=40)
    return task, sim, options, ddp.plan(task, 4, seed=1, sim=sim, options=options)


def late(task, steps=DELAY, **changes):
    h = task.scene.step_size
    return task.replace(disturbances=replace(task.disturbances, delay=steps * h), **changes)


def test_an_undisturbed_world_with_a_delay_ends_where_the_plan_does(planned):
    """The plan that knows of none pushes .06 s late, and misses a mark that is narrow enough."""
    task, sim, options, before = planned
    own = late(task)
    found = ddp.plan(own, 4, seed=1, sim=sim, options=options).best
    assert found.delay == DELAY and not found.us[:DELAY].any() and found.us[DELAY:].any()
    run = sim.rollout(task.start[0], found.us)
    np.testing.assert_allclose(run.states, found.xs, rtol=0, atol=1e-9)
    place = task.scene.state_index("block.x")
    narrow = slcp.measures.final("block.x").between(*(found.xs[-1, place] + np.array([-3e-3, 3e-3])))
    policies = {"before": ddp.TrackingPolicy(before.best), "late": ddp.TrackingPolicy(found)}
    how = {"worlds": 1, "cases": task.options, "dtype": "float64", "device": "cpu"}
    report = slcp.sweep(own.replace(success=narrow), policies, **how)
    ends = {name: report.part(name, arm="undisturbed") for name in policies}
    assert ends["late"]["success"].all() and not ends["before"]["success"].any()
    assert ends["late"]["place"][0] == pytest.approx(found.xs[-1, place], abs=1e-6)


def test_a_late_plan_is_a_plan_in_files_and_says_what_it_is(planned, tmp_path):
    task, sim, options, before = planned
    short = {"methods": ("gauss-newton",), "options": ddp.Options(max_iterations=3), "sim": sim}
    many = ddp.plan(late(task), before.best.us[None] * (np.arange(task.horizon) >= DELAY)[:, None], **short)
    again = ddp.Result.load(many.best.save(tmp_path / "late.npz"))
    assert again.delay == DELAY and many.all.select(0).delay == DELAY
    assert np.isnan(again.Vx[:DELAY]).all() and np.isfinite(again.Vx[DELAY:]).all()
    policy = ddp.TrackingPolicy(again)
    assert policy.early == DELAY and policy.us.shape[1] == task.horizon - DELAY
    np.testing.assert_array_equal(policy.us[0], again.us[DELAY:])
    np.testing.assert_array_equal(policy.xs[0], again.xs)  # what is met when a control is sent
    work = ddp.Workspace(ddp.problem_of(task, sim), 1, ddp.Options(max_iterations=0))
    assert work.solve(task.start[0], again.us).cost[0] == pytest.approx(float(again.cost), rel=1e-9)
    assert again.trace.cost[-1] == pytest.approx(float(again.cost), rel=1e-12)
    for wrong in (-1, task.horizon, "soon"):
        replace(many.best, header={"delay": wrong}).save(tmp_path / "wrong.npz")
        with pytest.raises(slcp.FileError, match="header..delay.. is"):
            ddp.Result.load(tmp_path / "wrong.npz")
    with pytest.raises(slcp.InputError, match="starts has controls in its first 3 steps"):
        ddp.plan(late(task), np.ones((1, task.horizon, 1)), **short)
    with pytest.raises(slcp.InputError, match="controls act 80 steps after they are sent; plans of more"):
        ddp.plan(late(task, task.horizon, duration=2.0), 1, sim=sim)


@pytest.mark.parametrize("steady", [True, False])
def test_what_is_left_of_a_linear_problem_is_solved(steady):
    """By least squares over the controls that can act, targets of every step counted from the start. Limits
    may leave out zero: before the first control the nearest to it acts.
    """
    rng, N = np.random.default_rng(4), 12
    A, B = np.eye(2) + 0.1 * rng.standard_normal((2, 2)), rng.standard_normal((2, 1))
    target = rng.standard_normal((1 if steady else N + 1, 2))
    cost = ddp.costs.quadratic(np.diag([1.0, 2.0]), [[0.3]], np.diag([5.0, 4.0]), target)
    problem = ddp.Problem(ddp.linear_system(A, B, device="cpu"), cost, N)
    x0 = rng.standard_normal(2)
    whole = Late.of(replace(problem, control_limits=(0.01, np.inf)), DELAY)
    assert whole.begin(x0) == pytest.approx(np.linalg.matrix_power(A, DELAY) @ x0 + sum(
        np.linalg.matrix_power(A, i) @ B[:, 0] * 0.01 for i in range(DELAY)))  # fmt: skip
    rest = Late.of(problem, DELAY)
    found = rest.extend(ddp.solve(rest.rest, rest.begin(x0), np.zeros((N - DELAY, 1))), x0)
    free = N - DELAY
    states, effect = [x0], [np.zeros((2, free))]
    for k in range(N):
        own = np.zeros((2, free))
        if k >= DELAY:
            own[:, k - DELAY] = B[:, 0]
        states.append(A @ states[-1])
        effect.append(A @ effect[-1] + own)
    roots = [np.sqrt(np.diag([1.0, 2.0]))] * N + [np.sqrt(np.diag([5.0, 4.0]))]
    aims = np.broadcast_to(target, (N + 1, 2))
    rows = np.concatenate([r @ e for r, e in zip(roots, effect)] + [np.sqrt(0.3) * np.eye(free)])
    rhs = np.concatenate([r @ (a - x) for r, a, x in zip(roots, aims, states)] + [np.zeros(free)])
    best = np.linalg.lstsq(rows, rhs, rcond=None)[0]
    np.testing.assert_allclose(found.us[:, 0], np.concatenate([np.zeros(DELAY), best]), atol=1e-6)
    assert float(found.cost) == pytest.approx(0.5 * np.sum((rows @ best - rhs) ** 2), rel=1e-9)


def test_plans_know_what_acts_before(planned):
    """Of an arm that what acts before holds up: the plan begins where it is, and MPC's foretold states do."""
    task, sim, options, before = planned
    h = task.scene.step_size
    own = task.replace(disturbances=replace(task.disturbances, delay=DELAY * h, before=(2.5,)))
    problem = ddp.problem_of(own, sim)
    assert problem.rest_control() == pytest.approx(np.clip(2.5, *problem.limit_rows()))
    pushed = sim.rollout(task.start[0], np.full((DELAY, 1), problem.rest_control()[0, 0])).states[-1]
    assert Late.of(problem, DELAY).begin(task.start[0]) == pytest.approx(pushed, abs=1e-9)
    found = ddp.plan(own, before.best.us[None] * (np.arange(task.horizon) >= DELAY)[:, None], sim=sim,
                     methods=("gauss-newton",), options=ddp.Options(max_iterations=3)).best  # fmt: skip
    assert (found.us[:DELAY] == problem.rest_control()).all()
    np.testing.assert_allclose(sim.rollout(task.start[0], found.us).states, found.xs, rtol=0, atol=1e-9)
    mpc = ddp.MPC(problem, passes=1, lag=DELAY)
    run = slcp.sweep(own, {"mpc": mpc}, worlds=1, cases=own.options, dtype="float64", device="cpu")
    assert not run.part("mpc", arm="undisturbed")["status"].any()
    np.testing.assert_allclose(mpc._way[0].path.shape, (1, DELAY + 1, sim.nx))


def test_what_acts_before_travels_to_other_processes(planned, tmp_path):
    task, sim, _, before = planned
    problem = replace(ddp.problem_of(task, sim), before=(0.75,))
    arrays, options = {"starts": before.best.us[None]}, ddp.Options()
    write_starts(tmp_path / "starts.npz", problem, arrays, options)
    again, _, _ = read_starts(tmp_path / "starts.npz", digest_of(problem, arrays, options))
    np.testing.assert_array_equal(again.rest_control(), problem.rest_control())
    with pytest.raises(slcp.ArgumentError, match="before has shape"):
        replace(problem, before=(1.0, 2.0))
