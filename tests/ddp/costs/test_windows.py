"""Terms of costs that count for a time: derivatives, step sizes, plans, MPC, sweeps, files, refusals."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from simulators import driven_cart
from test_costs import evaluate

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.costs import Point, Term, effort, terms
from slcp_warp.costs.terms import sum_of
from slcp_warp.ddp.library.receding import build_library
from slcp_warp.ddp.mpc.starts import Situation, chosen_starts
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.tasks import TaskError, load_task, save_task

H, N = 0.1, 12
CART = driven_cart()
PASSES_BY = [
    Term("square", 50.0, state="cart.shift", target=0.4, start=0.3, end=0.6),  # steps 3, 4, 5
    Term("square", 20.0, state="cart.vshift", start=0.75, end=0.95),  # steps 8 and 9
    Term("square", 3.0, state="cart.shift", target=-0.2, start=1.0),  # from step 10 on
    effort(0.01),
]
BY_STEP = [(0, 3, 6), (1, 8, 10), (2, 10, N), (3, 0, N)]  # term, first step, the one after its last
LAST = [Term("square", 7.0, state="cart.vshift")]


@pytest.fixture(scope="module")
def sim():
    return slcp.Simulator(CART, device="cpu", dtype="float64")


@pytest.fixture(scope="module")
def task():
    return slcp.Task("pass-by", CART, terms(CART, PASSES_BY, LAST), horizon=N)


def least(h, steps, by_step, x0=(0.0, 0.0)):
    """Controls (steps,) of least cost and the cost, by least squares: v' = v + h u/2, q' = q + h v'."""
    v = h / 2.0 * np.tril(np.ones((steps + 1, steps)), -1)
    q = h * np.tril(np.ones((steps + 1, steps + 1))) @ v
    free_v = np.full(steps + 1, x0[1])
    free_q = x0[0] + h * x0[1] * np.arange(steps + 1)
    rows, right = [], []
    signals = {"cart.shift": (q, free_q), "cart.vshift": (v, free_v), None: (np.eye(steps), np.zeros(steps))}
    spans = [(PASSES_BY[i], range(first, end)) for i, first, end in by_step]
    for term, span in [*spans, (LAST[0], [steps])]:
        matrix, free = signals[term.state]
        for k in span:
            rows.append(np.sqrt(term.weight) * matrix[k])
            right.append(np.sqrt(term.weight) * (term.target - free[k]))
    matrix, right = np.array(rows), np.array(right)
    u = np.linalg.lstsq(matrix, right, rcond=None)[0]
    return u, np.sum((matrix @ u - right) ** 2)


@pytest.mark.parametrize("points", [False, True])
def test_derivatives_are_those_of_the_terms_that_count(points):
    scene = slcp.scenes.NAMED["flicking_finger"]()
    nx, rng = 2 * scene.nv, np.random.default_rng(0)
    group = [Term(kind, 1.0 + i, state=i, target=0.1, width=0.3, start=0.05 * i, end=0.05 * i + 0.1)
             for i, kind in enumerate(("linear", "square", "cosine", "absolute", "above"))]  # fmt: skip
    group += [Term("square", 0.4, control="all", end=0.1), Term("below", 2.0, state=1, start=0.15)]
    if points:
        group += [
            Term("square", 3.0, point=Point(scene.bodies[1].name, (0.1, 0.2)), target=(0.1, -0.3), start=0.1)
        ]
    final = [Term("square", 1.0, state=2)]
    h, nodes = scene.step_size, 7
    xs, us = rng.normal(size=(2, nodes + 1, nx)), rng.normal(size=(2, nodes, scene.nu))
    found = evaluate(terms(scene, group, final), xs, us, "cpu")
    for k in range(nodes):
        counting = [replace(t, start=0.0, end=None) for t in group
                    if t.start <= k * h + 1e-9 and (t.end is None or k * h + 1e-9 < t.end)]  # fmt: skip
        part = evaluate(terms(scene, counting, final), xs[:, k : k + 2], us[:, k : k + 1], "cpu")
        for name, value in part.items():
            np.testing.assert_allclose(found[name][:, k], value[:, 0], rtol=1e-13, atol=1e-13, err_msg=name)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_plan_passes_by(dtype):
    sim = slcp.Simulator(CART, device="cpu", dtype=dtype)
    plan = ddp.solve(ddp.Problem(sim, terms(CART, PASSES_BY, LAST), N), np.zeros(2), np.zeros((N, 1)))
    u, cost = least(H, N, BY_STEP)
    tight = dtype == "float64"
    np.testing.assert_allclose(plan.us[:, 0], u, atol=1e-9 if tight else 1e-3)
    assert plan.cost == pytest.approx(cost, rel=1e-10 if tight else 1e-5)


