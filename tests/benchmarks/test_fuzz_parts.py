"""`slcp bench fuzz`: worlds that are followed, mechanisms that touch all over, heaps, relays, their cases."""

import dataclasses

import numpy as np
import pytest
import warp as wp
from simulators import scene as named
from sweeps import FINGER

import slcp_warp as slcp
from slcp_warp.kernels.generic.friction.direct import MANY
from slcp_warp.kernels.generic.topology import items_first
from slcp_warp.scripts.benchmarks.fuzz import case as cases
from slcp_warp.scripts.benchmarks.fuzz import swept
from slcp_warp.scripts.benchmarks.fuzz.command import tasks_of
from slcp_warp.scripts.benchmarks.fuzz.differences import STEPS, compare
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds
from slcp_warp.scripts.benchmarks.fuzz.judge import Outcome
from slcp_warp.scripts.benchmarks.fuzz.judged import judged, parameters, simulator
from slcp_warp.scripts.benchmarks.fuzz.parts import PARTS
from slcp_warp.scripts.benchmarks.fuzz.problem import Problem, Truth
from slcp_warp.scripts.benchmarks.fuzz.report import rows_of, unsolved_lines
from slcp_warp.scripts.benchmarks.fuzz.rolled import Stepped, follow, roll
from slcp_warp.scripts.benchmarks.fuzz.run import run_task
from slcp_warp.scripts.benchmarks.fuzz.shrink import steps as fewer_steps
from slcp_warp.scripts.benchmarks.fuzz.tasks import Failure, Task
from slcp_warp.scripts.benchmarks.fuzz.verdicts import (
    HOLDS,
    LARGE,
    NONE,
    REASONS,
    SILENT,
    SOLVABLE,
    WRONG,
    Verdicts,
    reason_of,
)  # fmt: skip

HARD = slcp.Options(residual="hard")
ROLLED = Task(1, 5, "generic", per_chunk=6, part="rollouts")


def rolled(task=ROLLED, options=HARD, dtype="float64"):
    """The worlds of a task, their controls, what steps them, and their rollout."""
    scene = task.make_scene()
    worlds, us = task.worlds(0, scene), task.controls(0, scene)
    sim = simulator(scene, options, dtype, task.strategy)
    return worlds, us, sim, roll(sim, worlds, us)


@pytest.mark.parametrize(
    ("part", "scene"),
    [("rollouts", 5), ("auto", 8), ("heaps", 1), ("heaps", 10), ("bounces", 3), ("overlaps", 9)],
)
def test_small_runs_of_the_parts_have_no_silent_failure(part, scene):
    task = Task(1, scene, "generic", residuals=("hard",), per_chunk=4, part=part)
    assert items_first(task.make_scene().structure) == (part == "auto") and task.steps > 10
    tally = run_task(task)
    assert [f for f in tally.failures if f.verdict in (SILENT, WRONG)] == []
    counts = {
        name: sum(n for key, n in tally.counts.items() if key[-1] == name) for name in ("worlds", "SOLVED")
    }
    assert counts["worlds"] > 4 * 6 * task.steps / 3  # six methods; some worlds end before
    assert counts["SOLVED"] > 0.5 * counts["worlds"]


@pytest.mark.parametrize("share", [0.0, 0.9])
def test_what_bounces_less_than_it_can_is_noticed(share):
    """Pairs that close and that nothing keeps from bouncing, with less restitution than they have."""
    task = Task(1, 0, "generic", per_chunk=200, part="bounces")
    scene = task.make_scene()
    worlds, sim = task.worlds(0, scene), simulator(scene, HARD, "float64", "generic")
    right, done = judged(worlds, sim)
    bounces = right.problem.bounces.any(1) & (done.impulse > 0.0).any(1)
    bounces &= (np.asarray(done.status) == slcp.Status.SOLVED) & (right.verdict == HOLDS)
    less = dict(worlds.numbers, restitution=share * worlds.numbers["restitution"])
    other = sim.step(worlds.x, worlds.u if sim.nu else None, parameters(sim, less))
    found, _ = judged(worlds, sim, out=Outcome.of(other))
    differs = bounces & (np.abs(other.state - done.state) > 1e-6).any(1) & (np.asarray(other.status) == 0)
    assert differs.sum() > 5 and (found.verdict[differs] == SILENT).mean() > 0.9  # some may have no room
    assert (right.verdict != SILENT).all() and (found.verdict[~right.problem.bounces.any(1)] != SILENT).all()


