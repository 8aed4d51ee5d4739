"""Model predictive control as a policy: its plans, what it does between them and when one fails."""

from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library import receding
from slcp_warp.ensembles.worlds.nominal import nominal

HORIZON = 75
WORLDS = 3
FROZEN = ddp.Options(gradient_tolerance=1e9)  # nothing is to be improved


@pytest.fixture(scope="module")
def task():
    return slcp.tasks.flicking_finger()


@pytest.fixture(scope="module")
def problem(task):
    return ddp.problem_of(task)


def starts_of(task, worlds=WORLDS):
    x0 = np.repeat(task.start[:1], worlds, axis=0)
    x0[:, 3:] += np.random.default_rng(5).normal(0.0, 1.0, (worlds, 3))
    return x0


def run(policy, task, x0, steps=6, **more):
    return task.simulator().rollout(x0, policy=policy, steps=steps, record="controls", **more)


def test_between_plans_an_undisturbed_model_follows_the_plan(task, problem):
    """Controls of the first `replan` steps are those of `ddp.solve` from the same start."""
    x0 = starts_of(task)
    policy = ddp.MPC(problem, passes=40, replan=8, starts=["zero"])
    found = run(policy, task, x0, 8)
    plan = ddp.solve(problem, x0, np.zeros((WORLDS, HORIZON, 2)), ddp.Options(max_iterations=40))
    np.testing.assert_allclose(found.controls, plan.us[:, :8], atol=1e-7)
    np.testing.assert_allclose(found.states, plan.xs[:, :9], atol=1e-7)
    np.testing.assert_allclose(policy.intended(1), plan.xs[1], atol=1e-7)
    assert policy.chosen == {"zero": WORLDS} and policy.failures == 0 and len(policy.seconds) == 1


def test_a_disturbed_world_is_fed_back_between_plans(task, problem):
    """u = us_j + K_j (x - xs_j) with the plan's own gains, computed here from a solution."""
    x0 = starts_of(task)
    policy = ddp.MPC(problem, passes=40, replan=4, starts=["zero"])
    policy.begin(task.simulator(), np.arange(WORLDS))
    policy.act(x0, 0.0, np.arange(WORLDS))
    plan = ddp.solve(problem, x0, np.zeros((WORLDS, HORIZON, 2)), ddp.Options(max_iterations=40))
    away = 0.01 * np.random.default_rng(1).standard_normal(x0.shape)
    expected = plan.us[:, 1] + np.einsum("bux,bx->bu", plan.K[:, 1], away)
    found = policy.act(plan.xs[:, 1] + away, 0.05, np.arange(WORLDS))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_every_cycle_costs_no_more_than_the_shifted_plan(task, problem):
    """The plan of a cycle against the shifted policy before it, rolled out from the same states."""
    policy = ddp.MPC(problem, passes=1, starts=["shift", "zero"])
    x0 = starts_of(task)
    states = run(policy, task, x0, 10).states
    planner = policy._planners[0]
    last = planner.policy.shifted(1, HORIZON)
    shifted = ddp.Workspace(problem, WORLDS, ddp.Options(max_iterations=0))
    shifted.start(states[:, -1], last.us, last.xs, last.K, last.k)
    policy.act(states[:, -1], 0.5, np.arange(WORLDS))
    assert (planner.work.cost.numpy() <= shifted.cost.numpy() + 1e-9).all()


@pytest.fixture(scope="module")
def planned(task, problem):
    """A problem of 20 steps and its plan, converged."""
    short = replace(problem, horizon=20)
    best = ddp.plan(short, 2, x0=task.start[0], finish=1).best
    assert float(best.gradient) < 1e-6
    return short, best


def test_plans_that_end_with_the_run_keep_to_the_optimum(task, planned):
    """The rest of an optimal plan is optimal for the rest of the run (Bellman), and for nothing longer."""
    short, plan = planned
    policy = ddp.MPC(short, plan=plan, end=20)
    assert list(policy.starts) == ["shift", "plan"]
    found = run(policy, task, task.start[:1], 20)
    np.testing.assert_allclose(found.controls[0], plan.us, atol=1e-5)
    beyond = run(ddp.MPC(short, plan=plan), task, task.start[:1], 20)
    assert np.abs(beyond.controls[0] - plan.us).max() > 1e-2


