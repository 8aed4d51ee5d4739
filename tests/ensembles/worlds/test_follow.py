"""Starts that go with the numbers of a world: a box of any size stands on its ground."""

from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import measures as m

HALF = (0.05, 0.04)
HARD = slcp.Options("hard", friction="coulomb")
SIZES = slcp.Uniform(0.03, 0.06)


def scene() -> slcp.Scene:
    """A box between a hand and a finger that touch it."""
    shapes = (
        slcp.Shape("ground", None, "halfplane", angle=np.pi / 2),
        slcp.Shape("box", "box", "rectangle", HALF),
        slcp.Shape("palm", "hand", "disc", 0.02),
    )
    bodies = (slcp.Body("box", 1.0, 0.002, joint="free"), slcp.Body("hand", 0.5, 0.01, joint="prismatic"))
    contacts = (slcp.Contact("ground", "box", 0.5), slcp.Contact("palm", "box", 0.5))
    start = (0.0, HALF[1], 0.0, -HALF[0] - 0.02, 0.0, 0.0, 0.0, 0.0)
    return slcp.Scene(
        "stand",
        bodies,
        shapes,
        contacts,
        actuators=(slcp.Actuator("hand"),),
        initial_state=start,
        step_size=0.01,
    )


SCENE = scene()
FOLLOW = {"box.y": "box.radius_1", "hand.shift": {"box.radius_0": -1.0, "palm.radius": -1.0}}
DRAWN = {"box.radius_0": SIZES, "box.radius_1": SIZES, "palm.radius": slcp.Uniform(0.01, 0.03), "mass": 0.1}


def task(follow=FOLLOW, **changes) -> slcp.Task:
    fields = {
        "disturbances": slcp.Disturbances(parameters=DRAWN, follow=follow),
        "measures": {"height": m.initial("box.y"), "moved": m.excursion("box.y"), "push": m.impulse("hand")},
        "success": m.excursion("box.y") < 1e-3,
        "duration": 0.1,
        "options": HARD,
    }
    return slcp.Task("stand", SCENE, **{**fields, **changes})


def still() -> slcp.policies.Linear:
    return slcp.policies.Linear(np.zeros((1, 8)), SCENE.x0, [0.0])


@pytest.mark.parametrize("dtype, near", [("float64", 1e-14), ("float32", 1e-7)])
def test_what_follows_touches_and_does_not_overlap(device, dtype, near):
    given = {"dtype": dtype, "device": device}
    found = slcp.sweep(task(), still(), worlds=64, **given).part("policy")
    assert (found["status"] == 0).all() and found["success"].all()
    np.testing.assert_allclose(found["height"], found["drawn_box.radius_1"], rtol=2e-7)
    assert found["start_overlap"].max() < 10.0 * near and found["moved"].max() < 1e-6
    with pytest.warns(RuntimeWarning, match="overlap"):
        loose = slcp.sweep(task({}), still(), worlds=64, **given).part("policy")
    assert loose["start_overlap"].max() > 0.01
    worlds = slcp.draw_worlds(task(), 5, **given)
    np.testing.assert_allclose(worlds.x0, np.tile(SCENE.x0, (5, 1)), atol=near)
    run = slcp.replay(task(), still(), worlds, **given)
    size = worlds.params[:, slcp.Parameters(SCENE).layout.offset("radius") :]
    np.testing.assert_allclose(run.states[:, 0, 1], size[:, 3], rtol=0.0, atol=near)
    np.testing.assert_allclose(run.states[:, 0, 3], -size[:, 2] - size[:, 4], rtol=0.0, atol=2.0 * near)
    assert np.ptp(run.states[:, 0, 3]) > 0.01
    environment = slcp.Environment(task(), worlds=5, reward=m.impulse(), **given)
    np.testing.assert_allclose(environment.reset()[:, :8], run.states[:, 0], rtol=0.0, atol=3.0 * near)