@pytest.mark.parametrize("seed", [5, 6])
def test_what_bounces_is_not_given_up_for_being_hard_to_solve(seed):
    """Pairs with masses of 1:1e6 and more, and deep ones, in single precision: they bounced less than they
    can, SOLVED.
    """
    task = Task(seed, 0, "generic", residuals=("hard",), per_chunk=40, part="bounces")
    assert [f for f in run_task(task).failures if f.verdict in (SILENT, WRONG)] == []


@pytest.mark.parametrize("friction", ["anitescu", "coulomb"])
def test_why_a_world_is_unsolved_is_told_by_solutions_of_its_own(friction):
    """What is INFEASIBLE or JAMMED has none, what is SOLVED has one."""
    options, task = dataclasses.replace(HARD, friction=friction), Task(1, 12, "generic", per_chunk=60)
    scene = task.make_scene()
    verdicts, _ = judged(task.worlds(0, scene), simulator(scene, options, "float64", "generic"))
    told = np.array([reason_of(verdicts.part(np.array([i]))) for i in range(60)])
    solved = verdicts.out.status == slcp.Status.SOLVED
    refuted = np.isin(verdicts.out.status, (slcp.Status.INFEASIBLE, slcp.Status.JAMMED))
    assert solved.sum() > 20 and set(told[solved]) <= {SOLVABLE, LARGE}
    assert refuted.sum() > 10 and set(told[refuted]) == {NONE}


def test_what_is_looked_into_is_counted():
    task = Task(90013, 0, "generic", residuals=("hard",), per_chunk=300, explains=True)
    lines = unsolved_lines(rows_of(run_task(task)))
    table = {(line[1], line[2]): dict(zip(lines[0], line)) for line in lines[1:]}
    row = table["coulomb", "float64"]
    looked, counts = int(row["looked into"]), [int(row[reason]) for reason in REASONS]
    assert 0 < looked == sum(counts) <= int(row["NOT_CONVERGED"])
    assert float(row["least"]) <= float(row["solved"]) < 100.0


@pytest.mark.full
@pytest.mark.parametrize("part,least,most", [("towers", MANY, 70), ("piles", 20, MANY)])
def test_a_small_run_of_many_bodies_has_no_silent_failure(part, least, most):
    task = Task(1, 0, "generic", residuals=("hard",), per_chunk=2, part=part)
    assert least < task.make_scene().structure.nb <= most
    tally = run_task(task)
    assert [f for f in tally.failures if f.verdict in (SILENT, WRONG)] == []
    assert sum(n for key, n in tally.counts.items() if key[-1] == "SOLVED") > 2 * 6


def test_differences_do_not_judge_across_a_kink():
    """|x - x0| at a distance of 1e-9: central differences of all lengths agree on 0."""
    steps = np.array(STEPS)[:, None, None]

    def slopes(f, x):
        return (f(x + steps) - f(x)) / steps, (f(x - steps) - f(x)) / -steps

    for f, slope, sure in ((np.abs, 1.0, False), (lambda x: x + 0.5 * x * x, 1.0 + 1e-9, True)):
        error, trusted = compare(np.full((1, 1), slope), *slopes(f, np.full((1, 1), 1e-9)))
        assert trusted[0] == sure and (not sure or error[0] < 1e-6)


