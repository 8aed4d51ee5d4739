"""Names that are alike: what belongs to whom, and what is refused because nothing would tell it apart."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape, measures


def test_numbers_of_a_body_are_its_own():
    """Those of "a" were set and drawn for "a.b", too."""
    bodies = (Body("a", 1.0, 1.0, joint="prismatic"), Body("a.b", 1.0, 1.0, joint="prismatic"))
    params = slcp.Parameters(Scene("dotted", bodies))
    for name in ("mass", "damping"):
        before = params[name].copy()
        np.testing.assert_array_equal(params.replace(**{f"a.{name}": 5.0})[name], [5.0, before[1]])
        np.testing.assert_array_equal(params.replace(**{f"a.b.{name}": 5.0})[name], [before[0], 5.0])


def test_pairs_need_names_that_tell_them_apart():
    bodies = (Body("p", 1.0, 1.0, joint="free"), Body("q", 1.0, 1.0, joint="free"))
    shapes = [
        Shape(name, body, "disc", 0.1) for name, body in (("a/b", "p"), ("c", "q"), ("a", "p"), ("b/c", "q"))
    ]
    with pytest.raises(slcp.SceneError, match="contacts has two pairs of the name 'a/b/c'"):
        Scene("slashes", bodies, tuple(shapes), (Contact("a", "b/c"), Contact("a/b", "c")))


def test_one_number_is_named_once():
    task = slcp.tasks.push_to_mark()
    twice = {"face/pusher.friction": 0.5, "pusher/face.friction": 0.1}
    with pytest.raises(slcp.ParameterError, match="which are the same; leave one out"):
        slcp.Parameters(task.scene).replace(**twice)
    with pytest.raises(ValueError, match="which are the same; leave one out"):
        task.replace(disturbances=slcp.Disturbances(parameters=twice))


def test_parameters_cannot_be_written_to():
    """What was written reached other objects, and not the numbers on the device."""
    params = slcp.Parameters(slcp.scenes.push_block())
    with pytest.raises(ValueError, match="read-only"):
        params["mass"][:] = 50.0


def test_a_start_that_is_not_drawn_is_no_number(tmp_path):
    """In memory NaN, in a folder -2147483648."""
    pytest.importorskip("pyarrow")
    scene = Scene("two starts", (Body("a", 1.0, 1.0, joint="prismatic"),), gravity=(0.0, 0.0))
    task = slcp.Task(
        "two", scene, duration=0.1, start=np.array([[0.0, 0.0], [1.0, 0.0]]),
        disturbances=slcp.Disturbances(velocity=0.1), measures={"x": measures.final(0)},
    )  # fmt: skip
    kept, stored = (
        slcp.sweep(task, None, worlds=4, cases=task.options, out=out).table["drawn_start"]
        for out in (None, tmp_path / "kept")
    )
    np.testing.assert_array_equal(stored, kept)
    assert np.isnan(stored[-2:]).all()
