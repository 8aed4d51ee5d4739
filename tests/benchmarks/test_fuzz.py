"""`slcp bench fuzz`: its oracle against the tests' own, what its judge and proofs notice, its minimiser."""

import dataclasses
import math

import numpy as np
import pytest
from oracle import Oracle, residual, solve_hard

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp.scripts.benchmarks.fuzz import case as cases
from slcp_warp.scripts.benchmarks.fuzz.draws import CLASSES, Worlds, draw_worlds
from slcp_warp.scripts.benchmarks.fuzz.judge import Outcome, judge
from slcp_warp.scripts.benchmarks.fuzz.problem import Problem, Truth
from slcp_warp.scripts.benchmarks.fuzz.proofs import coulomb_solution, least_motion, widest_opening
from slcp_warp.scripts.benchmarks.fuzz.run import run_task
from slcp_warp.scripts.benchmarks.fuzz.shrink import shrink
from slcp_warp.scripts.benchmarks.fuzz.structures import baked, random_scene, random_tendons
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task
from slcp_warp.scripts.benchmarks.fuzz.verdicts import SILENT, WRONG, Verdicts

HARD = slcp.Options(residual="hard")
COULOMB = slcp.Options(residual="hard", friction="coulomb")


def drawn(seed, worlds=20, kind=random_scene):
    """A random scene, and worlds of it."""
    rng = np.random.default_rng(seed)
    scene = kind(rng, f"scene{seed}")
    return scene, draw_worlds(rng, scene, worlds)


@pytest.mark.parametrize(
    ("seed", "kind"), [*((i, random_scene) for i in range(12)), *((i, random_tendons) for i in range(4))]
)
def test_the_oracle_agrees_with_the_tests_own(seed, kind):
    """Closed forms of a recursion against complex steps of poses; search against search."""
    scene, worlds = drawn(seed, kind=kind)
    truth, other = Truth(scene, worlds), Oracle(scene, **worlds.numbers)
    problem = other.problem(worlds.x, worlds.u)
    drag = np.einsum("bij,bj->bi", truth.motion.damping, truth.v)
    size = truth.motion.size + np.abs(drag) + 1e-30
    scale = np.abs(problem["M"]).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(truth.drive().h_mass / scale, problem["M"] / scale, atol=1e-12)
    force = other.force(truth.q, truth.v, worlds.u)
    body = size.max(1, keepdims=True)
    np.testing.assert_allclose((truth.motion.force - drag) / body, force / body, atol=1e-9)
    mine = Problem(truth, truth.drive(), HARD.method, "float64")
    sure = (problem["margin"] > 1e-6) & ~mine.unclear.any(1)
    assert sure.mean() > 0.9
    gap = mine.near * truth.h[:, None]  # of pairs that bounce, too
    np.testing.assert_allclose(gap[sure], problem["d"][sure], atol=1e-10)
    loose = 1e-8 * (1.0 + truth.touches.bend.max(1, initial=0.0)[sure, None, None])
    assert (np.abs(mine.jac - problem["J"])[sure] <= loose).all()


@pytest.mark.parametrize(
    ("seed", "kind"), [(0, random_scene), (1, random_scene), (2, random_scene), (0, random_tendons)]
)
def test_the_baked_scene_of_a_world_has_its_numbers(seed, kind):
    scene, worlds = drawn(seed + 50, 5, kind)
    numbers = {name: value[2] for name, value in worlds.numbers.items()}
    alone = baked(scene, numbers).default_parameters()
    present = {"lower": scene.structure.lower, "upper": scene.structure.upper}
    for name, value in numbers.items():
        if name in present:
            value, alone[name] = value * present[name], alone[name] * present[name]
        if name == "radius":
            planes = [shape.kind == "halfplane" for shape in scene.shapes]
            value, alone[name] = value[np.logical_not(planes)], alone[name][np.logical_not(planes)]
        if name == "upper":
            value = np.maximum(value, alone["lower"])
        if name != "sigma":
            np.testing.assert_array_equal(alone[name], value, err_msg=name)