def test_differences_see_a_ripple_that_long_steps_step_over():
    """The slope is 1,001 at 0, but 1,000 to all steps above 1e-5, which agree."""
    steps = np.array(STEPS)[:, None, None]

    def ripple(x):
        return 1e3 * x + x * np.exp(-((x / 3e-6) ** 2))

    up, down = ripple(steps) / steps, ripple(-steps) / -steps
    for slope, right in ((1001.0, True), (1000.5, False)):
        error, trusted = compare(np.full((1, 1), slope), up, down)
        assert trusted[0] and (error[0] < 1e-5) == right


def test_differences_do_not_blame_a_row_that_enters_within_the_shortest_steps():
    """50 max(x, 0), rounded off within 1e-6 with a slope of 35 at 0: steps from 1e-5 on agree on 25, and one
    of 1e-7 is off by 3e-3.
    """
    steps = np.array(STEPS)[:, None, None]

    def entering(x):
        y = x / 1e-6
        return 5e-5 * (np.logaddexp(0.0, y) + 0.2 * y * np.exp(-y * y))

    def slopes(side):
        return (entering(side * steps) - entering(0.0)) / (side * steps)

    for slope, right in ((35.0, True), (35.01, False)):
        error, trusted = compare(np.full((1, 1), slope), slopes(1.0), slopes(-1.0))
        assert trusted[0] and (error[0] < 1e-5) == right


def test_derivatives_of_the_common_kernels_are_compared():
    task = Task(1, 7, "generic", per_chunk=40, part="derivatives")
    (options, _), tally = task.methods()[0], run_task(task)
    assert options.residual == "hard" and tally.failures == []
    for what in ("derivatives", "gradients"):
        assert sum(n for key, n in tally.counts.items() if key[-1] == f"compared {what}") >= 8


@pytest.mark.slow
@pytest.mark.parametrize("scene", [1, 3])
def test_limits_that_meet_are_drawn_and_no_world_is_silent(scene):
    task = Task(1003, scene, "generic", residuals=("hard", "rem-logistic"), per_chunk=40, part="locked")
    worlds = task.worlds(0, task.make_scene())
    meets = (worlds.numbers["lower"] == worlds.numbers["upper"]).any(1)
    tally = run_task(task)
    assert meets.mean() > 0.2 and tally.failures == []
    assert sum(n for key, n in tally.counts.items() if key[-1] == "SOLVED") > 0.3 * 40 * 10


@pytest.mark.slow
def test_a_law_whose_scale_has_no_digits_is_not_solved():
    """Four bodies, a condition of 6e11: D of a limit is off by 3e-5, and so was w, at 250 times the bound."""
    task = Task(81, 3, "generic", per_chunk=40, part="auto")
    scene = task.make_scene()
    worlds, us = task.worlds(0, scene).part([31, 32]), task.controls(0, scene)[[31, 32]]
    run = roll(sim := simulator(scene, slcp.Options(), "float64", "generic"), worlds, us)
    assert run.status.tolist() == [slcp.Status.SOLVED, slcp.Status.NOT_CONVERGED]
    for piece in follow(run, worlds, us).pieces():
        found, _ = judged(piece.worlds, sim, None, out=piece.out)
        assert SILENT not in found.verdict


@pytest.mark.slow
def test_a_scale_that_no_answer_hangs_on_may_lack_digits():
    """Rows that press by many sigma have the w that they have with any D: conditions of 4e4 to 1e6."""
    task, ill = Task(82, 7, "generic"), [164, 168, 182, 207, 312, 383, 442, 443, 484]
    scene = task.make_scene()
    worlds, us = task.worlds(0, scene).part(ill), task.controls(0, scene)[ill]
    run = roll(sim := simulator(scene, slcp.Options(), "float64", "generic"), worlds, us)
    assert (run.status == slcp.Status.SOLVED).all()
    for piece in follow(run, worlds, us).pieces():
        found, _ = judged(piece.worlds, sim, None, out=piece.out)
        assert (found.verdict == HOLDS).all() and found.problem.condition.min() > 4e4


