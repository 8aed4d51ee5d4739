"""Rectangles in scenes, files, parameters and pictures."""

import json

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp.ensembles.worlds.corners import columns_of_corners
from slcp_warp.results.pictures.mechanism import Mechanism, outline


def scene():
    shapes = (
        Shape("ground", None, "halfplane", angle=np.pi / 2),
        Shape("wall", None, "rectangle", (0.1, 0.5), offset=(1.0, 0.5)),
        Shape("block", "a", "rectangle", (0.2, 0.1), offset=(0.02, 0.0), angle=0.1, corner_radius=0.03),
        Shape("rod", "b", "capsule", (0.02, 0.2)),
        Shape("ball", "b", "disc", 0.05),
    )
    bodies = (Body("a", 1.0, 0.02, joint="free"), Body("b", 0.5, 0.01, joint="free"))
    return Scene("blocks", bodies, shapes, contacts="auto", friction=0.5)


def test_pairs_and_their_names():
    """Four corners on a plane; with a disc one pair, six with a capsule, eight between two."""
    names = scene().pair_names

    def count(a, b):
        return sum({side.split("(")[0] for side in name.split("/")} == {a, b} for name in names)

    found = [count("block", other) for other in ("ground", "ball", "rod", "wall")]
    assert found == [4, 1, 6, 8]
    assert [f"ground/block({i})" for i in range(4)] == [n for n in names if n.startswith("ground/block")]


def test_corners_are_numbered_from_the_lower_left():
    sim = slcp.Simulator(scene(), slcp.Options("hard"), device="cpu", strategy="generic")
    x = np.zeros(12)
    x[1], x[3:5] = 2.0, (-5.0, 5.0)
    gap = dict(zip(sim.scene.row_names, sim.step(x).gap))
    c, s = np.cos(0.1), np.sin(0.1)
    for i, (along, up) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
        height = 2.0 + s * along * 0.17 + c * up * 0.07 - 0.03
        assert gap[f"ground/block({i}) +"] == pytest.approx(height, abs=1e-12)


def test_numbers_have_names_and_bounds():
    sim = slcp.Simulator(scene(), device="cpu", strategy="generic")
    moved = sim.params.replace(**{"block.corner_radius": 0.05, "block.radius": 0.3})
    assert moved["block.corner_radius"] == 0.05 and moved["wall.corner_radius"] == 0.0
    assert (moved["block.radius"] == 0.3).all()
    friction = sim.params.replace(**{"ground/block.friction": 0.9})["friction"]
    assert [n for n, mu in zip(sim.scene.pair_names, friction) if mu == 0.9] == [
        f"ground/block({i})" for i in range(4)]  # fmt: skip
    with pytest.raises(slcp.ParameterError, match="corner_radius of 'block' is 0.11; at most half"):
        sim.params.replace(**{"block.corner_radius": 0.11})
    with pytest.raises(slcp.ParameterError, match="corner_radius of 'block' is 0.03; at most half .* 0.02"):
        sim.params.replace(**{"block.radius": np.array([0.2, 0.02])})
    with pytest.raises(
        slcp.ParameterError, match="corner_radius of 'ball' is 0.01; it was built without corn"
    ):
        sim.params.replace(**{"ball.corner_radius": 0.01})
    with pytest.raises(slcp.ParameterError, match="no parameter 'corner_radius'"):
        slcp.Simulator(slcp.scenes.particle(), device="cpu").params.replace(corner_radius=0.1)


@pytest.mark.parametrize("make, message", [
    (lambda: Shape("s", "a", "rectangle", 0.2), r"0.2; a rectangle needs \(half width, half height\)"),
    (lambda: Shape("s", "a", "rectangle", (0.2, 0.0)), "radius is 0.0; a rectangle's must be positive"),
    (lambda: Shape("s", "a", "rectangle", (0.2, 0.1), corner_radius=0.11), "is 0.11; at most half"),
    (lambda: Shape("s", "a", "rectangle", (0.2, 0.1), corner_radius=-0.1), "corner_radius is -0.1"),
    (lambda: Shape("s", "a", "disc", 0.1, corner_radius=0.1), "corner_radius is 0.1; a disc has no corners"),
])  # fmt: skip
def test_what_cannot_be_is_named(make, message):
    with pytest.raises(slcp.SceneError, match=message):
        make()