def test_classes_are_what_they_say():
    """In the scenes that can be free of contact and can touch; some overlap or miss in every place tried."""
    apart, shares = 0, []
    for seed in range(16):
        scene, worlds = drawn(seed, 100)
        if scene.structure.pairs:
            gap = Truth(scene, worlds).touches.gap.min(1)
            far, touching = (gap[worlds.kind == CLASSES.index(name)] for name in ("far", "touching"))
            apart += np.median(far) > 0.05
            if np.median(far) > 0.05:
                shares.append(np.mean(np.abs(touching) < 0.02))
    assert apart >= 3
    assert np.median(shares) > 0.5, shares


def block(mu=0.5):
    """A body on two points above ground, with a limit, worlds that enter it and what is right for them."""
    shapes = (
        Shape("left", "block", "disc", 0.0, (-0.2, -0.1)), Shape("right", "block", "disc", 0.0, (0.2, -0.1)),
        Shape("ground", None, "halfplane", 0.0, (0.0, 0.0), math.pi / 2),
    )  # fmt: skip
    contacts = (Contact("ground", "left", mu), Contact("ground", "right", mu))
    bodies = (Body("block", 2.0, 0.1, joint="free", upper=(0.4, None, None)),)
    scene = Scene("block", bodies, shapes, contacts)
    rng = np.random.default_rng(0)
    count = 12
    numbers = {name: np.repeat(v[None], count, 0) for name, v in scene.default_parameters().items()}
    x = np.c_[0.39 + 0.0 * rng.random(count), 0.1 + 0.001 * rng.random(count), 0.001 * rng.random(count),
              2.0 + rng.random(count), -3.0 - rng.random(count), rng.random(count)]  # fmt: skip
    return scene, Worlds(numbers, x, np.zeros((count, 0)), np.ones(count, int))


def right_answer(scene, worlds):
    """The tests' own hard solution as the package would give it."""
    oracle = Oracle(scene, **worlds.numbers)
    problem = oracle.problem(worlds.x)
    v, impulse = solve_hard(problem)
    assert np.abs(residual(problem, v, impulse, hard=True)[1]).max() < 1e-10
    x = np.concatenate([worlds.x[:, :3] + 0.01 * v, v], 1)
    return Outcome(x, impulse, problem["d"], np.zeros(len(x), int))


def verdicts(scene, worlds, out, options=HARD):
    """The judge's verdicts on an outcome."""

    def pose(keep):
        truth = Truth(scene, worlds if keep is None else worlds.part(keep))
        return Problem(truth, truth.drive(), options.method, "float64")

    return Verdicts(pose(None), out, pose)


def with_velocity(scene, worlds, out, impulse):
    """An outcome with other impulses and the velocities and positions that follow from them."""
    truth = Truth(scene, worlds)
    p = Problem(truth, truth.drive(), HARD.method, "float64")
    push = np.linalg.solve(p.drive.h_mass, np.einsum("bri,br->bi", p.jac, impulse)[..., None])[..., 0]
    v = p.drive.free + push
    return dataclasses.replace(out, impulse=impulse, x=np.concatenate([worlds.x[:, :3] + 0.01 * v, v], 1))


def test_what_is_right_holds():
    scene, worlds = block()
    found = verdicts(scene, worlds, right_answer(scene, worlds))
    assert (found.verdict == "holds").all() and found.worst.max() < 0.1


def missing_row(scene, worlds, out):
    impulse = out.impulse.copy()
    impulse[:, 1:3] = 0.0
    return with_velocity(scene, worlds, out, impulse)


def entering(scene, worlds, out):
    return dataclasses.replace(out, x=np.c_[worlds.x[:, :3] + 0.01 * worlds.x[:, 3:], worlds.x[:, 3:]])


PLANTED = {
    "a wrong impulse": lambda s, w, o: dataclasses.replace(o, impulse=o.impulse * (1.0 + 1e-6)),
    "a doubled impulse": lambda s, w, o: dataclasses.replace(o, impulse=2.0 * o.impulse),
    "a doubled push": lambda s, w, o: with_velocity(s, w, o, 2.0 * o.impulse),
    "a missing row": missing_row,
    "a step without contact": entering,
    "a pull": lambda s, w, o: with_velocity(s, w, o, o.impulse - 0.5),
    "another position": lambda s, w, o: dataclasses.replace(o, x=o.x + 1e-9 * np.eye(6)[0]),
    "another gap": lambda s, w, o: dataclasses.replace(o, gap=o.gap + 1e-9),
    "no number": lambda s, w, o: dataclasses.replace(o, x=o.x * np.nan),
    "no number in the impulses": lambda s, w, o: dataclasses.replace(o, impulse=o.impulse + np.inf),
}


