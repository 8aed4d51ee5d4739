"""The parameter table: every number in its own column and world."""

import numpy as np
import pytest
from parameter_checks import acts
from simulators import scene

import slcp_warp as slcp
from slcp_warp.parameters import COVARIANCES

SCENES = ("flicking_finger", "sprung", "capsules", "grasp")


def block(params, name):
    """What the kernels read of a parameter, (1 or B, *shape)."""
    start, shape = params.layout.offset(name), params.layout.shape(name)
    table = params.table()
    return table[:, start : start + int(np.prod(shape, dtype=int))].reshape((len(table), *shape))


def uncertain():
    return slcp.Simulator(scene("flicking_finger"), slcp.Options(noise="state"), device="cpu").params


def params_of(name):
    return slcp.parameters.Parameters(scene(name))


def legal(sc, key, values):
    """The values (..., *shape) as the scene can take them."""
    values = np.array(values)
    if key == "axis":  # a unit vector
        values /= np.linalg.norm(values, axis=-1, keepdims=True)
    if key == "radius":  # a disc has one
        discs = [i for i, shape in enumerate(sc.shapes) if shape.kind == "disc"]
        values[..., discs, 1] = values[..., discs, 0]
    return values


@pytest.mark.parametrize("name", SCENES)
def test_columns_do_not_overlap(name):
    params = params_of(name)
    taken = np.zeros(params.layout.width, int)
    for start, shape in ((start, shape) for _, start, shape in params.layout.columns):
        taken[start : start + int(np.prod(shape, dtype=int))] += 1
    assert (taken == 1).all()
    assert [column for column, _, _ in params.layout.columns] == list(params.names)


def test_as_many_worlds_as_components_are_told_apart_by_an_axis():
    """(n,) are the components, (n, 1) one number for each of n worlds, whatever n is."""
    params = params_of("grasp")
    count = params.layout.shape("friction")[0]
    given = np.linspace(0.2, 0.8, count)
    assert count > 1 and params.replace(friction=given).worlds is None
    for worlds in (count, count + 3):
        each = np.linspace(0.2, 0.8, worlds)
        table = block(params.replace(friction=each[:, None]), "friction")
        np.testing.assert_array_equal(table, np.tile(each[:, None], count))
    np.testing.assert_array_equal(block(params.replace(friction=each), "friction"), table)
    radius = block(params.replace(radius=np.full((4, 1, 1), 0.1)), "radius")
    assert radius.shape[0] == 4 and (radius == 0.1).all()
    with pytest.raises(slcp.InputError, match="friction has shape"):
        params.replace(friction=np.full((4, 1, 1), 0.1))


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("worlds", [2, 5])
def test_every_number_lands_in_its_own_column_and_world(name, worlds):
    """One number, one for each world, one for each component, and one for each of both."""
    params, rng = params_of(name), np.random.default_rng(0)
    before = {other: block(params, other) for other in params.names}
    for key in set(params.names) - set(COVARIANCES):
        shape = params.layout.shape(key)
        if key == "shape_angle":  # an angle that was 0 stays 0
            given = [np.where(before[key][0] == 0.0, 0.0, rng.uniform(1.0, 2.0, shape))]
        else:
            may = [acts(params.scene, key, row) for row in range(shape[0] if shape else 1)]
            may = np.reshape(may, (-1,) + (1,) * (len(shape) - 1)) if shape else True
            given = [
                np.where(may, legal(params.scene, key, rng.uniform(1.0, 2.0, size)), before[key][0])
                for size in (shape, (worlds, *shape))
            ]
            if key != "axis":
                given.append(1.5)
            if (worlds,) != shape[:1] and key != "axis":  # which would be of the items
                given.append(rng.uniform(1.0, 2.0, worlds))
        for value in given:
            changed, value = params.replace(**{key: value}), np.asarray(value)
            by_world = value.shape != shape and value.ndim > 0
            assert changed.worlds == (worlds if by_world else None)
            rows = value.reshape(worlds, *value.shape[1:], *(1,) * (len(shape) + 1 - value.ndim)) \
                if by_world else value  # fmt: skip
            rows = rows if key == "shape_angle" else np.where(may, rows, before[key][0])
            expected = np.broadcast_to(rows, (worlds if by_world else 1, *shape))
            np.testing.assert_array_equal(block(changed, key), expected, err_msg=f"{key} {value.shape}")
            for other in set(params.names) - {key}:
                now = block(changed, other)
                np.testing.assert_array_equal(now, np.broadcast_to(before[other], now.shape), err_msg=other)


def test_covariances_land_in_their_own_columns_and_worlds():
    params, rng = uncertain(), np.random.default_rng(1)
    root = rng.standard_normal((4, 3, 3))
    matrices = np.einsum("bij,bkj->bik", root, root)
    for key in COVARIANCES:
        for value, expected in (
            (2.0, 2.0 * np.eye(3)[None]),
            (np.arange(1.0, 5.0), np.arange(1.0, 5.0)[:, None, None] * np.eye(3)),
            (matrices[0], matrices[:1]),
            (matrices, matrices),
        ):
            np.testing.assert_array_equal(block(params.replace(**{key: value}), key), expected)


