"""The numbers of a mechanism at all doors: `Scene` and its parts, scene files, MJCF and `Parameters.replace`
take and refuse the same ones, in the same words.
"""

import dataclasses
import json
import math
import warnings

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp

NAN, INF = math.nan, math.inf
GOOD = slcp.Scene(
    "good",
    (
        slcp.Body("cart", 1.0, 0.1, joint="prismatic", stiffness=1.0),
        slcp.Body("arm", 1.0, 0.1, parent="cart"),
    ),
    (
        slcp.Shape("disc", "cart", "disc", 0.1),
        slcp.Shape("ellipse", "arm", "ellipse", (0.2, 0.1), angle=0.3),
        slcp.Shape("capsule", "arm", "capsule", (0.1, 0.2), angle=0.3),
        slcp.Shape("ground", None, "halfplane", angle=1.5),
    ),
    (slcp.Contact("ground", "ellipse", 0.5),),
    (slcp.Actuator("cart"),),
    springs=(slcp.Spring("cart", "arm", point_b=(0.1, 0.2), stiffness=1.0, damping=0.1, length=0.3),),
)
# field of a part: (part, its place in the scene, parameter, place in the parameter)
PLACES = {
    "mass": ("bodies", 0, "mass", (0,)),
    "inertia": ("bodies", 1, "inertia", (1,)),
    "angle": ("bodies", 1, "angle", (1,)),
    "anchor": ("bodies", 1, "anchor", (1,)),
    "axis": ("bodies", 0, "axis", (0,)),
    "com": ("bodies", 0, "com", (0,)),
    "damping": ("bodies", 0, "damping", (0,)),
    "stiffness": ("bodies", 0, "stiffness", (0,)),
    "rest": ("bodies", 0, "rest", (0,)),
    "lower": ("bodies", 0, "lower", (0,)),
    "upper": ("bodies", 0, "upper", (0,)),
    "offset": ("shapes", 1, "shape_offset", (1,)),
    "shape angle": ("shapes", 1, "shape_angle", (1,)),
    "disc": ("shapes", 0, "radius", (0, 0)),
    "discs": ("shapes", 0, "radius", (0,)),
    "ellipse": ("shapes", 1, "radius", (1,)),
    "capsule": ("shapes", 2, "radius", (2,)),
    "friction": ("contacts", 0, "friction", (0,)),
    "gear": ("actuators", 0, "gear", (0,)),
    "spring stiffness": ("springs", 0, "spring_stiffness", (0,)),
    "spring damping": ("springs", 0, "spring_damping", (0,)),
    "length": ("springs", 0, "spring_length", (0,)),
    "point_b": ("springs", 0, "spring_point", (0, 1)),
    "gravity": ("", 0, "gravity", ()),
    "step_size": ("", 0, "step_size", ()),
    "sigma": ("", 0, "sigma", ()),
}
FIELDS = {"disc": "radius", "discs": "radius", "ellipse": "radius", "capsule": "radius"}
PAIRS = ("anchor", "axis", "com", "offset", "discs", "ellipse", "capsule", "point_b", "gravity")
NOT_NEGATIVE = ("damping", "disc", "friction", "spring damping", "length")
POSITIVE = ("mass", "inertia", "step_size", "sigma")


def bad_values(name):
    """Values that no door takes -> the words that say why."""
    if name in PAIRS:
        pair = {(NAN, 0.1): "is nan; it must be finite", (0.1, -INF): "is -inf; it must be finite"}
        pair |= {
            "axis": {(2.0, 0.0): r"of length 2; a unit vector is needed, \(1.0, 0.0\)",
                     (0.0, 0.0): "of length 0; a unit vector is needed",
                     (1e200, 1e200): "a unit vector is needed"},
            "discs": {(0.1, 0.2): r"is \(0.1, 0.2\); a disc has one radius",
                      (-0.1, -0.1): "is -0.1; it must not be negative"},
            "ellipse": {(0.0, 0.1): "is 0.0; an ellipse's must be positive",
                        (0.1, -0.2): "is -0.2; it must not be negative"},
            "capsule": {(0.1, -0.2): "is -0.2; it must not be negative"},
        }.get(name, {})  # fmt: skip
        return pair
    out = {NAN: "is nan; it must be finite", INF: "is inf; it must be finite"}
    if name in POSITIVE:
        out |= {0.0: "is 0.0; it must be positive", -0.1: "is -0.1; it must be positive"}
    if name in NOT_NEGATIVE:
        out |= {-5.0: "is -5.0; it must not be negative"}
    return out


def field_of(name):
    return FIELDS.get(name, name.split(" ")[-1])


