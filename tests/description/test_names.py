"""Names of states, controls, pairs and rows: as many as there are, unique, each on its own component."""

import dataclasses

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp.scenes import NAMED

CART = slcp.Scene(
    "cart",
    (
        slcp.Body("cart", 1.0, 0.1, joint="prismatic", lower=-1.0, upper=1.0),
        slcp.Body("pole", 0.1, 0.01, parent="cart", upper=2.0),
        slcp.Body("ball", 1.0, 0.1, joint="free"),
    ),
    (
        slcp.Shape("rod", "pole", "capsule", (0.05, 0.4)),
        slcp.Shape("skin", "ball", "disc", 0.1),
        slcp.Shape("floor", None, "halfplane", 0.0, (0.0, -5.0), np.pi / 2),
    ),
    (slcp.Contact("rod", "skin"), slcp.Contact("floor", "rod", 0.5)),
    (slcp.Actuator("cart"), slcp.Actuator("ball", 2), slcp.Actuator("cart")),
)


def test_names_follow_the_bodies_and_their_joints():
    assert CART.state_names == (
        *("cart.shift", "pole.angle", "ball.x", "ball.y", "ball.angle"),
        *("cart.vshift", "pole.vangle", "ball.vx", "ball.vy", "ball.vangle"),
    )
    assert CART.state_units == ("m", "rad", "m", "m", "rad", "m/s", "rad/s", "m/s", "m/s", "rad/s")
    assert CART.control_names == ("cart.shift", "ball.angle", "cart.shift#2")
    assert CART.pair_names == ("rod/skin", "floor/rod(-)", "floor/rod(+)")
    assert [CART.pair_index(pair) for pair in ("rod/skin", "skin/rod", "rod(-)/floor", 2)] == [0, 0, 1, 2]
    with pytest.raises(slcp.InputError, match="contact pair is 'skin/floor'; there are rod/skin"):
        CART.pair_index("skin/floor")
    assert CART.row_names == (
        *("cart.shift lower", "cart.shift upper", "pole.angle upper", "rod/skin"),
        *("floor/rod(-) +", "floor/rod(-) -", "floor/rod(+) +", "floor/rod(+) -"),
    )


@pytest.mark.parametrize("name", NAMED)
def test_there_is_one_name_for_each_component(name):
    scene = getattr(slcp.scenes, name)()
    s = scene.structure
    for names, count in (
        (scene.state_names, 2 * s.nv),
        (scene.control_names, s.nu),
        (scene.pair_names, len(s.pairs)),
        (scene.row_names, s.nr),
    ):
        assert len(names) == len(set(names)) == count


def test_a_name_stands_for_its_own_component():
    """A body that is moved by name moves where it is, and by nothing else."""
    sim = slcp.Simulator(CART, dtype="float64", device="cpu")
    still = {name: 0.0 for name in CART.state_names} | {"ball.y": 3.0, "pole.angle": 0.3}
    x = CART.state(still | {"ball.vx": 2.0})
    after = sim.step(x, np.zeros(3)).state
    assert after[CART.state_index("ball.x")] == pytest.approx(2.0 * CART.step_size, rel=1e-12)
    assert after[CART.state_index("ball.vy")] == pytest.approx(-9.81 * CART.step_size, rel=1e-12)
    u = np.zeros(3)
    u[CART.control_index("ball.angle")] = 5.0
    turned = sim.step(x, u).state[CART.state_index("ball.vangle")]
    assert turned == pytest.approx(5.0 / 0.1 * CART.step_size, rel=1e-12)


def test_states_by_name_leave_the_others():
    base = np.arange(10.0)
    assert np.array_equal(CART.state({}, base), base)
    assert np.array_equal(np.flatnonzero(CART.state({"ball.vy": -1.0}, base) != base), [8])
    assert CART.state({"pole.angle": 0.5})[1] == 0.5 and base[8] == 8.0


@pytest.mark.parametrize(
    "call, kind, text",
    [
        (
            lambda: CART.state_index("ball.z"),
            slcp.ArgumentError,
            "'ball.z'; there are cart.shift,",
        ),
        (lambda: CART.state_index(10), slcp.ArgumentError, "is 10; a number from 0 to 9"),
        (lambda: CART.control_index(-1), slcp.ArgumentError, "is -1; a number from 0 to 2"),
        (lambda: CART.state_index(True), slcp.ArgumentTypeError, "is True; a name or a whole number"),
        (lambda: CART.state({"ball.x": "far"}), slcp.InputError, "'ball.x'"),
        (lambda: CART.state({"ball.x": float("nan")}), slcp.InputError, "'ball.x'"),
        (lambda: CART.state([("ball.x", 1.0)]), slcp.ArgumentTypeError, "values is"),
        (lambda: CART.state({}, np.zeros(3)), slcp.InputError, "base"),
    ],
)
def test_what_has_no_place_is_refused(call, kind, text):
    with pytest.raises(kind, match=text.replace(".", r"\.")):
        call()