def test_plans_have_the_whole_horizon_again_after_the_run(task, planned):
    short, plan = planned
    policy, worlds = ddp.MPC(short, plan=plan, end=3), np.arange(1)
    policy.begin(task.simulator(), worlds)
    lengths = []
    for k in range(5):
        assert np.isfinite(policy.act(task.start[:1], 0.05 * k, worlds)).all()
        lengths.append(len(policy.intended()) - 1)
    assert lengths == [3, 2, 1, 20, 20] and policy.failures == 0


def test_a_plan_made_ahead_is_followed_from_disturbed_states(task, planned):
    """Without passes on the model: u = us_k + K_k (x - xs_k), for turned angles too."""
    short, plan = planned
    x0 = starts_of(task, 2) + task.scene.state_period * np.array([[0.0], [2.0]])
    policy = ddp.MPC(short, passes=2, starts=["plan"], plan=plan, replan=20, options=FROZEN)
    found = run(policy, task, x0, 20)
    tracking = ddp.TrackingPolicy(plan, task.scene.state_period)
    expected = task.simulator().rollout(x0, policy=tracking, steps=20, record="controls")
    np.testing.assert_allclose(found.controls, expected.controls, atol=1e-6)


def test_blocks_and_neighbours_change_no_bit(task, problem):
    x0 = starts_of(task, 5)
    whole = run(ddp.MPC(problem, passes=1), task, x0)
    blocks = run(ddp.MPC(problem, passes=1, block=2), task, x0)
    alone = run(ddp.MPC(problem, passes=1), task, x0[3:4])
    np.testing.assert_array_equal(whole.controls, blocks.controls)
    np.testing.assert_array_equal(whole.controls[3:4], alone.controls)


def test_a_rollout_begins_anew(task, problem):
    policy, x0 = ddp.MPC(problem, passes=1), starts_of(task)
    first = run(policy, task, x0)
    np.testing.assert_array_equal(first.controls, run(policy, task, x0).controls)


def test_real_time_iteration_answers_before_it_linearises(task, problem):
    """`prepare` between the cycles changes nothing but when the work is done."""
    x0, sim = starts_of(task), task.simulator()
    late, early = (ddp.MPC(problem, passes=0) for _ in range(2))
    assert list(late.starts) == ["shift", "keep", "zero"]
    worlds, x, y = np.arange(WORLDS), x0, x0
    for policy in (late, early):
        policy.begin(sim, worlds)
    for k in range(4):
        u, w = late.act(x, 0.05 * k, worlds), early.act(y, 0.05 * k, worlds)
        np.testing.assert_array_equal(u, w)
        assert early._planners[0]._open
        early.prepare()
        assert not early._planners[0]._open
        x = y = sim.step(x, u).state
    assert late.chosen["shift"] + late.chosen["keep"] > 0


def test_a_plan_with_a_delay_acts_when_it_is_there(task, problem):
    """Until then the plan before it goes on, at its later steps."""
    x0, worlds = starts_of(task), np.arange(WORLDS)
    policy = ddp.MPC(problem, passes=1, replan=2, delay=1)
    policy.begin(task.simulator(), worlds)
    policy.act(x0, 0.0, worlds)
    first = policy._active[0]
    policy.act(first.xs[:, 1], 0.05, worlds)
    gains = policy._planners[0].policy.K
    away = np.full_like(x0, 0.003)
    u = policy.act(first.xs[:, 2] + away, 0.1, worlds)
    np.testing.assert_allclose(u, first.us[:, 2] + np.einsum("bux,bx->bu", gains[:, 2], away), atol=1e-9)
    assert policy._coming[0] is not first
    policy.act(first.xs[:, 3], 0.15, worlds)
    assert policy._active[0] is policy._coming[0]


