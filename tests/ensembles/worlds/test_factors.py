"""Numbers of a world that are factors from an interval; one draw of what is measured alike, or by factor."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import measures as m

SCENE = slcp.scenes.push_block()


def drawn(parameters, count=4000, **changes):
    task = slcp.Task(
        "push", SCENE, duration=0.1, disturbances=slcp.Disturbances(parameters=parameters, **changes),
        measures={"x": m.final("block.x")},
    )  # fmt: skip
    worlds = slcp.draw_worlds(task, count, dtype="float64", device="cpu")
    table, plain = slcp.Parameters(SCENE).from_table(worlds.params), slcp.Parameters(SCENE)
    found = {name: table[name] / plain[name] for name in ("mass", "inertia")}
    return task, found | {"radius": table["radius"]}


def test_factors_are_even_and_shared():
    _, found = drawn(
        {"block.mass, block.inertia": slcp.UniformFactor(0.7, 1.3), "radius": slcp.UniformFactor(0.5, 2.0)}
    )
    block = [body.name for body in SCENE.bodies].index("block")
    factor = found["mass"][:, block]
    np.testing.assert_allclose(found["inertia"][:, block], factor, rtol=1e-12)
    assert 0.7 <= factor.min() < 0.705 and 1.295 < factor.max() <= 1.3
    counts, _ = np.histogram(factor, 8, (0.7, 1.3))
    assert ((counts - 500.0) ** 2 / 500.0).sum() < 24.3  # chi squared of 7, 99.9 %
    other = np.delete(found["mass"], block, 1)
    np.testing.assert_array_equal(other, 1.0)
    size = found["radius"][:, [shape.name for shape in SCENE.shapes].index("pusher"), 0]
    size = size / next(shape.radius for shape in SCENE.shapes if shape.name == "pusher")
    assert 0.5 <= size.min() < 0.51 and abs(np.corrcoef(size, factor)[0, 1]) < 0.06


def test_a_factor_of_one_is_no_draw():
    task, found = drawn({"block.mass": slcp.UniformFactor(2.0, 2.0)}, 8)
    np.testing.assert_array_equal(found["mass"].max(axis=1), 2.0)
    report = slcp.sweep(task, slcp.policies.Linear(np.zeros((1, 8)), SCENE.x0, [0.0]), worlds=4, device="cpu")
    assert not any(name.startswith("drawn_") for name in report.table)


def test_files_keep_factors(tmp_path):
    task, _ = drawn({"mass": slcp.UniformFactor(0.7, 1.3, shared=True)}, 2)
    slcp.save_task(task, tmp_path / "push.json")
    assert slcp.load_task(tmp_path / "push.json").disturbances == task.disturbances


@pytest.mark.parametrize(
    "make, text",
    [
        (lambda: slcp.UniformFactor(0.0, 1.0), "UniformFactor.low is 0.0"),
        (
            lambda: slcp.Worlds(np.zeros((1, 8)), slcp.Parameters(SCENE)),
            "params is Parameters; their rows are",
        ),
        (lambda: slcp.UniformFactor(1.5, 1.0), "UniformFactor.high is 1.0"),
        (lambda: drawn({"block.com": slcp.UniformFactor(0.5, 1.0)}), "com takes normal or uniform"),
        (lambda: drawn({"restitution": slcp.UniformFactor(0.5, 1.0)}), "restitution takes uniform"),
        (lambda: drawn({}, start={"block.x": slcp.UniformFactor(0.5, 1.0)}), "factors are of parameters"),
        (
            lambda: drawn({"block.mass, block.inertia": slcp.Uniform(0.2, 0.4)}),
            r"one number for what is measured in kg and in kg m\^2; a UniformFactor or LogNormal",
        ),
        (lambda: drawn({"block.mass, pusher.radius": slcp.Uniform(0.2, 0.4)}), "measured in kg and in m;"),
    ],
)
def test_what_is_no_factor_is_refused(make, text):
    with pytest.raises(slcp.InputError, match=text):
        make()


def test_lengths_may_be_one_number():
    _, found = drawn({"pusher.radius, block.com_x": slcp.Uniform(0.01, 0.02)}, 4)
    assert np.ptp(found["radius"]) > 0.0


def test_a_draw_of_many_numbers_has_the_name_that_it_was_given():
    several = "block.mass, block.inertia"
    task, _ = drawn({several: 0.1, "friction": slcp.Uniform(0.2, 0.6, shared=True), "pusher.mass": 0.1}, 2)
    found = slcp.sensitivity(
        task, slcp.policies.Linear(np.zeros((1, 8)), SCENE.x0, [9.0]), measure="x", samples=64
    )
    assert set(found.names) == {several, "friction", "pusher.mass"}


def test_numbers_of_all_corners_are_told_once():
    """By the names of the shapes; corners with numbers of their own one by one, and given worlds alike."""
    pad = {"kind": "rectangle", "radius": (0.1, 0.2), "corner_radius": 0.01}
    shapes = (slcp.Shape("floor", None, "halfplane", angle=np.pi / 2), slcp.Shape("pad", "pad", **pad))
    body = slcp.Body("pad", 1.0, 0.1, joint="free")
    scene = slcp.Scene(
        "pad", (body,), shapes, (slcp.Contact("floor", "pad", 0.5),), initial_state={"pad.y": 0.2}
    )
    push = slcp.policies.Linear(np.zeros((0, 6)), scene.x0, [])

    def told(law, worlds):
        drawn = slcp.Disturbances(parameters={"friction": law})
        task = slcp.Task("pad", scene, duration=0.02, disturbances=drawn, measures={"x": m.final("pad.x")})
        given = slcp.draw_worlds(task, 8, device="cpu") if worlds is None else worlds
        found = slcp.sweep(task, push, worlds=given, device="cpu", cases=slcp.Options("hard")).part("policy")
        return [name for name in found if name.startswith("drawn_")], found

    corners = [f"drawn_floor/pad({i}).friction" for i in range(4)]
    for worlds in (8, None):
        names, found = told(slcp.Uniform(0.2, 0.8, shared=True), worlds)
        assert names == ["drawn_floor/pad.friction"] and np.ptp(found[names[0]]) > 0.1
        assert told(slcp.Uniform(0.2, 0.8), worlds)[0] == corners


def test_two_names_as_narrow_as_each_other_are_refused():
    """Of two boxes that touch the friction with each other would be the last one's."""
    ground = slcp.Shape("g", None, "halfplane", angle=np.pi / 2)
    bodies = tuple(slcp.Body(name, 1.0, 0.01, joint="free") for name in ("a", "b"))
    boxes = [slcp.Shape(name, name, "rectangle", (0.1, 0.1), corner_radius=0.01) for name in ("a", "b")]
    scene = slcp.Scene("row", bodies, (ground, *boxes), contacts="auto", friction=0.5)
    laws = {"a.friction": slcp.Uniform(0.2, 0.3), "b.friction": slcp.Uniform(0.7, 0.8)}

    def task(**more):
        drawn = slcp.Disturbances(parameters={**laws, **more})
        return slcp.Task("row", scene, duration=0.1, disturbances=drawn)

    with pytest.raises(
        slcp.InputError, match="names 'a.friction' and 'b.friction', which both are of 'a.*/b"
    ):
        task()
    worlds = slcp.draw_worlds(task(**{"a/b.friction": slcp.Uniform(0.5, 0.6)}), 5)
    params = slcp.Simulator(scene).params
    start = next(start for name, start, _ in params.layout.columns if name == "friction")
    for i, name in enumerate(scene.pair_names):
        ground_of = {"g/a": (0.2, 0.3), "g/b": (0.7, 0.8)}.get(name[:3], (0.5, 0.6))
        drawn = np.asarray(worlds.params)[:, start + i]
        assert (drawn >= ground_of[0]).all() and (drawn <= ground_of[1]).all(), name