def test_every_part_has_tasks_that_draw_worlds():
    for part, what in PARTS.items():
        tasks = tasks_of(3, 20_000, 2, (), part)
        assert {task.strategy for task in tasks} == set(what.strategies)
        task = dataclasses.replace(tasks[-1], per_chunk=5)
        scene = task.make_scene()
        worlds, again = task.worlds(0, scene), task.worlds(0, task.make_scene())
        assert np.array_equal(worlds.x, again.x) and worlds.x.shape == (5, 2 * scene.nv)
        assert task.controls(0, scene).shape == (5, task.steps, scene.nu)
        other = dataclasses.replace(task, seed=4)
        assert not np.array_equal(other.worlds(0, other.make_scene()).x[:, :1], worlds.x[:, :1])


def test_a_step_that_is_changed_is_found_where_it_is():
    """The state after it is not its own, and the next one starts from there; no other is silent."""
    worlds, us, sim, run = rolled()
    assert (run.status == slcp.Status.SOLVED).any()
    world, step = int(np.flatnonzero(run.status == slcp.Status.SOLVED)[0]), 7
    states = np.array(run.states)
    states[world, step + 1, 0] += 1e-6
    steps = follow(dataclasses.replace(run, states=states), worlds, us)
    found, _ = judged(steps.worlds, sim, out=steps.out)
    silent = found.verdict == SILENT
    assert {(int(w), int(k)) for w, k in zip(steps.world[silent], steps.step[silent])} == {
        (world, step),
        (world, step + 1),
    }


def test_a_world_that_fails_ends_with_the_step_that_does():
    scene = named("opposing_limits")
    numbers = {name: np.repeat(v[None], 3, 0) for name, v in scene.default_parameters().items()}
    x, us = np.tile(scene.x0, (3, 1)), np.zeros((3, 8, 1))
    us[1, 5] = np.nan
    worlds = Worlds(numbers, x, us[:, 0], np.zeros(3, int))
    sim = simulator(scene, HARD, "float64", "generic")
    run = roll(sim, worlds, us)
    assert run.status.tolist() == [0, slcp.Status.NONFINITE, 0]
    steps = follow(run, worlds, us)
    assert np.bincount(steps.world).tolist() == [8, 6, 8]
    assert steps.out.status[steps.world == 1].tolist() == [0] * 5 + [slcp.Status.NONFINITE]
    np.testing.assert_array_equal(steps.worlds.x[steps.step == 3], run.states[:, 3])


def test_relays_are_judged():
    """The finger from states where most worlds need the full kernel for some step."""
    rng, count = np.random.default_rng(3), 12
    x = FINGER.x0 + rng.standard_normal((count, 6)) * (0.3, 0.3, 3.0, 1.0, 1.0, 1.0)
    numbers = {name: np.repeat(v[None], count, 0) for name, v in FINGER.default_parameters().items()}
    us = rng.standard_normal((count, 40, 2))
    worlds = Worlds(numbers, x, us[:, 0], np.zeros(count, int))
    sim = simulator(FINGER, slcp.Options(scaling="none"), "float64", "relay")
    assert sim.kernels.fast_path and sim.dtype is wp.float64
    steps = follow(roll(sim, worlds, us), worlds, us)
    found, _ = judged(steps.worlds, sim, out=steps.out)
    assert len(steps.world) == 480 and (found.verdict == HOLDS).all()
    assert (steps.out.impulse > 1e-3).any(1).mean() > 0.05