def with_number(name, value):
    """The scene with another number."""
    group, i, _, _ = PLACES[name]
    if not group:
        return dataclasses.replace(GOOD, **{name: value})
    parts = list(getattr(GOOD, group))
    parts[i] = dataclasses.replace(parts[i], **{field_of(name): value})
    return dataclasses.replace(GOOD, **{group: tuple(parts)})


def file_with_number(path, name, value):
    group, i, _, _ = PLACES[name]
    slcp.save_scene(GOOD, path)
    content = json.loads(path.read_text())
    (content[group][i] if group else content)[field_of(name)] = value
    path.write_text(json.dumps(content))
    return path


def replaced(name, value):
    _, _, parameter, at = PLACES[name]
    limit = name in ("lower", "upper")  # of a joint that has one
    params = slcp.Parameters(with_number(name, 0.1) if limit else GOOD)
    array = params[parameter].copy()
    if name == "disc":
        at = (0,)  # both numbers
    array[at] = value
    return params.replace(**{parameter: array})


CASES = [(name, value, words) for name in PLACES for value, words in bad_values(name).items()]


@pytest.mark.parametrize("name, value, words", CASES, ids=lambda x: str(x)[:20])
def test_no_door_takes_what_another_refuses(tmp_path, name, value, words):
    with pytest.raises(slcp.SceneError, match=words):
        with_number(name, value)
    with pytest.raises(slcp.SceneFileError, match=rf"scene\.json.*{words}"):
        slcp.load_scene(file_with_number(tmp_path / "scene.json", name, value))
    with pytest.raises(slcp.ParameterError, match=words):
        replaced(name, value)


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("value", [True, "1.5", "heavy", 1j, [[1.0]], {}, object(), np.array(["1"]), 10**400])
def test_only_numbers_are_numbers(tmp_path, name, value):
    group, i, parameter, _ = PLACES[name]
    with pytest.raises(slcp.SceneError, match=field_of(name)):
        with_number(name, value)
    with pytest.raises(slcp.ParameterError, match=f"{parameter} (is|has shape)"):
        slcp.Parameters(GOOD).replace(**{parameter: [[[[value]]]] if value == [[1.0]] else value})
    if isinstance(value, bool | str | dict):
        path = file_with_number(tmp_path / "scene.json", name, value)
        with pytest.raises(slcp.SceneFileError, match=rf"scene\.json.*{field_of(name)}"):
            slcp.load_scene(path)


@pytest.mark.parametrize("name", PLACES)
def test_good_numbers_pass_all_doors_and_mean_the_same(tmp_path, name):
    value = {"axis": (0.6, 0.8), "discs": (0.3, 0.3)}.get(name, (0.3, 0.2) if name in PAIRS else 0.3)
    made = with_number(name, value)
    _, _, parameter, at = PLACES[name]
    given = np.array(value)
    for kind in (list, np.array) if name in PAIRS else (np.float32, np.array):  # other sequences and numbers
        again = with_number(name, kind(value))
        assert again == made or kind is np.float32
        hash(again)
    loaded = slcp.load_scene(file_with_number(tmp_path / "scene.json", name, value))
    assert loaded == made
    for params in (slcp.Parameters(made), slcp.Parameters(loaded), replaced(name, value)):
        np.testing.assert_array_equal(params[parameter][at], given)


@pytest.mark.parametrize("changes, words", [
    ({"initial_state": (NAN, 0.0, 0.0, 0.0)}, r"initial_state\[0\] is nan; it must be finite"),
    ({"initial_state": (0.0, "1", 0.0, 0.0)}, r"initial_state\[1\] is '1'; a number is needed"),
    ({"initial_state": (0.0,) * 3}, "initial_state has 3 entries; 4 are needed"),
    ({"initial_state": "abcd"}, "initial_state is 'abcd'; 4 numbers are needed"),
    ({"initial_state": 0.0}, "initial_state is 0.0; 4 numbers are needed"),
    ({"period": (1.0, -1.0)}, r"period\[1\] is -1.0; it must be positive"),
    ({"period": (1.0,)}, "period has 1 entries; 2 are needed"),
    ({"gravity": -9.81}, "gravity is -9.81; 2 numbers are needed"),
    ({"gravity": None}, "gravity is None; 2 numbers are needed"),
    ({"bodies": "x"}, "bodies is 'x'; a tuple of Body is needed"),
    ({"bodies": ({"name": "a"},)}, r"bodies\[0\] is {'name': 'a'}; a Body is needed"),
    ({"bodies": ()}, "bodies: scene 'good' has none"),
    ({"name": ""}, "name is ''; a name is needed"),
    ({"name": None}, "name is None; a name is needed"),
    ({"name": "a\nb"}, r"name is 'a\\nb'; a name of printable characters is needed"),
    ({"name": "a\ud800"}, "a name of printable characters is needed"),
])  # fmt: skip
def test_a_scene_that_is_none(changes, words):
    with pytest.raises(slcp.SceneError, match=words):
        dataclasses.replace(GOOD, **changes)


