"""Numbers of one part by its name: what is read can be put back, for one world and for many."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Scene, Shape


def scene():
    shapes = (
        Shape("ground", None, "halfplane", angle=np.pi / 2),
        Shape("box", "box", "rectangle", (0.08, 0.06), corner_radius=0.01),
        Shape("ball", "ball", "disc", 0.1),
        Shape("knob", "ball", "disc", 0.05, offset=(0.1, 0.0)),
    )
    bodies = (Body("box", 1.0, 0.01, joint="free", com=(0.01, 0.02)), Body("ball", 1.0, 0.01, joint="free"))
    return Scene("parts", bodies, shapes, "auto", friction=0.5)


NAMES = ("box.radius", "box.com", "box.shape_offset", "ground/ball.friction", "box.mass", "box.anchor")


@pytest.mark.parametrize("name", NAMES)
def test_what_is_read_can_be_put_back(name):
    params = slcp.Parameters(scene())
    found = params[name]
    again = params.replace(**{name: found})
    assert again.worlds is None
    for each in params.names:
        np.testing.assert_array_equal(again[each], params[each])
    doubled = params.replace(**{name: 2.0 * found})
    np.testing.assert_array_equal(doubled[name], 2.0 * found)
    several = np.stack([found, 2.0 * found, 0.5 * found])
    worlds = params.replace(**{name: several})
    assert worlds.worlds == 3
    np.testing.assert_array_equal(worlds[name], several)
    np.testing.assert_array_equal(worlds.replace(**{name: found})[name], np.stack([found] * 3))


def test_a_number_of_every_world_is_one_still():
    params = slcp.Parameters(scene())
    for count in (3, 5):
        values = np.linspace(0.05, 0.1, count)
        worlds = params.replace(**{"box.radius": values})
        np.testing.assert_array_equal(worlds["box.radius"], np.repeat(values[:, None], 2, axis=1))
    discs = params.replace(**{"ball.radius": [0.1, 0.2]})  # a disc has one: two worlds
    assert discs.worlds == 2
    np.testing.assert_array_equal(discs["radius"][:, 2], [[0.1, 0.1], [0.2, 0.2]])
    np.testing.assert_array_equal(params.replace(**{"box.com": [0.3, 0.4]})["com"][0], [0.3, 0.4])


def test_what_fits_no_part_is_said():
    params = slcp.Parameters(scene())
    need = r"a number, or \(B,\) one a world, \(2,\) or \(B, 2\), is needed"
    with pytest.raises(slcp.ParameterError, match=r"box.radius has shape \(4, 3\); " + need):
        params.replace(**{"box.radius": np.ones((4, 3))})
    with pytest.raises(
        slcp.ParameterError, match=r"box.mass has shape \(4, 2\); a number, or \(B,\) one a world, is"
    ):
        params.replace(**{"box.mass": np.ones((4, 2))})
    with pytest.raises(slcp.ParameterError, match="box.com is for 4 worlds, other numbers are for 3"):
        params.replace(com=np.ones((3, 2, 2))).replace(**{"box.com": np.ones((4, 2))})