@pytest.mark.parametrize("other", [
    Shape("other", "b", "rectangle", (0.1, 0.1)),
    Shape("other", "b", "disc", 0.0),
])  # fmt: skip
def test_two_sharp_corners_have_no_normal(other):
    one = Shape("one", "a", "rectangle", (0.2, 0.1))
    bodies = scene().bodies
    for contacts in ("auto", (Contact("one", "other"),)):
        with pytest.raises(slcp.SceneError, match="'one' - 'other': both have sharp corners"):
            Scene("sharp", bodies, (one, other), contacts)


def test_an_ellipse_is_refused():
    shapes = (Shape("r", "a", "rectangle", (0.2, 0.1)), Shape("e", "b", "ellipse", (0.2, 0.1)))
    with pytest.raises(slcp.SceneError, match="rectangle 'r' and ellipse 'e' cannot touch; a rec"):
        Scene("egg", scene().bodies, shapes, "auto")
    with pytest.raises(slcp.SceneError, match="a rectangle and an ellipse cannot touch"):
        Scene("egg", scene().bodies, shapes, (Contact("e", "r"),))


def test_files_keep_them(tmp_path):
    first, path = scene(), tmp_path / "blocks.json"
    slcp.save_scene(first, path)
    assert slcp.load_scene(path) == first
    written = {s["name"]: s for s in json.loads(path.read_text())["shapes"]}
    assert written["block"]["corner_radius"] == 0.03
    lines = ['format = "slcp-scene"', "version = 3", 'name = "one"', "[[bodies]]", 'name = "a"', "mass = 1.0",
             "inertia = 0.1", "[[shapes]]", 'name = "s"', 'body = "a"', 'kind = "rectangle"',
             "radius = [0.2, 0.1]", "corner_radius = 0.05"]  # fmt: skip
    path = tmp_path / "one.toml"
    path.write_text("\n".join(lines))
    assert slcp.load_scene(path).shapes == (Shape("s", "a", "rectangle", (0.2, 0.1), corner_radius=0.05),)


@pytest.mark.parametrize("corner", [0.0, 0.05, 0.1])
def test_the_outline_is_closed_and_round(corner):
    """Its area is that of a rectangle less what the corners leave out, its ends are the half sizes."""
    x, y = outline("rectangle", np.array([0.2, 0.1, corner]), 1.0).T
    area = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
    assert area == pytest.approx(0.08 - (4.0 - np.pi) * corner**2, abs=3e-4)
    np.testing.assert_allclose([x.max(), -x.min(), y.max(), -y.min()], [0.2, 0.2, 0.1, 0.1], atol=1e-12)


def test_pictures_leave_room_for_corners():
    first = scene()
    mechanism = Mechanism(first, first.default_parameters())
    left, right, bottom, top = mechanism.bounds(first.x0[None, :6], margin=0.0)
    assert right >= 1.1 and top >= 1.0 and left <= -0.18 and bottom <= -0.1
    np.testing.assert_array_equal(mechanism.size(2), [0.2, 0.1, 0.03])
    np.testing.assert_array_equal(mechanism.size(4), [0.05, 0.05])


def test_many_pairs_of_one_body_have_generic_kernels_on_a_cpu():
    """Twelve take minutes to compile for themselves; four corners on the ground do not."""
    ground, wall, block, *_ = scene().shapes
    body = scene().bodies[:1]
    few, many = (
        Scene("block", body, shapes, "auto", friction=0.5)
        for shapes in ((ground, block), (ground, wall, block))
    )
    assert [len(each.pair_names) for each in (few, many)] == [4, 12]
    assert [slcp.Simulator(each, device="cpu").strategy for each in (few, many)] == ["specialised", "generic"]