A, B = slcp.Body("a", 1.0, 1.0), slcp.Body("b", 1.0, 1.0, parent="a")


@pytest.mark.parametrize("bodies, words", [
    ((A, A), r"bodies\[0\] and bodies\[1\] are both named 'a'"),
    ((B, A), "body 'b': parent is 'a', which does not come before it"),
    ((dataclasses.replace(A, parent="a"),), "parent is 'a', which does not come before it"),
    ((dataclasses.replace(A, parent="b"), B), "parent is 'b', which does not come before it"),
    ((A, dataclasses.replace(B, parent="c")), "body 'b', parent: no body named 'c'"),
    ((dataclasses.replace(A, lower=1.0, upper=0.5),), "body 'a': lower is 1.0, above upper, 0.5"),
    ((dataclasses.replace(A, joint="free", lower=(0.0, None, 1.0), upper=(None, -1.0, 0.0)),), "above upper"),
])  # fmt: skip
def test_a_tree_that_is_none(bodies, words):
    with pytest.raises(slcp.SceneError, match=words):
        slcp.Scene("s", bodies)


@pytest.mark.parametrize("make", [
    lambda: slcp.Body("", 1.0, 1.0),
    lambda: slcp.Body(3, 1.0, 1.0),
    lambda: slcp.Body("a", 1.0, 1.0, joint=[]),
    lambda: slcp.Body("a", 1.0, 1.0, parent=""),
    lambda: slcp.Body("a", 1.0, 1.0, joint="free", damping=(1.0, 2.0)),
    lambda: slcp.Shape("", "a", "disc"),
    lambda: slcp.Shape("s", 3, "disc"),
    lambda: slcp.Shape("s", "a", "square"),
    lambda: slcp.Shape("s", "a", "disc", (0.1, 0.1, 0.1)),
    lambda: slcp.Shape("s", "a", "capsule", 0.1),
    lambda: slcp.Contact("", "b"),
    lambda: slcp.Contact("a", None),
    lambda: slcp.Actuator(None),
    lambda: slcp.Actuator("a", dof=-1),
    lambda: slcp.Actuator("a", dof=True),
    lambda: slcp.Spring(1, None),
])  # fmt: skip
def test_a_part_that_is_none(make):
    with pytest.raises(slcp.SceneError):
        make()


def test_a_number_that_the_precision_does_not_hold():
    params = slcp.Parameters(GOOD).replace(mass=1e300)
    params.array(wp.float64, "cpu")
    with pytest.raises(slcp.ParameterError, match=r"mass is 1e\+300; float32 does not hold"):
        params.array(wp.float32, "cpu")
    with pytest.raises(slcp.ParameterError, match=r"step_size is 1e-60; float32 does not hold"):
        slcp.Parameters(GOOD).replace(step_size=1e-60).array(wp.float32, "cpu")
    for dtype, value in ((wp.float32, 1e-42), (wp.float64, 1e-310)):  # denormal: digits are gone
        with pytest.raises(slcp.ParameterError, match=rf"mass is {value}; {dtype.__name__} does not hold"):
            slcp.Parameters(GOOD).replace(mass=value).array(dtype, "cpu")


@pytest.mark.parametrize("attribute, words", [
    ("damping=\"-5\"", r"body .a.: damping\[0\] is -5.0; it must not be negative"),
    ('damping="nan"', "nan"),
])  # fmt: skip
def test_mjcf(tmp_path, monkeypatch, attribute, words):
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log of its warnings where it runs
    path = tmp_path / "scene.xml"
    path.write_text(f"""<mujoco><worldbody><body name="a"><joint type="hinge" axis="0 -1 0" {attribute}/>
        <geom type="sphere" size=".1" mass="1"/></body></worldbody></mujoco>""")
    with pytest.raises(slcp.MjcfError, match=rf"scene\.xml.*{words}"):
        slcp.load_mjcf(path)


@pytest.mark.parametrize("make", [
    lambda angle: slcp.Shape("floor", None, "halfplane", angle=angle),
    lambda angle: slcp.Body("arm", 1.0, 0.1, angle=angle),
])  # fmt: skip
def test_degrees_are_asked_about(make):
    """A floor of 90 radians leans by 116 degrees, which nothing else says."""
    with pytest.warns(
        RuntimeWarning, match=r"angle is 90; angles are in radians \(np.radians\(90\)\)"
    ) as told:
        make(90.0)
    assert told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make(-3.0 * np.pi)