def test_an_unknown_name_among_thousands_is_a_short_error():
    heap = slcp.scenes.heap(60)
    with pytest.raises(slcp.ArgumentError, match="there are 1,830, disc1.*like it$") as caught:
        slcp.measures.gap("disc10/disk1").place(heap)
    assert len(str(caught.value)) < 150
    with pytest.raises(slcp.ArgumentError, match="there are 360, as disc0.x$"):
        heap.state_index("?")


def boxes_on_a_floor():
    """Two boxes on a floor and beside each other, of four corners each: pairs of shapes are many."""
    bodies = tuple(slcp.Body(name, 1.0, 0.01, joint="free") for name in ("left", "right"))
    corners = {name: slcp.box(name[0], name, width=0.2, height=0.2) for name in ("left", "right")}
    floor = slcp.Shape("floor", None, "halfplane", angle=np.pi / 2)
    contacts = (
        *slcp.touching(corners["left"], (floor,), friction=0.4),
        *slcp.touching(corners["right"], (floor,), friction=0.4),
        *slcp.touching(corners["left"], corners["right"], friction=0.3),
    )
    return slcp.Scene("boxes", bodies, (floor, *corners["left"], *corners["right"]), contacts)


@pytest.mark.parametrize(
    ("name", "of"),
    [
        ("floor/left", lambda a, b: {a, b} == {"floor", "left"}),
        ("right/left", lambda a, b: {a, b} == {"left", "right"}),
        ("left", lambda a, b: "left" in (a, b)),
        ("floor", lambda a, b: "floor" in (a, b)),
        ("l0/right", None),
    ],
)
def test_friction_of_bodies_is_that_of_all_pairs_of_their_shapes(name, of):
    scene = boxes_on_a_floor()
    shapes = scene.shapes
    pairs = [[shapes[s] for s in (p.shape_a, p.shape_b)] for p in scene.structure.pairs]
    owners = [[s.body or s.name for s in pair] for pair in pairs]
    if of is None:
        mine = [any(s.name == "l0" for s in pair) and "right" in own for pair, own in zip(pairs, owners)]
    else:
        mine = [of(*own) for own in owners]
    before = slcp.Parameters(scene)
    after = before.replace(**{f"{name}.friction": 0.7})["friction"]
    np.testing.assert_array_equal(after, np.where(mine, 0.7, before["friction"]))
    assert 0 < sum(mine) < len(mine)
    np.testing.assert_array_equal(before[f"{name}.friction"], before["friction"][np.array(mine)])
    law = slcp.Uniform(0.1, 0.9, shared=True)
    drawn = slcp.draw_worlds(
        slcp.Task("drawn", scene, duration=0.1,
                  disturbances=slcp.Disturbances(parameters={f"{name}.friction": law})), 5,
    )  # fmt: skip
    friction = before.from_table(np.asarray(drawn.params, float))["friction"]
    assert (np.ptp(friction[:, np.array(mine)], axis=1) == 0.0).all() and np.ptp(
        friction[:, mine.index(True)]
    ) > 0.01
    np.testing.assert_allclose(
        friction[:, ~np.array(mine)], before["friction"][~np.array(mine)] + np.zeros((5, 1))
    )


def test_friction_of_what_does_not_touch_is_refused():
    scene = boxes_on_a_floor()
    for name in ("left/left", "floor/floor", "floor/middle", "middle"):
        with pytest.raises(slcp.InputError, match=f"names '{name}.friction'"):
            slcp.Parameters(scene).replace(**{f"{name}.friction": 0.7})
    with pytest.raises(slcp.InputError, match="which are the same; leave one out"):
        slcp.Parameters(scene).replace(**{"floor/left.friction": 0.7, "left/floor.friction": 0.6})


def test_a_scene_begins_with_numbers_by_name(tmp_path):
    named = dataclasses.replace(CART, initial_state={"ball.vy": -1.0, "pole.angle": 0.5})
    assert np.array_equal(named.x0, CART.state({"ball.vy": -1.0, "pole.angle": 0.5}, np.zeros(10)))
    slcp.save_scene(named, tmp_path / "cart.json")
    assert slcp.load_scene(tmp_path / "cart.json") == named
    text = 'format = "slcp-scene"\nversion = 3\nname = "rod"\ninitial_state = {STATE}\n'
    text += 'bodies = [{ name = "rod", mass = 1.0, inertia = 0.1 }]\n'
    path = tmp_path / "rod.toml"
    path.write_text(text.replace("STATE", '"rod.vangle" = 2.0'))
    assert slcp.load_scene(path).initial_state == (0.0, 2.0)
    for given, message in (({"rod.x": 1.0}, "'rod.x'; there are"), ({"rod.angle": np.nan}, "holds nan")):
        with pytest.raises(slcp.SceneError, match=f"initial_state: .*{message}"):
            dataclasses.replace(slcp.load_scene(path), initial_state=given)
    path.write_text(text.replace("{STATE}", "2.0"))
    with pytest.raises(slcp.SceneFileError, match="a list is needed, or a table of numbers by name"):
        slcp.load_scene(path)