def test_it_is_moved_beside_what_is_drawn(device):
    given = {"dtype": "float64", "device": device}
    both = task(disturbances=replace(task().disturbances, start={"box.y": slcp.Uniform(1.0, 2.0)}))
    found = slcp.sweep(both, still(), worlds=16, **given).part("policy")
    moved = found["height"] - found["drawn_box.y"] - (found["drawn_box.radius_1"] - HALF[1])
    np.testing.assert_allclose(moved, 0.0, atol=1e-6)
    undisturbed = slcp.sweep(task(), still(), worlds=2, **given).part("policy", arm="undisturbed")
    np.testing.assert_allclose(undisturbed["height"], HALF[1], rtol=1e-12)


def test_questions_move_it_too(device):
    given = {"dtype": "float64", "device": device}
    one = slcp.Disturbances(parameters={"box.radius_1": SIZES}, follow={"box.y": "box.radius_1"})
    small = task(
        disturbances=one, measures={"height": m.initial("box.y")}, success=m.initial("box.y") < 0.045
    )
    values = np.array([0.03, 0.04, 0.05, 0.06])
    found = slcp.robustness_map(
        small, still(), ("box.radius_1=", values), ("box.vy", [0.0, 0.01]), worlds=4, seed=2, **given
    )
    np.testing.assert_array_equal(found.successes, np.tile([4, 4, 0, 0], (2, 1)))
    decided = slcp.sensitivity(small, still(), measure="height", samples=64, **given)
    assert decided.names == ("box.radius_1",) and decided.total[0][0] == pytest.approx(1.0, abs=0.2)


def test_a_map_of_what_follows_is_of_what_is_added(device):
    with pytest.raises(
        slcp.ArgumentError, match="'box.y=' would be the start itself, which follows box.radius_1"
    ):
        slcp.robustness_map(task(), still(), ("box.y=", [0.1, 0.2]), ("mass", [1.0, 2.0]), device=device)


def test_searches_by_other_numbers_keep_it(device):
    """Worlds that begin where they stand do not fail; the failing one that is found begins there, too."""
    low = task(
        disturbances=slcp.Disturbances(follow=FOLLOW), success=m.initial("box.y") < 0.045, options=HARD
    )
    by = slcp.Disturbances(parameters={"box.radius_1": 0.05})
    found = slcp.falsify(low, still(), by=by, worlds=64, rounds=4, device=device, dtype="float64")
    size = np.log(0.045 / HALF[1]) / 0.05
    assert found.size == pytest.approx(size, rel=0.05)
    again = slcp.sweep(found.scenario, still(), worlds=1, cases=HARD, device=device, dtype="float64").part(
        "policy"
    )
    assert again["height"][0] > 0.045 and again["start_overlap"][0] < 1e-9


def test_files_keep_it(tmp_path):
    slcp.save_task(task(), tmp_path / "stand.json")
    loaded = slcp.load_task(tmp_path / "stand.json")
    assert loaded.disturbances == task().disturbances
    assert loaded.disturbances.follow["box.y"] == {"box.radius_1": 1.0}


@pytest.mark.parametrize(
    "follow, text",
    [
        ({"box.z": "box.radius_1"}, "'box.z'; there are"),
        ({"box.y": "box.radius"}, "which are 2 numbers; one is needed"),
        ({"box.y": "mass"}, "which are 2 numbers"),
        ({"box.y": "bax.radius_1"}, "bax.radius_1"),
        ({"box.y": {"box.radius_1": np.nan}}, r"follow\['box.y'\]\['box.radius_1'\] is nan"),
        ({"box.y": 3.0}, "a parameter's name, as 'box.radius_1', or a dict"),
        ({"box.y": {}}, "a parameter's name"),
        ({3: "box.radius_1"}, "a text is needed"),
        ("box.y", "follow is a str; a dict of parameters by state name"),
    ],
)
def test_what_cannot_follow_is_refused(follow, text):
    with pytest.raises(slcp.InputError, match=text):
        task(follow)
