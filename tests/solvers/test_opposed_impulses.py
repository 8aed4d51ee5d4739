"""Limits that meet, or cross by a rounding: rows that can press against each other without end."""

import json
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from simulators import scene as named
from simulators import simulator

import slcp_warp as slcp
from slcp_warp import Body, Scene
from slcp_warp.scripts.benchmarks.contacts.worlds import world as many
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds, single
from slcp_warp.scripts.benchmarks.fuzz.judged import judged
from slcp_warp.scripts.benchmarks.fuzz.proofs import least_motion
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task
from slcp_warp.scripts.benchmarks.fuzz.verdicts import SILENT, WRONG

HARD = slcp.Options(residual="hard")
LAST_STEPS = Path(__file__).with_name("last_steps.json")


@pytest.mark.slow
@pytest.mark.parametrize("friction", ["anitescu", "coulomb"])
def test_limits_that_all_but_exclude_each_other_in_float32(friction):
    """Opposed impulses of 1e6 hold what needs .02: rounded to float32 they do not sum up, and were SOLVED."""
    scene = Scene("limits", (Body("a", 1.0, 0.1, lower=-1.0, upper=1.0),), step_size=0.05006)
    x = np.array([[0.0, -14.0]], np.float32)
    numbers = {name: value[None] for name, value in scene.default_parameters().items()}
    numbers["lower"], numbers["upper"] = np.array([[-0.68924]]), np.array([[-0.6892415]])
    numbers = {name: value.astype(np.float32).astype(float) for name, value in numbers.items()}
    options = slcp.Options(residual="hard", friction=friction)
    sim = slcp.Simulator(scene, options, device="cpu", dtype="float32", strategy="generic")
    found, done = judged(Worlds(numbers, x.astype(float), np.zeros((1, 0)), np.zeros(1, int)), sim)
    assert found.verdict[0] in ("holds", "status")
    assert found.errors.worst()[0] < 1.0 or done.status[0] != slcp.Status.SOLVED
    assert np.abs(done.impulse).max() < 100.0


@pytest.mark.slow
@pytest.mark.parametrize("scaling", ["inertia", "none"])
@pytest.mark.parametrize("residual", ["hard", "rem-logistic"])
def test_crossed_limits_beside_something_fast_and_heavy(residual, scaling):
    """A resting slider whose limits cross by 0 to 1e-6 m, in a world where a tonne runs at 2 km/s: opposed
    impulses of up to 5e6 were nothing on the tonne's scale, and SOLVED.
    """
    bodies = (Body("slow", 1.0, 0.1, lower=-1.0, upper=1.0), Body("fast", 1e3, 100.0, lower=-1.0, upper=1.0))
    scene = Scene("limits", bodies, step_size=0.01)
    cross = np.array([0.0, 1e-7, 1e-6, 1e-4])
    numbers = {n: np.repeat(v[None], 4, 0) for n, v in scene.default_parameters().items()}
    numbers["lower"] = np.tile([0.25, -1.0], (4, 1))
    numbers["upper"] = np.stack([0.25 - cross, np.ones(4)], 1)
    numbers = {name: value.astype(np.float32).astype(float) for name, value in numbers.items()}
    x = np.tile(np.array([0.25, 0.0, -0.02, -2000.0], np.float32).astype(float), (4, 1))
    options = slcp.Options(residual=residual, scaling=scaling)
    sim = slcp.Simulator(scene, options, device="cpu", dtype="float32", strategy="generic")
    found, done = judged(Worlds(numbers, x, np.zeros((4, 0)), np.zeros(4, int)), sim)
    assert not np.isin(found.verdict, (SILENT, WRONG)).any(), (found.verdict, found.reason, done.impulse)
    if residual == "hard":  # the limits that meet leave room to rest
        assert done.status[0] == slcp.Status.SOLVED
        np.testing.assert_allclose(done.impulse[0], [2e-3, 0.0, 1.9e5, 0.0], rtol=1e-5, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "world"), [(12, 279), (15, 34), (18, 59), (14, 284)])
def test_opposed_impulses_are_as_small_as_they_can_be(scene, world):
    """Limits that meet while other rows act: a solution exists, and impulses of up to 2e12 were given."""
    task = Task(0, scene, "generic")
    drawn_scene = task.make_scene()
    worlds = task.worlds(0, drawn_scene).part([world])
    for dtype in ("float64", "float32"):
        sim = slcp.Simulator(drawn_scene, HARD, device="cpu", dtype=dtype, strategy="generic")
        found, done = judged(worlds, sim)
        assert done.status[0] == slcp.Status.SOLVED and found.verdict[0] == "holds"
        assert found.errors.worst()[0] < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("scaling", ["inertia", "none"])
