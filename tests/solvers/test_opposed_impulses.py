"""Limits that meet, or cross by a rounding, in the kernels for large scenes: rows that can press against each
other without end.
"""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Scene
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds
from slcp_warp.scripts.benchmarks.fuzz.judged import judged
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task
from slcp_warp.scripts.benchmarks.fuzz.verdicts import SILENT, WRONG

HARD = slcp.Options(residual="hard")


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