@pytest.mark.parametrize("strategy", ["generic", "specialised"])
def test_a_corner_radius_that_is_drawn_stays_within_the_size(strategy):
    """What is drawn beyond half a side, which `replace` and maps refuse, is half of it, in the table, too."""
    ground, _, block, *_ = scene().shapes
    block = Shape("block", "a", "rectangle", (0.1, 0.06), corner_radius=0.03)
    own = Scene("box", scene().bodies[:1], (ground, block), "auto", friction=0.5)
    drawn = slcp.Disturbances(parameters={"block.corner_radius": slcp.LogNormal(1.5)})
    task = slcp.Task(
        "box", own, duration=1.0, start=np.array([[0.0, 0.061, 0.0, 0, 0, 0]]), disturbances=drawn,
        measures={"height": slcp.measures.final("a.y")},
    )  # fmt: skip
    none = {"none": slcp.policies.Linear(np.zeros((0, 6)))}
    how = {"cases": slcp.Options("hard"), "dtype": "float64", "device": "cpu", "strategy": strategy}
    report = slcp.sweep(task, none, worlds=32, **how)
    part = report.part("none")
    corner = part["drawn_block.corner_radius"]
    assert corner.max() == np.float32(0.06) and corner.min() < 0.03 and not part["status"].any()
    np.testing.assert_allclose(part["height"], 0.06, atol=1e-6)
    slcp.Parameters(own).replace(**{"block.corner_radius": corner})
    worlds = slcp.draw_worlds(task, 32, dtype="float64")
    found = slcp.Parameters(own).from_table(worlds.params)["block.corner_radius"]
    np.testing.assert_allclose(found, corner, rtol=1e-6)
    worlds.params[:, columns_of_corners(own.structure)[0, 0]] *= 100.0
    again = slcp.sweep(task, none, worlds=worlds, **how).part("none")
    assert "drawn_block.corner_radius" not in again  # of all alike: half the height
    for axis in (("block.corner_radius=", [0.05, 0.1]), ("block.corner_radius", [1.0, 3.0])):
        with pytest.raises(slcp.ArgumentError, match="half of the shorter side is needed, 0.06"):
            slcp.robustness_map(task, none, axis, ("a.y", [0.0]), worlds=2)


def test_both_sizes_of_one_are_drawn_apart_by_their_names():
    """Together by "radius", whose shapes keep their proportions."""
    own = Scene("box", scene().bodies[:1], (scene().shapes[0], scene().shapes[2]), "auto", friction=0.5)
    name = own.shapes[1].name

    def drawn(**parameters):
        disturbed = slcp.Disturbances(parameters={f"{name}.{key}": law for key, law in parameters.items()})
        task = slcp.Task("box", own, start=np.zeros(6), duration=1.0, disturbances=disturbed)
        table = slcp.draw_worlds(task, 400, dtype="float64").params
        return slcp.Parameters(own).from_table(table)[f"{name}.radius"]

    base = np.array(own.shapes[1].radius)
    both = drawn(radius=0.2) / base
    np.testing.assert_allclose(both[:, 0], both[:, 1])
    one = drawn(radius_0=slcp.Uniform(0.1, 0.3))
    assert one[:, 0].min() < 0.11 and one[:, 0].max() > 0.29 and (one[:, 1] == base[1]).all()
    apart = np.log(drawn(radius_0=0.2, radius_1=0.1) / base)
    np.testing.assert_allclose(apart.std(axis=0), [0.2, 0.1], rtol=0.15)
    assert abs(np.corrcoef(apart.T)[0, 1]) < 0.15
    for law, message in (
        (slcp.Uniform(0.0, 0.1), "positive numbers"),
        (slcp.Normal(0.1), "log-normal or uniform"),
    ):
        with pytest.raises(slcp.ArgumentError, match=message):
            drawn(radius_0=law)
    ball = Scene("ball", own.bodies, (own.shapes[0], Shape("ball", own.bodies[0].name, "disc", 0.1)), "auto")
    disturbed = slcp.Disturbances(parameters={"ball.radius_0": 0.1})
    with pytest.raises(slcp.ArgumentError, match="'ball' is a disc, without two sizes"):
        slcp.draw_worlds(slcp.Task("ball", ball, start=np.zeros(6), duration=1.0, disturbances=disturbed), 2)


def test_both_sizes_of_one_have_names():
    sim = slcp.Simulator(scene(), device="cpu", strategy="generic")
    moved = sim.params.replace(**{"block.radius_0": 0.3, "block.radius_1": 0.15})
    np.testing.assert_array_equal(moved["block.radius"], [0.3, 0.15])
    with pytest.raises(slcp.ParameterError, match="half of the shorter side is needed, 0.02"):
        sim.params.replace(**{"block.radius_1": 0.02})