def test_rows_that_all_but_depend_on_each_other_press_as_little_as_they_can(scaling):
    """Two rows of a ring on its bearing tell 1e-10 of the bearing's own spin: impulses of 1e9 left either of
    them open by 1e-9 m/s, the spin .5 rad/s off, and were SOLVED. sigma is 1e-4 m/s, so that the hard law's
    motion, here from the oracle, is nearly that of the smoothed one.
    """
    task = Task(1003, 19, "generic")
    drawn_scene = task.make_scene()
    worlds = task.worlds(0, drawn_scene).part([386])
    options = slcp.Options("rem-normal", scaling)
    sim = slcp.Simulator(drawn_scene, options, device="cpu", dtype="float64", strategy="generic")
    found, done = judged(worlds, sim)
    assert done.status[0] == slcp.Status.SOLVED and found.verdict[0] == "holds"
    expected, _ = least_motion(found.problem, 0)
    np.testing.assert_allclose(done.state[0, drawn_scene.nv :], expected, rtol=2e-3, atol=1e-6)


RESTING, COULOMB = slcp.Options("rem-logistic"), slcp.Options("hard", friction="coulomb")
UNSCALED = slcp.Options("rem-logistic", "none")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "scene", "world", "options", "dtype"),
    [
        (0, 21, 465, RESTING, "float64"),  # a row that does not press lent its impulse to a body at rest
        (0, 105, 179, RESTING, "float64"),
        (0, 22, 274, HARD, "float32"),  # limits that cross by 1e-7 of what they stop
        (0, 108, 54, HARD, "float32"),
        (0, 43, 372, COULOMB, "float32"),  # J_n - mu J_t next to nothing, impulses of 1e7 along it
        (1, 4, 424, UNSCALED, "float32"),  # limits that meet: impulses that grow from round to round
        (3, 2, 354, UNSCALED, "float32"),
        (3, 26, 244, HARD, "float32"),
        (6, 17, 441, COULOMB, "float32"),  # a gram that carries tonnes, opposed impulses of 2e9
        (1, 12, 1894, HARD, "float64"),  # what carries both bodies of a contact got a part of its impulse
        (2, 28, 7, HARD, "float64"),  # INFEASIBLE, and opens at 5,000 times v_free
        (0, 4, 481, HARD, "float64"),  # momenta judged by what is fastest, not by what a body exchanges
        (0, 5, 401, RESTING, "float64"),
        (71, 2, 154, UNSCALED, "float32"),  # a locked joint of 27 mg: the noise presses with 5 N s
        (197, 6, 24, RESTING, "float64"),  # one beside what is fast: 4e10 N s
        (23, 25, 441, UNSCALED, "float64"),  # open by a rounding of what is fast elsewhere
        (
            24,
            15,
            122,
            COULOMB,
            "float64",
        ),  # little friction: mu v_t of what sticks is a rounding, v_t is none
    ],
)
def test_impulses_that_the_data_do_not_suggest_are_earned(seed, scene, world, options, dtype):
    """Each was SOLVED with M dv = J' lambda open by 2 to 500 times what its precision may miss."""
    task = Task(seed, scene, "generic")
    drawn_scene = task.make_scene()
    chunk, place = divmod(world, task.per_chunk)
    worlds = task.worlds(chunk, drawn_scene).part([place])
    sim = slcp.Simulator(drawn_scene, options, device="cpu", dtype=dtype, strategy="generic")
    found, _ = judged(worlds, sim)
    assert found.verdict[0] not in (SILENT, WRONG), found.reason[0]


@pytest.mark.parametrize("crossed", [1e-1, 1e-6, 1e-12])
@pytest.mark.parametrize(("strategy", "options"), [("generic", HARD), ("specialised", UNSCALED)])
def test_limits_that_cross_have_no_solution_however_little(strategy, options, crossed):
    """Beside a joint at 1e6 rad/s they were SOLVED: what they cross by was less than its rounding."""
    finger = named("flicking_finger")
    x = np.array([[0.3, 0.5, 2.0, 0.0, 0.0, 0.0]])
    sim = slcp.Simulator(finger, options, device="cpu", strategy=strategy)
    numbers = finger.default_parameters()
    for upper in (0.5, 0.5 - crossed):
        numbers["lower"][1], numbers["upper"][1] = 0.5, upper
        params = sim.params.replace(lower=numbers["lower"], upper=numbers["upper"])
        for u in (0.0, 1e3):
            done = sim.step(x, np.array([[0.0, u]]), params)
            assert (done.status[0] == slcp.Status.INFEASIBLE) == (upper < 0.5)
    np.testing.assert_array_equal(done.state, x)