@pytest.mark.parametrize("what", PLANTED)
def test_the_judge_notices(what):
    scene, worlds = block()
    out = PLANTED[what](scene, worlds, right_answer(scene, worlds))
    found = verdicts(scene, worlds, out)
    assert (found.verdict == SILENT).all(), (what, found.verdict, found.errors.strict)


def guide(angle=0.0734, mu=0.5, depth=1e-3):
    """A slider whose guide is nearly along the surface that it has entered."""
    shapes = (
        Shape("p", "a", "disc", 0.1),
        Shape("g", None, "halfplane", 0.0, (0.0, 0.0), math.pi / 2 + angle),
    )
    scene = Scene("jam", (Body("a", 1.0, 0.1, joint="prismatic"),), shapes, (Contact("g", "p", mu),))
    x = np.array([[(-0.1 + depth) / math.sin(angle), 0.0]])
    numbers = {name: v[None] for name, v in scene.default_parameters().items()}
    return scene, Worlds(numbers, x, np.zeros((1, 0)), np.zeros(1, int))


def test_a_runaway_answer_is_silent_however_it_scales_its_own_errors():
    """Impulses whose rounding is larger than all that acts: relative to them everything is right."""
    scene, worlds = guide()
    truth = Truth(scene, worlds)
    p = Problem(truth, truth.drive(), COULOMB.method, "float64")
    impulse = np.array([[3.1e17, 3.1e17 * -p.jac[0, 0, 0] / p.jac[0, 1, 0]]])
    v = np.array([[-3.47]])
    out = Outcome(np.c_[worlds.x[:, :1] + 0.01 * v, v], impulse, p.rate * 0.01, np.zeros(1, int))
    errors = judge(p, out)
    assert errors.lenient["motion"][0] < 1.0 and errors.lenient["contact"][0] < 1.0
    assert verdicts(scene, worlds, out, COULOMB).verdict[0] == SILENT


def test_statuses_need_their_proof():
    scene, worlds = guide()
    still = Outcome(worlds.x, np.zeros((1, 2)), np.array([[-0.001, 0.0]]), np.zeros(1, int))
    right = {"JAMMED": "status", "INFEASIBLE": WRONG, "NONFINITE": WRONG, "NOT_CONVERGED": "status"}
    for status, verdict in ((slcp.Status[name], verdict) for name, verdict in right.items()):
        out = dataclasses.replace(still, status=np.array([status]))
        assert verdicts(scene, worlds, out, COULOMB).verdict[0] == verdict
        moved = dataclasses.replace(out, x=worlds.x + 1e-3)
        assert verdicts(scene, worlds, moved, COULOMB).verdict[0] == WRONG
    free, loose = guide(mu=0.05)
    jammed = dataclasses.replace(still, status=np.array([slcp.Status.JAMMED]), x=loose.x)
    assert verdicts(free, loose, jammed, COULOMB).verdict[0] == WRONG


def test_proofs():
    scene, worlds = guide(mu=0.05)
    truth = Truth(scene, worlds)
    p = Problem(truth, truth.drive(), COULOMB.method, "float64")
    v, impulse = coulomb_solution(p, 0)
    w = p.rate[0] + p.jac[0] @ v
    assert abs(w[0]) < 1e-9 and impulse[0] > 0.0 and abs(impulse[1]) <= 0.05 * impulse[0] * (1 + 1e-9)
    assert widest_opening(p, 0) > 0.9
    crossed = Scene("c", (Body("a", 1.0, 0.1, lower=0.1, upper=0.2),))
    numbers = {name: value[None] for name, value in crossed.default_parameters().items()}
    numbers["upper"] = np.array([[-0.1]])
    truth = Truth(crossed, Worlds(numbers, np.zeros((1, 2)), np.zeros((1, 0)), np.zeros(1, int)))
    p = Problem(truth, truth.drive(), HARD.method, "float64")
    assert widest_opening(p, 0) < -0.9 and least_motion(p, 0) is None
    loose = Scene("loose", (Body("a", 1.0, 0.1),))
    numbers = {name: value[None] for name, value in loose.default_parameters().items()}
    truth = Truth(loose, Worlds(numbers, np.zeros((1, 2)), np.zeros((1, 0)), np.zeros(1, int)))
    p = Problem(truth, truth.drive(), HARD.method, "float64")
    v, impulse = least_motion(p, 0)  # a failing case without its rows, as it is made smaller
    assert len(impulse) == 0 and np.array_equal(v, p.drive.free[0])