def test_times_stay_where_steps_are_of_another_size(sim, task):
    """By a problem's parameters and by a task's scene: twice the steps, at the same times."""
    twice = [(i, 2 * first, 2 * end) for i, first, end in BY_STEP]
    twice[1] = (1, 15, 19)  # 0.75 s and 0.95 s are steps now
    u, cost = least(H / 2, 2 * N, twice)
    problem = ddp.Problem(sim, task.cost, 2 * N, sim.params.replace(step_size=H / 2))
    finer = replace(task, scene=replace(CART, step_size=H / 2), horizon=2 * N)
    for made in (problem, ddp.problem_of(finer)):
        plan = ddp.solve(made, np.zeros(2), np.zeros((2 * N, 1)))
        np.testing.assert_allclose(plan.us[:, 0], u, atol=1e-9)
        assert plan.cost == pytest.approx(cost, rel=1e-10)


def test_sampled_starts_see_what_counts_now(task):
    """One kept sampler, from plan to plan, finds what a new one does."""
    first = ddp.problem_of(task)
    problems = [first, *(replace(first, cost=first.cost.from_step(k)) for k in (3, 8))]
    options = ddp.Sampling(samples=16, iterations=3)
    (start,) = chosen_starts([options]).values()
    for step, problem in enumerate(problems):
        seed = int(np.random.default_rng((0, step)).integers(2**31))
        now = Situation(problem, np.zeros((2, 2)), 0.0, np.arange(2), None, (0, step), np.ones(1), None)
        np.testing.assert_array_equal(start(now), ddp.sample(problem, now.x, options=options, seed=seed).us)


@pytest.mark.parametrize("starts", [["shift", "zero"], [ddp.Sampling(samples=8, iterations=2)]])
def test_in_mpc_they_are_times_of_the_run(sim, task, starts):
    """To the run's end, without disturbances, MPC goes on with the best plan (Bellman); from a late start on
    with the best one from there.
    """
    policy = ddp.MPC(ddp.problem_of(task), passes=4, starts=starts, end=N, replan=2)
    run = sim.rollout(np.zeros((2, 2)), policy=policy, steps=N, record="controls")
    u, _ = least(H, N, BY_STEP)
    np.testing.assert_allclose(run.controls[0, :, 0], u, atol=1e-8)
    assert policy.failures == 0


def test_in_mpc_of_sent_controls_they_count_from_when_these_act(sim, task):
    """Two steps late: two without a control, then the best that is left."""
    lag = 2
    policy = ddp.MPC(ddp.problem_of(task), passes=4, end=N, lag=lag)
    policy.begin(sim, np.arange(1))
    x, sent = np.array([[0.1, -0.2]]), [np.zeros((1, 1))] * lag
    for k in range(N):
        sent.append(policy.act(x, k * H, np.arange(1)))
        x = np.asarray(sim.step(x, sent[k]).state)
    later = [(i, max(first - lag, 0), end - lag) for i, first, end in BY_STEP]
    u, _ = least(H, N - lag, later, (0.1 - 0.2 * H * lag, -0.2))
    np.testing.assert_allclose(np.ravel(sent[lag:N]), u, atol=1e-8)


def test_a_plan_of_late_controls_counts_from_the_run(task):
    late = replace(task, disturbances=slcp.Disturbances(delay=2 * H))
    u, _ = least(H, N - 2, [(i, max(first - 2, 0), end - 2) for i, first, end in BY_STEP])
    plan = ddp.plan(late, 1).best
    np.testing.assert_allclose(plan.us[2:, 0], u, atol=1e-8)


def test_a_sweep_counts_at_the_times_of_its_own_steps(task):
    """The running cost of a cart that rests at 0: squares of targets, at the steps of each case."""
    watched = replace(task, measures={"price": slcp.measures.cost()})
    found = slcp.sweep(
        watched,
        {"rest": slcp.policies.Linear(np.zeros((1, 2)), CART.x0, [0.0])},
        worlds=2,
        step_sizes=(H, H / 4),
    )
    for h, first, last in ((H, 3, 2), (H / 4, 12, 8)):
        value = found.part("rest", step_size=h)["price"]
        np.testing.assert_allclose(value, first * 50.0 * 0.4**2 + last * 3.0 * 0.2**2, rtol=1e-6)