@pytest.mark.parametrize("name", SCENES)
def test_a_parameter_of_one_part_has_the_name_of_both(name):
    params, rng = params_of(name), np.random.default_rng(0)
    body = params.scene.bodies[-1].name
    several = params.replace(**{f"{body}.com_x": 0.1, f"{body}.mass": (each := rng.uniform(1.0, 2.0, 5))})
    mass = np.tile(params["mass"], (5, 1))
    mass[:, -1], com = each, params["com"].copy()
    com[-1, 0] = 0.1
    np.testing.assert_array_equal(several["mass"], mass)
    np.testing.assert_array_equal(several["com"], com)
    one = params.replace(**{f"{body}.mass": 3.0}, mass=2.0)
    assert one.worlds is None and one["mass"].tolist() == [2.0] * (len(params["mass"]) - 1) + [3.0]
    assert slcp.Parameters(params.scene, {f"{body}.mass": 3.0})["mass"][-1] == 3.0
    owners = [name.replace("(-)", "").replace("(+)", "") for name in params.scene.pair_names]
    for pair in set(owners[:1]):  # of several ends, all
        rough = 0.25 * (params["friction"][0] > 0.0)  # 0: built without
        found = several.replace(**{f"{pair}.friction": rough})["friction"]
        expected = np.where(np.array(owners) == pair, rough, params["friction"])
        np.testing.assert_array_equal(found, expected)


def test_a_vector_as_long_as_there_are_items_is_of_the_items():
    """Of what has two numbers for each, too: radii of three discs were those of three worlds."""
    discs = slcp.Scene(
        "discs", tuple(slcp.Body(f"b{i}", 1.0, 0.01, joint="free") for i in range(3)),
        tuple(slcp.Shape(f"d{i}", f"b{i}", "disc", 0.1) for i in range(3)),
    )  # fmt: skip
    params = slcp.Parameters(discs)
    found = params.replace(radius=[0.1, 0.2, 0.3], mass=[1.0, 2.0, 3.0])
    assert found.worlds is None and found["mass"].tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(found["radius"][:, 0], [0.1, 0.2, 0.3])
    assert params.replace(radius=[0.1, 0.2]).worlds == 2


def test_springs_in_either_order_are_two():
    bodies = tuple(slcp.Body(name, 1.0, 1.0) for name in "ab")
    springs = slcp.Spring("a", "b", stiffness=1.0), slcp.Spring("b", "a", stiffness=2.0)
    params = slcp.Parameters(slcp.Scene("s", bodies, springs=springs))
    assert params.replace(**{"a/b.spring_stiffness": 9.0})["spring_stiffness"].tolist() == [9.0, 2.0]
    both = params.replace(**{"a/b.spring_stiffness": 9.0, "b/a.spring_stiffness": 7.0})
    assert both["spring_stiffness"].tolist() == [9.0, 7.0]
    alone = slcp.Parameters(slcp.Scene("s", bodies, springs=springs[:1]))
    assert alone.replace(**{"b/a.spring_stiffness": 9.0})["spring_stiffness"].tolist() == [9.0]


@pytest.mark.parametrize("key, value, message", [
    ("cup.mass", 1.0, r"parameters names 'cup\.mass'; there are link1\.mass"),
    ("link1.masss", 1.0, "no parameter 'masss'"), ("link1.mass", -1.0, "link1.mass is -1.0; it must be pos"),
    ("link1.com_x", np.zeros((2, 2)), r"link1\.com_x has shape \(2, 2\); a number, or \(B,\)"),
    ("link1.mass", [1.0, 2.0], "link1.mass is for 2 worlds, other numbers are for 3"),
])  # fmt: skip
def test_what_one_part_cannot_have_is_refused(key, value, message):
    params = params_of("flicking_finger").replace(mass=np.ones((3, 3)) + np.arange(3)[:, None])
    with pytest.raises(slcp.ParameterError, match=message):
        params.replace(**{key: value})


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_table_gives_back_what_made_it_by_name(name, dtype):
    params, rng = params_of(name), np.random.default_rng(3)
    mass = params["mass"] * rng.uniform(0.5, 2.0, (4, len(params["mass"])))
    made = params.replace(mass=mass, step_size=rng.uniform(0.01, 0.1, 4))
    found = params.from_table(made.table().astype(dtype))
    assert found.worlds == 4 and all(n in found.names for n in made.names)
    np.testing.assert_array_equal(found["mass"], mass.astype(dtype))
    for n in set(params.names) - {"mass", "step_size"}:
        np.testing.assert_array_equal(found[n], params[n])  # shared, unrounded


@pytest.mark.parametrize("table", [np.zeros(4), np.zeros((2, 3)), np.zeros((0, 3)), "rows"])
def test_what_is_no_table_is_refused(table):
    with pytest.raises(slcp.parameters.ParameterError, match="table"):
        params_of("grasp").from_table(table)


def test_a_name_that_is_none_is_refused():
    with pytest.raises(slcp.ParameterError, match="no parameter 1; there are"):
        slcp.Parameters(scene("grasp"), {1: 2.0})


def test_a_table_of_illegal_numbers_is_refused():
    params = params_of("grasp")
    table = params.table()
    table[0, params.layout.offset("mass")] = -1.0
    with pytest.raises(slcp.parameters.ParameterError, match="mass"):
        params.from_table(table)