def test_penetration_at_the_end_is_noticed():
    """With gap="end" a step that obeys the linearised rows but ends inside is silent."""
    shapes = (Shape("ball", "a", "disc", 0.3), Shape("other", None, "disc", 0.3))
    scene = Scene(
        "balls", (Body("a", 1.0, 0.1, joint="free"),), shapes, (Contact("other", "ball"),), step_size=0.1
    )
    numbers = {name: value[None] for name, value in scene.default_parameters().items()}
    numbers["gravity"] = np.zeros((1, 2))
    x = np.array([[0.0, 0.65, 0.0, 3.0, -2.0, 0.0]])  # w = 0 in the linearised row, 6 mm inside at the end
    worlds = Worlds(numbers, x, np.zeros((1, 0)), np.zeros(1, int))
    end = slcp.Options(residual="hard", gap="end")
    truth = Truth(scene, worlds)
    p = Problem(truth, truth.drive(), HARD.method, "float64")
    v, impulse = least_motion(p, 0)
    out = Outcome(np.r_[x[0, :3] + 0.1 * v, v][None], impulse[None], p.rate * 0.1, np.zeros(1, int))
    assert verdicts(scene, worlds, out, HARD).verdict[0] == "holds"
    if np.linalg.norm(out.x[0, :2]) < 0.6:
        assert verdicts(scene, worlds, out, end).verdict[0] == SILENT
    deep = np.array([[0.0, -1.5, 0.0]])
    inside = Outcome(np.c_[x[:, :3] + 0.1 * deep, deep], impulse[None], p.rate * 0.1, np.zeros(1, int))
    assert verdicts(scene, worlds, inside, end).verdict[0] == SILENT


def of_world(scene, numbers, x, u, options, dtype):
    """A case of the common kernels."""
    extra = {name: numbers[name] for name in cases.EXTRA}
    return cases.Case(baked(scene, numbers), extra, x, u, options, dtype, "generic", "planted")


def test_a_planted_failure_is_made_small():
    scene, worlds = drawn(7, 5)
    assert len(scene.bodies) > 3 and len(scene.contacts) > 2
    numbers = {name: value[1] for name, value in worlds.numbers.items()}
    case = of_world(scene, numbers, worlds.x[1], worlds.u[1], HARD, "float64")
    wanted = case.scene.contacts[-1].shape_a

    def failing(tried):
        return any(c.shape_a == wanted and c.friction is not None for c in tried.scene.contacts)

    small = shrink(case, failing if case.scene.contacts[-1].friction is not None else
                   lambda tried: any(c.shape_a == wanted for c in tried.scene.contacts))  # fmt: skip
    assert len(small.scene.contacts) == 1 and len(small.scene.shapes) == 2
    assert len(small.scene.springs) == len(small.scene.actuators) == 0 and not small.x.any()
    needed = {s.body for s in small.scene.shapes}
    parents = {b.name: b.parent for b in small.scene.bodies}
    for name in list(needed):
        while name is not None:
            name = parents[name]
            needed.add(name)
    assert {b.name for b in small.scene.bodies} <= needed
    assert small.x.shape == (2 * small.scene.nv,) and small.numbers["sigma"].shape == (
        small.scene.structure.nr,
    )