@pytest.mark.parametrize(
    "options, strategy, method",
    [
        (slcp.Options(), "specialised", "second-order"),
        (slcp.Options(), "generic", "gauss-newton"),
        (slcp.Options(integrator="trapezoidal"), "specialised", "gauss-newton"),
    ],
)
def test_second_order_is_the_rule_where_it_is_cheap(task, options, strategy, method):
    """By differences it takes nineteen twentieths of a cycle, in generic kernels two thirds."""
    sim = slcp.Simulator(task.scene, options, strategy=strategy)
    problem = ddp.Problem(sim, task.cost, 10, control_limits=task.control_limits)
    assert ddp.MPC(problem).options.method == method
    assert ddp.MPC(problem, options=ddp.Options()).options.method == "second-order"
    for given, used in ((None, method), (ddp.Options(), "second-order")):
        chains = receding._Chains(problem, task.start[0], ddp.RecedingOptions(solver=given))
        assert chains.shifting.options.method == used


def test_whole_turns_of_a_periodic_angle_change_nothing(task, problem):
    policy, x0 = ddp.MPC(problem, passes=1), starts_of(task)
    policy.begin(task.simulator(), np.arange(WORLDS))
    policy.act(x0, 0.0, np.arange(WORLDS))
    turned = x0 + task.scene.state_period * 2.0  # the ellipse looks the same after pi
    assert (turned != x0).any()
    other = ddp.MPC(problem, passes=1)
    other.begin(task.simulator(), np.arange(WORLDS))
    other.act(x0, 0.0, np.arange(WORLDS))
    u, w = policy.act(x0, 0.05, np.arange(WORLDS)), other.act(turned, 0.05, np.arange(WORLDS))
    np.testing.assert_allclose(u, w, atol=1e-6)


def test_a_start_that_blows_up_leaves_the_last_plan(task, problem):
    """No finite cost from any start: the plan before goes on, shifted, and the failure is counted."""
    bad = []

    def wild(s):
        return np.full((HORIZON, 2), 1e200 if bad else 0.0)

    policy, x0, worlds = ddp.MPC(problem, passes=1, starts=[wild]), starts_of(task), np.arange(WORLDS)
    policy.begin(task.simulator(), worlds)
    policy.act(x0, 0.0, worlds)
    policy.prepare()
    kept = policy._planners[0].policy
    bad.append(True)
    u = policy.act(kept.xs[:, 1], 0.05, worlds)
    np.testing.assert_allclose(u, kept.us[:, 1], atol=1e-9)
    assert policy.failures == WORLDS and policy.chosen["wild"] == WORLDS


def test_sampled_controls_are_a_start_that_is_never_worse_than_the_last_plan(task, problem):
    search = ddp.Sampling(samples=16, iterations=1)
    policy, x0, worlds = ddp.MPC(problem, passes=0, starts=[search]), starts_of(task), np.arange(WORLDS)
    run(policy, task, x0, 3)
    assert policy.chosen == {"sample": 3 * WORLDS} and policy.failures == 0
    last, x = policy._planners[0].acting, x0 + 0.01
    workspace = ddp.Workspace(problem, WORLDS, ddp.Options(max_iterations=0))
    workspace.start(x, np.concatenate([last.us[:, 1:], last.us[:, -1:]], axis=1))
    policy.act(x, 0.15, worlds)
    assert (policy._planners[0].work.cost.numpy() <= workspace.cost.numpy() + 1e-9).all()


def test_a_world_that_is_lost_gets_no_control_and_harms_no_other(task, problem):
    x0, worlds = starts_of(task), np.arange(WORLDS)
    policy, whole = (ddp.MPC(problem, passes=1) for _ in range(2))
    for each in (policy, whole):
        each.begin(task.simulator(), worlds)
    lost = x0.copy()
    lost[1] = np.nan
    u, w = policy.act(lost, 0.0, worlds), whole.act(x0, 0.0, worlds)
    assert not u[1].any()
    np.testing.assert_array_equal(u[[0, 2]], w[[0, 2]])