@pytest.mark.slow
def test_a_last_step_of_newtons_method_is_looked_at():
    """In float32 limits that meet were SOLVED with one of them entered by 2e-4 of the speeds: the impulses
    that the last step was to first order press against each other, and round by more than it was worth.
    The worlds: 919 and 18879 of `draw_worlds(default_rng(0), flicking_finger, 20000)`.
    """
    found = json.loads(LAST_STEPS.read_text())
    numbers = {name: single(values) for name, values in found["numbers"].items()}
    worlds = Worlds(numbers, single(found["x"]), single(found["u"]), np.array(found["kind"]))
    sim = simulator("flicking_finger", "cpu", wp.float32, "none")
    found, _ = judged(worlds, sim)
    assert not np.isin(found.verdict, (SILENT, WRONG)).any(), found.reason


@pytest.mark.full
@pytest.mark.parametrize(
    ("seed", "scene", "world"),
    [
        (2, 20, 1337),  # float32: the rounding of J_i lambda_i hid in the sum that it was compared with
        (2, 9, 869),  # J M^-1 J' = 0 where M^-1 has no digits: INFEASIBLE
        (2, 47, 452),  # a mass matrix that loses its digits over several pivots
        (21, 4, 1431),  # friction the wrong way, on the scale of a row that is open
        (21, 8, 1555),
        (21, 28, 1976),  # opposed impulses of 1e8 where friction jams
    ],
)
def test_worlds_that_were_silent_in_specialised_kernels(seed, scene, world):
    task = Task(seed, scene, "specialised")
    drawn_scene, ((options, dtype),) = task.make_scene(), task.methods()
    chunk, place = divmod(world, task.per_chunk)
    sim = slcp.Simulator(drawn_scene, options, device="cpu", dtype=dtype, strategy="specialised")
    found, _ = judged(task.worlds(chunk, drawn_scene).part([place]), sim)
    assert found.verdict[0] not in (SILENT, WRONG), found.reason[0]


@pytest.mark.slow
def test_locked_joints_press_no_harder_than_their_noise():
    """A cart of 610 kg on a slider whose limits meet, beside 1e6 m/s: 4.3 N s stop it, and each limit gave
    4e10 of its own. The noise asks for some 30 sigma/D, 8 N s.
    """
    task = Task(197, 6, "generic")
    scene = task.make_scene()
    worlds = task.worlds(0, scene).part([24])
    sim = slcp.Simulator(scene, RESTING, device="cpu", dtype="float64", strategy="generic")
    found, done = judged(worlds, sim)
    assert done.status[0] == slcp.Status.SOLVED and found.verdict[0] == "holds", found.reason[0]
    low, up = np.asarray(done.impulse, float)[0, :2]
    np.testing.assert_allclose(low - up, 4.29928772, rtol=1e-6)
    assert max(low, up) < 1e8  # 8.1 and 3.8; what adds up may be larger on another processor


def test_wedged_discs_are_solved_by_the_least_impulses_that_open_them():
    """Ten thrown discs whose rows fit between the walls to a rounding: of 120 worlds 24 were NOT_CONVERGED
    within 12 steps. What opens them are impulses of 1e4 N s, beside momenta of 1; v' is as small as ever.
    """
    wedged = many("discs:10")
    sim = slcp.Simulator(wedged.scene, HARD, device="cpu", dtype="float64", strategy="generic")
    run = sim.rollout(wedged.starts("tumbling", 120, 0), steps=12, record="impulse")
    assert (run.status != slcp.Status.SOLVED).sum() <= 12
    pressed = np.nan_to_num(run.impulse).max(2)
    at = np.argwhere(pressed > 1e3)
    assert len(at) > 20
    numbers = {name: np.repeat(v[None], len(at), 0) for name, v in wedged.scene.default_parameters().items()}
    x = run.states[at[:, 0], at[:, 1]]
    worlds = Worlds(numbers, x, np.zeros((len(at), 0)), np.zeros(len(at), int))
    found, done = judged(worlds, sim)
    solved = done.status == slcp.Status.SOLVED
    assert solved.mean() > 0.8 and (found.verdict[solved] == "holds").all()
    for i in np.flatnonzero(solved)[:10]:  # 2e-11 of a row, which is SOLVED, is 1e-4 of the least motion here
        v, _ = least_motion(found.part(np.array([i])), 0)
        np.testing.assert_allclose(done.state[i, wedged.scene.nv :], v, rtol=0, atol=1e-4 * np.abs(v).max())
