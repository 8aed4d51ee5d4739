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


def test_springs_have_names():
    """A single one could be neither set nor drawn nor mapped."""
    bodies = (slcp.Body("arm", 1.0, 0.1), slcp.Body("load", 1.0, 0.1, joint="free"))
    springs = (slcp.Spring(None, "arm", stiffness=1.0), slcp.Spring("arm", "load", stiffness=2.0),
               slcp.Spring("arm", "load", point_a=(0.1, 0.0), stiffness=3.0))  # fmt: skip
    scene = slcp.Scene("tied", bodies, springs=springs)
    assert scene.spring_names == ("world/arm", "arm/load", "arm/load#2")
    params = slcp.Parameters(scene).replace(
        **{"arm/load#2.spring_stiffness": 5.0, "arm/world.spring_length": 0.4}
    )
    assert params["spring_stiffness"].tolist() == [1.0, 2.0, 5.0]
    assert params["spring_length"].tolist() == [0.4, 0.0, 0.0]
    with pytest.raises(slcp.ParameterError, match="arm/load.spring_damping"):
        params.replace(**{"load/load.spring_damping": 1.0})
    drawn = slcp.Disturbances(parameters={"arm/load.spring_stiffness": 0.2})
    task = slcp.Task(name="tied", scene=scene, duration=0.1, disturbances=drawn)
    report = slcp.sweep(task, None, worlds=16, cases=slcp.Options("hard"), device="cpu")
    stiffness = report.part(report.source.keys[0][0])["drawn_arm/load.spring_stiffness"]
    assert np.ptp(stiffness) > 0.0 and not any("arm/load#2" in name for name in report.table)