def test_limits_hold_between_plans(task):
    limited = ddp.problem_of(task.replace(control_limits=(-0.5, 0.5)))
    found = run(ddp.MPC(limited, passes=1, replan=3), task, starts_of(task) + 0.2)
    assert np.abs(found.controls).max() <= 0.5 and (np.abs(found.controls) == 0.5).any()


def test_limits_of_states_are_soft_in_its_plans(task):
    """No plan fails, and after some cycles the limits hold that are exceeded without."""
    limited = ddp.problem_of(task.replace(state_limits={"link2.vangle": (-0.1, 0.1)}))
    free, x0 = ddp.problem_of(task), task.start[:1]
    policies = [ddp.MPC(p, passes=10, options=ddp.Options(limit_weight=100.0)) for p in (limited, free)]
    late = [np.abs(run(policy, task, x0, 20).states[0, 8:, 4]) for policy in policies]
    assert [policy.failures for policy in policies] == [0, 0] and sum(policies[0].chosen.values()) == 20
    assert late[0].max() < 0.15 < 0.5 * late[1].max()


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("ratio", [0.25, 0.6, 2, 3])
def test_plans_are_followed_in_time_where_the_plant_steps_otherwise(task, problem, ratio, delay):
    """The control is of the plan that is there, and of its step that is nearest to the time."""
    replan, made = 4, []

    def push(s):
        made.append(round(s.time / 0.05))
        return 0.01 * np.arange(HORIZON)[:, None] * np.ones(2) + 0.001 * len(made)

    policy = ddp.MPC(problem, passes=0, replan=replan, delay=delay, starts=[push])
    policy._wrap = np.zeros(6)
    policy._controls = lambda i, age, x: asked.append(age) or np.zeros((1, 2))
    sim, asked, times = task.simulator(), [], []
    policy.begin(sim, np.arange(1))
    h = 0.05 * ratio
    every = max(1, round(0.05 / h))
    for k in range(0, 60, every):
        policy.act(task.start[:1], k * h, np.arange(1))
        times.append(k * h)
    for time, age in zip(times, asked, strict=True):
        now = int(np.floor(time / 0.05 + 0.5 - 1e-9))
        there = [n for n in made if n + delay <= now] or made[:1]
        assert age == now - there[-1]
    assert len(made) > 2 and min(np.diff(made)) >= replan and max(np.diff(made)) < replan + max(1, ratio)


def drawn(s):
    """A start of a user's own."""
    return np.array([rng.standard_normal((s.problem.horizon, 2)) for rng in s.rngs])


RANDOM = {"noise": "noise", "sampled": ddp.Sampling(samples=4, iterations=1), "drawn": drawn}


@pytest.mark.parametrize(("replan", "hold"), [(6, 1), (1, 1), (2, 2)])
def test_what_was_sent_before_is_foretold(task, problem, replan, hold):
    """With a lag of two steps an undisturbed world is, when a control acts, where its plan said."""
    x0, h, seen = starts_of(task), task.scene.step_size, []

    def keep(s):
        seen.append((round(s.time / h), s.x.copy()))
        return np.full((s.problem.horizon, 2), 0.05)

    policy = ddp.MPC(problem, passes=1, replan=replan, starts=[keep], lag=2)
    own = task.replace(disturbances=slcp.Disturbances(delay=2 * h, hold=hold * h))
    found = run(nominal(policy, own, h), own, x0, 6)
    assert [step for step, _ in seen] == list(range(2, 8, replan))
    assert not found.controls[:, :2].any() and found.controls[:, 2:].any()
    for step, x in seen:
        if step <= 6:
            np.testing.assert_allclose(x, found.states[:, step], rtol=0, atol=1e-9)
    if hold == 1:  # the plan that acts goes through the states that are met two steps later
        begins = 6 - replan
        np.testing.assert_allclose(policy.intended(1)[: 5 - begins], found.states[1, begins + 2 :], atol=1e-7)
    assert policy.met().shape == (WORLDS, 3, 6)