def test_a_sweep_of_steps_that_a_time_has_not_got(task):
    """No matter where no measure is of the cost, and said before the first world runs where one is."""
    short = terms(CART, [Term("square", 1.0, state="cart.shift", start=0.3, end=0.4)])
    rest = slcp.policies.Linear(np.zeros((1, 2)), CART.x0, [0.0])
    own = replace(task, cost=short, measures={"shift": slcp.measures.final("cart.shift")})
    assert len(slcp.sweep(own, rest, worlds=2, step_sizes=(H, 0.24)).summary) > 1
    seen = []
    with pytest.raises(
        ArgumentError, match="is 0.3 s, Term.end 0.4 s; a step of 0.24 s between them is needed"
    ):
        slcp.sweep(replace(own, measures={"price": slcp.measures.cost()}), rest, worlds=2,
                   step_sizes=(H, 0.24), progress=lambda *done: seen.append(done))  # fmt: skip
    assert not seen


def test_what_a_cost_asks_for_at_the_runs_end(task):
    """Of terms that count there; others are of the way."""
    for end, asked in ((None, True), (N * H, True), (5.0, True), ((N - 1) * H, False)):
        term = Term("square", 1.0, state="cart.shift", target=0.7, end=end)
        goal = replace(task, cost=terms(CART, [term])).goal()
        assert (goal is not None) == asked and (goal is None or goal[0] == 0.7)


def test_files_tell_times(task, tmp_path):
    pointed = replace(
        task, cost=terms(CART, [*PASSES_BY, Term("square", 1.0, point=Point("cart"), end=0.5)], LAST)
    )
    for each in (task, pointed):
        path = tmp_path / "task.json"
        save_task(each, path)
        again = load_task(path)
        assert again.cost.make is each.cost.make and again.cost.windows == each.cost.windows
        np.testing.assert_array_equal(again.cost.weights, each.cost.weights)
    told = tmp_path / "told.toml"
    told.write_text("""format = "slcp-task"
version = 2
name = "told"
scene = "flicking_finger"
horizon = 50
cost = { running = [{ kind = "square", weight = 1.0, state = 2, start = 0.5, end = 1.0 }] }
""")
    assert load_task(told).cost.windows.spans == ((0.5, 1.0),)


def test_what_cannot_count_is_refused(sim, task):
    shift = Term("square", 1.0, state="cart.shift", start=0.3)
    with pytest.raises(ArgumentError, match=r"final\[0\] has start 0.3 s and end None"):
        terms(CART, [], [shift])
    with pytest.raises(ArgumentError, match="Term.end is 0.2"):
        replace(shift, end=0.2)
    with pytest.raises(
        ArgumentError, match="is 0.31 s, Term.end 0.39 s; a step of 0.1 s between them is needed"
    ):
        terms(CART, [replace(shift, start=0.31, end=0.39)])
    with pytest.raises(
        TaskError, match="Term.start is 1.2 s; less is needed, as plans and runs end at 1.2 s"
    ):
        slcp.Task("late", CART, terms(CART, [replace(shift, start=1.2)]), horizon=N)
    with pytest.raises(ArgumentError, match="a term for a time, which only a scene's cost has"):
        sum_of(["cart.shift"], [], [shift])
    with pytest.raises(ArgumentError, match="chains begin anew"):
        build_library(ddp.problem_of(task), CART.x0, 4)
    with pytest.raises(ArgumentError, match="terms for a time, and params 2 step sizes"):
        ddp.Problem(sim, task.cost, N, sim.params.replace(step_size=[0.1, 0.2]))
    table = sim.parameter_array(sim.params, 1)
    with pytest.raises(ArgumentError, match="terms for a time, and params 0 step sizes"):
        ddp.Problem(sim, task.cost, N, wp.clone(table))
    with pytest.raises(TaskError, match="begins 0.3 s after its plan does, which is no data"):
        save_task(replace(task, cost=task.cost.from_step(3)), "begun.json")
    moved = task.cost.weights.copy()
    moved[7] += 1.0
    with pytest.raises(ArgumentError, match="says what other weights are of"):
        task.cost.with_weights(moved)


def test_other_weights_keep_their_times(sim, task):
    heavier = task.cost.with_weights(np.where(task.cost.fixed, task.cost.weights, task.cost.weights * 2.0))
    assert heavier.windows == task.cost.windows and not heavier.steady
    later = heavier.from_step(4)
    assert later.make is heavier.make  # nothing is compiled
    np.testing.assert_array_equal(later.weights[[7, 8]], [-1.0, 2.0])
    np.testing.assert_array_equal(later.in_steps_of(H / 2).weights[[7, 8]], [-2.0, 4.0])