def test_a_followed_case_comes_back_and_gets_shorter(tmp_path):
    worlds, us, _, run = rolled()
    world, step = int(np.flatnonzero(run.status == slcp.Status.SOLVED)[0]), 6
    failure = Failure(ROLLED, world, HARD, "float64", "far", SILENT, "planted", 1.0, step)
    case = cases.case_of(failure)
    np.testing.assert_allclose(case.states()[: step + 2], run.states[world, : step + 2], rtol=0, atol=1e-12)
    _, done = case.run()
    assert done is None and case.verdict == (HOLDS, "")
    cases.save_case(case, tmp_path / "case.json")
    back = cases.load_case(tmp_path / "case.json")
    np.testing.assert_array_equal(back.u, us[world, : step + 1])
    np.testing.assert_array_equal(back.states(), case.states())
    shorter = [make() for make in fewer_steps(case)]
    assert [len(c.u) for c in shorter] == [1, step + 1 - step // 2, step]
    np.testing.assert_array_equal(shorter[0].x, case.states()[step])


def test_cases_of_auto_contacts_list_them():
    task = Task(1, 8, "generic", per_chunk=4, part="auto")
    failure = Failure(task, 1, HARD, "float64", "far", SILENT, "planted", 1.0, 2)
    case = cases.case_of(failure)
    assert len(case.scene.contacts) == len(task.make_scene().all_contacts)
    assert items_first(case.scene.structure) and case.verdict[0] in (HOLDS, "status")


def test_points_in_one_place_have_any_normal():
    """A point that rests on another one ends 3e-16 m away, in a direction that is a rounding."""
    bodies = (slcp.Body("a", 1.0, 0.1, joint="free"),)
    shapes = (slcp.Shape("tip", "a", "disc", 0.0, offset=(0.3, 0.0)), slcp.Shape("post", None, "disc", 0.0))
    scene = slcp.Scene("points", bodies, shapes, (slcp.Contact("tip", "post"),))
    numbers = {name: np.repeat(v[None], 2, 0) for name, v in scene.default_parameters().items()}
    for apart, unclear in ((3e-16, True), (1e-6, False)):
        x = np.array([[-0.3, apart, 0.0, 0.0, -1.0, 0.0]] * 2)
        truth = Truth(scene, Worlds(numbers, x, np.zeros((2, 0)), np.zeros(2, int)))
        assert (Problem(truth, truth.drive(), HARD.method, "float64").unclear == unclear).all()


@pytest.mark.parametrize(("dtype", "loops"), [("float64", False), ("float32", True)])
def test_what_is_followed_starts_where_it_says(dtype, loops):
    """In float32 generic kernels are followed by steps: their rollouts go on in double precision."""
    worlds, us, sim, run = rolled(dtype=dtype)
    assert isinstance(run, Stepped) == loops
    steps = follow(run, worlds, us)
    again = sim.rollout(worlds.x.astype(dtype), us.astype(dtype), parameters(sim, worlds.numbers))
    np.testing.assert_array_equal(run.status, again.status)
    np.testing.assert_allclose(run.states[:, 1], again.states[:, 1], rtol=1e-6, atol=1e-6)  # two kernels
    assert (steps.worlds.x == steps.worlds.x.astype(dtype)).all()


def slider(**fields):
    """A slider of 1 kg straight above ground that its tip, a point, touches at q = 0; without gravity."""
    body = slcp.Body("a", 1.0, 0.1, joint="prismatic", axis=(0.0, 1.0), **fields)
    ground = slcp.Shape("g", None, "halfplane", offset=(0.0, 0.7), angle=np.pi / 2)
    tip = slcp.Shape("tip", "a", "disc", 0.0, offset=(0.0, 0.7))
    return slcp.Scene("slider", (body,), (tip, ground), (slcp.Contact("g", "tip"),), gravity=(0.0, 0.0))


def verdict_of(scene, q, v, after, impulse, dtype):
    """Of a step from (q, v) to the velocity `after`, with an impulse."""
    numbers = {name: value[None] for name, value in scene.default_parameters().items()}
    truth = Truth(scene, Worlds(numbers, np.array([[q, v]]), np.zeros((1, 0)), np.zeros(1, int)))
    p = Problem(truth, truth.drive(), HARD.method, dtype)
    x = np.array([[q + scene.step_size * after, after]])
    out = Outcome(x, np.array([[impulse]]), p.rate * scene.step_size, np.zeros(1, int))
    return str(Verdicts(p, out, lambda keep: p).verdict[0])


@pytest.mark.parametrize(("v", "held"), [(-4.7e-44, HOLDS), (-4.7e-30, SILENT)])
def test_numbers_below_the_smallest_normal_keep_no_digits(v, held):
    """A slider that its damper slows down for ever: in float32 its speed ends at a few units of 1.4e-45."""
    assert verdict_of(slider(damping=50.0), 0.5, v, 0.65 * v, 0.0, "float32") == held
    assert verdict_of(slider(damping=50.0), 0.5, v, v / 1.5, 0.0, "float32") == HOLDS


@pytest.mark.parametrize(("push", "held"), [(1e-8, HOLDS), (1e-4, SILENT)])
def test_a_gap_that_is_a_rounding_may_push(push, held):
    """A tip .7 m from where gaps are worked out, 1e-9 m above ground: in float32 it may be inside by 1e-8."""
    speed = push / slider().step_size
    assert verdict_of(slider(), 1e-9, 0.0, speed, speed, "float32") == held
    assert verdict_of(slider(), 1e-9, 0.0, speed, speed, "float64") == SILENT


def cart():
    """A driven cart between limits that it meets."""
    body = slcp.Body("cart", 1.0, 0.1, joint="prismatic", lower=-0.1, upper=0.1, damping=0.5)
    return slcp.Scene("cart", (body,), actuators=(slcp.Actuator("cart"),), gravity=(0.0, 0.0))


def test_a_sweep_is_a_loop(monkeypatch):
    """Under a law and kicks; of a loop without its kicks, or with the law of another place, it is not."""
    scene, rng, count = cart(), np.random.default_rng(0), 12
    numbers = {name: np.repeat(v[None], count, 0) for name, v in scene.default_parameters().items()}
    numbers["mass"] = rng.uniform(0.5, 2.0, (count, 1))
    x = rng.uniform(-0.05, 0.05, (count, 2)) * (1.0, 40.0)
    worlds, us = Worlds(numbers, x, np.zeros((count, 1)), np.zeros(count, int)), np.full((count, 30, 1), 3.0)
    equal, trusted = swept.compare(scene, worlds, us, HARD, "specialised")
    assert equal.all() and trusted.mean() > 0.9
    monkeypatch.setattr(swept, "KICKS", (0.3, 0.75))
    kept = swept._loop
    monkeypatch.setattr(
        swept, "_loop", lambda sim, params, x, law, kicks, *more: kept(sim, params, x, law, {}, *more)
    )
    equal, _ = swept.compare(scene, worlds, us, HARD, "specialised")
    assert equal.mean() < 0.5
    monkeypatch.setattr(swept, "_loop", parts_by_a_rounding(kept))
    equal, trusted = swept.compare(scene, worlds, us, HARD, "specialised")
    assert not equal.any() and not trusted.any()
    given = []
    whole, sweep = swept._kicks(x[3], 1), slcp.sweep
    monkeypatch.setattr(
        slcp, "sweep", lambda *a, **more: given.append(more["worlds"].kicks) or sweep(*a, **more)
    )
    swept.compare(scene, worlds.part(3), us[[3]], HARD, "specialised")
    np.testing.assert_array_equal(given[0], whole[None])


def parts_by_a_rounding(loop):
    """Loops that end on one side, or on either one where every step is rounded, as points that meet do."""

    def ends(sim, params, x, law, kicks, steps, rounded=None):
        after, status = loop(sim, params, x, law, {}, steps)
        side = 1.0 if rounded is None else rounded.choice([-1.0, 1.0], (len(x), 1))
        return after + side, status

    return ends