@pytest.mark.parametrize("lag", [0, 2, 30])
def test_without_an_end_plans_have_the_whole_horizon(task, problem, lag):
    policy = ddp.MPC(problem, passes=1, starts=["zero"], lag=lag)
    assert run(policy, task, starts_of(task), 3) and policy.plans()[0].horizon == problem.horizon


@pytest.mark.parametrize("start", RANDOM.values(), ids=RANDOM)
def test_noise_follows_from_the_worlds_number(task, problem, start):
    """However worlds are split into launches and blocks."""
    short = task.replace(
        duration=0.3, disturbances=slcp.Disturbances(velocity=0.5), success=None,
        measures={"end": slcp.measures.final("link1.angle")},
    )  # fmt: skip
    tables = []
    for chunk, block in ((None, 256), (3, 256), (None, 2)):
        policy = ddp.MPC(problem, passes=0, starts=[start], block=block)
        report = slcp.sweep(short, policy, worlds=4, cases=task.options, dtype="float64", chunk=chunk)
        tables.append(report.part("policy")["end"])
    assert len(np.unique(tables[0])) == 4
    for table in tables[1:]:
        np.testing.assert_array_equal(table, tables[0])


def test_every_start_has_a_name_of_its_own(problem):
    def shift(s):
        return None

    starts = ["shift", shift, lambda s: None, lambda s: None, ddp.Sampling(), ddp.Sampling(samples=8)]
    names = ["shift", "shift 2", "<lambda>", "<lambda> 2", "sample", "sample 2"]
    assert list(ddp.MPC(problem, starts=starts).starts) == names


def test_a_sweep_under_it_equals_rollouts(task, problem):
    short = task.replace(
        duration=0.3, disturbances=slcp.Disturbances(velocity=0.5), success=None,
        measures={"end": slcp.measures.final("ellipse.angle")},
    )  # fmt: skip
    how = {"worlds": 4, "cases": [task.options], "dtype": "float64"}
    report = slcp.sweep(short, {"mpc": ddp.MPC(problem, passes=1)}, chunk=3, **how)
    again = slcp.sweep(short, {"mpc": ddp.MPC(problem, passes=1)}, **how)
    for name in report.table:
        np.testing.assert_array_equal(report.table[name], again.table[name])
    end = report.table["end"][report.table["arm"] == "undisturbed"]
    rolled = run(ddp.MPC(problem, passes=1), task, task.start[:1])
    np.testing.assert_allclose(end, rolled.states[:, -1, 2], atol=1e-9)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"passes": -1}, "passes"),
        ({"starts": ["zero", "zero"]}, "twice"),
        ({"replan": 0}, "replan"),
        ({"replan": 76}, "horizon, 75"),
        ({"delay": 1}, "less than replan"),
        ({"starts": []}, "starts is"),
        ({"starts": ["warm"]}, "starts holds 'warm'"),
        ({"starts": ["library"]}, "a library is needed"),
        ({"improved": 3}, "improved is 3"),
        ({"sigma": -0.1}, "sigma"),
        ({"noise": [1.0, 2.0, 3.0]}, "noise is"),
        ({"options": 3}, "options"),
        ({"block": 0}, "block"),
        ({"starts": ["plan"]}, "a plan is needed"),
        ({"plan": np.zeros((75, 2))}, "plan is"),
        ({"end": 0}, "end"),
    ],
)
def test_bad_arguments_are_named(problem, given, said):
    with pytest.raises(slcp.InputError, match=said):
        ddp.MPC(problem, **given)


def test_another_mechanism_is_refused(problem):
    sim = slcp.tasks.hopper_hop().simulator()
    with pytest.raises(slcp.InputError, match="hopper"):
        sim.rollout(sim.scene.x0, policy=ddp.MPC(problem), steps=2)
    with pytest.raises(slcp.InputError, match="problem"):
        ddp.MPC("finger")
    with pytest.raises(slcp.InputError, match="start 'mine' gave"):
        run(ddp.MPC(problem, starts=[mine]), slcp.tasks.flicking_finger(), problem.dynamics.scene.x0)


def mine(situation):
    return np.zeros((3, 3))