def test_a_case_comes_back_from_its_files(tmp_path):
    scene, worlds = drawn(3, 5)
    numbers = {name: value[1] for name, value in worlds.numbers.items()}
    options = slcp.Options(residual="rem-normal", scaling="none")
    case = of_world(scene, numbers, worlds.x[1], worlds.u[1], options, "float32")
    cases.save_case(case, tmp_path / "case.json")
    back = cases.load_case(tmp_path / "case.json")
    assert back.scene == case.scene and back.options == options and back.note == "planted"
    for one, other in (
        (back.x, case.x),
        (back.u, case.u),
        *zip(back.numbers.values(), case.numbers.values()),
    ):
        np.testing.assert_array_equal(one, other)
    older = (tmp_path / "case.json").read_text().replace('"generic"', '"memory"')
    (tmp_path / "case.json").write_text(older)
    assert "memory" in older and cases.load_case(tmp_path / "case.json").strategy == "generic"
    (tmp_path / "case.json").write_text("{}")
    with pytest.raises(cases.CaseError, match="cannot be read as a case"):
        cases.load_case(tmp_path / "case.json")


@pytest.mark.parametrize(
    ("dtype", "status"), [("float32", slcp.Status.NONFINITE), ("float64", slcp.Status.SOLVED)]
)
def test_a_mass_matrix_without_inverse_is_no_number(dtype, status):
    """A slider of tonnes on a body of a gram: in float32 M^-1 has no digit, and M dv = J' lambda was off by
    more than dv, SOLVED.
    """
    bodies = (
        Body("light", 1e-3, 1e-5, joint="free"),
        Body("heavy", 5e3, 40.0, "light", "prismatic", anchor=(0.4, 0.3)),
    )
    scene = Scene("heavy on light", bodies)
    x = np.array([[0.0, 0.1, 0.2, 0.3, 1.0, -1.0, 2.0, 0.5]])
    sim = slcp.Simulator(scene, HARD, device="cpu", dtype=dtype, strategy="specialised")
    numbers = {name: value[None] for name, value in scene.default_parameters().items()}
    numbers["sigma"] = np.zeros((1, 0))
    worlds = Worlds(numbers, x, np.zeros((1, 0)), np.zeros(1, int))
    done = sim.step(x.astype(dtype))
    assert done.status[0] == status
    if status == slcp.Status.SOLVED:
        found = verdicts(scene, worlds, Outcome.of(done))
        assert found.verdict[0] == "holds" and found.worst[0] < 1.0


@pytest.mark.slow
def test_small_run_of_the_common_kernels_has_no_silent_failure():
    worlds = 0
    for scene in (1, 3, 5, 9):
        tally = run_task(Task(1, scene, "generic", per_chunk=40))
        assert [f for f in tally.failures if f.verdict in (SILENT, WRONG)] == []
        worlds += sum(n for key, n in tally.counts.items() if key[-1] == "worlds")
    assert worlds == 4 * 40 * 14


@pytest.mark.parametrize("part", ["steps", "rollouts", "sweeps", "leaps", "derivatives"])
def test_steps_are_those_of_the_device_that_is_named(monkeypatch, part):
    """Every simulator that judges nothing but is judged."""
    asked = []

    def refused(scene, options, device, **kind):
        asked.append(device)
        raise slcp.StrategyError("on purpose")

    monkeypatch.setattr(slcp, "Simulator", refused)
    task = Task(1, 0, "generic", per_chunk=2, part=part, device="cuda:9")
    try:
        run_task(task)
    except slcp.StrategyError:  # of a sweep, which asks for nothing that is not there
        assert part == "sweeps"
    assert asked and set(asked) == {"cuda:9"}


def test_an_opening_by_the_rounding_of_a_direction_is_none():
    """A row's J of 1e-6, like the 4.5e-8 that is the cosine of pi/2 in float32, opens it at 2e7 m/s."""
    bodies = (Body("a", 1.0, 0.1, lower=-1.0, upper=1.0), Body("b", 1.0, 0.1))
    scene = Scene("two limits", bodies)
    numbers = {name: value[None] for name, value in scene.default_parameters().items()}
    numbers["lower"], numbers["upper"] = np.array([[0.2, -1.0]]), np.array([[0.0, 1.0]])
    truth = Truth(scene, Worlds(numbers, np.zeros((1, 4)), np.zeros((1, 0)), np.zeros(1, int)))
    p = Problem(truth, truth.drive(), HARD.method, "float64")
    assert widest_opening(p, 0) < 0.0
    p.jac[0, 0, 1] = 1e-6
    assert widest_opening(p, 0) < 0.0
    p.jac[0, 0, 1] = 0.1
    assert widest_opening(p, 0) > 0.0
