"""`contacts="auto"`: which pairs it makes, against MuJoCo's own filters; at every door; its limits."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Shape
from slcp_warp.description import auto_contacts

GROUND = Shape("ground", None, "halfplane", angle=math.pi / 2)


def random_auto(rng):
    """A random tree, one or two discs or capsules on each body, two shapes of the world, random bits."""
    bodies, shapes = [], [dataclasses.replace(GROUND, **numbers(rng)),
                          Shape("post", None, "disc", 0.3, **numbers(rng))]  # fmt: skip
    for i in range(int(rng.integers(2, 7))):
        parent = None if rng.random() < 0.4 else bodies[rng.integers(i)].name if i else None
        joint = "free" if parent is None and rng.random() < 0.5 else "revolute"
        bodies.append(Body(f"b{i}", 1.0, 0.1, parent=parent, joint=joint))
        for j in range(int(rng.integers(1, 3))):
            kind, size = ("disc", 0.2) if rng.random() < 0.6 else ("capsule", (0.1, 0.3))
            shapes.append(Shape(f"s{i}_{j}", f"b{i}", kind, size, **numbers(rng)))
    couples = list(itertools.combinations([b.name for b in bodies], 2))
    excluded = tuple(couples[k] for k in rng.permutation(len(couples))[: rng.integers(0, 3)])
    return slcp.Scene("random", tuple(bodies), tuple(shapes), "auto", excluded=excluded)


def numbers(rng):
    return {"contype": int(rng.choice([0, 1, 2, 3], p=[0.15, 0.5, 0.15, 0.2])),
            "conaffinity": int(rng.choice([0, 1, 2, 3], p=[0.15, 0.5, 0.15, 0.2])),
            "friction": round(float(rng.uniform(0.1, 1.0)), 3)}  # fmt: skip


def mjcf(scene, *off):
    """The scene as MJCF, in the plane xz, with flags that are off."""

    def geom(shape):
        size = np.atleast_1d(shape.radius)
        form = {
            "disc": f'type="sphere" size="{size[0]}"',
            "capsule": f'type="capsule" zaxis="1 0 0" size="{size[0]} {size[-1]}"',
            "halfplane": 'type="plane" size="5 5 1"',
        }[shape.kind]
        return (f'<geom name="{shape.name}" {form} contype="{shape.contype}" friction="{shape.friction}" '
                f'conaffinity="{shape.conaffinity}"/>')  # fmt: skip

    def inside(name):
        text = "".join(geom(s) for s in scene.shapes if s.body == name)
        for body in (b for b in scene.bodies if b.parent == name):
            slides = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
            joints = (slides if body.joint == "free" else "") + '<joint type="hinge" axis="0 -1 0"/>'
            inertia = '<inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>'
            text += f'<body name="{body.name}">{inertia}{joints}{inside(body.name)}</body>'
        return text

    excludes = "".join(f'<exclude body1="{a}" body2="{b}"/>' for a, b in scene.excluded)
    flags = "".join(f' {name}="disable"' for name in off)
    return (f"<mujoco><option><flag{flags}/></option><worldbody>{inside(None)}</worldbody>"
            f"<contact>{excludes}</contact></mujoco>")  # fmt: skip


def friction_by_pair(scene):
    return {frozenset((c.shape_a, c.shape_b)): c.friction for c in scene.all_contacts}


def of_mujoco(text):
    """Friction by pair of MuJoCo's contacts. All shapes overlap at q = 0, so its filters alone decide."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return {frozenset(model.geom(int(g)).name for g in (c.geom1, c.geom2)): float(c.friction[0])
            for c in data.contact}  # fmt: skip


@pytest.mark.parametrize("seed", range(12))
def test_pairs_and_friction_are_those_of_mujoco(seed, tmp_path):
    scene = random_auto(np.random.default_rng(seed))
    meets = tuple(dataclasses.replace(body, touches_parent=True) for body in scene.bodies)
    meeting = dataclasses.replace(scene, bodies=meets)
    path = tmp_path / "scene.xml"
    for ours, flags in ((scene, ()), (meeting, ("filterparent",))):
        path.write_text(mjcf(scene, *flags))
        theirs = pytest.approx(of_mujoco(path.read_text()))
        assert friction_by_pair(ours) == theirs and friction_by_pair(slcp.load_mjcf(path)) == theirs
    path.write_text(mjcf(scene, "contact"))
    assert not of_mujoco(path.read_text()) and not slcp.load_mjcf(path).all_contacts


def test_everything_of_mjcf_is_auto(tmp_path):
    """A plain model, in which everything collides, stays "auto", so that its file is as short."""
    pytest.importorskip("mujoco")
    plain = slcp.scenes.heap(30)
    shapes = tuple(dataclasses.replace(s, contype=1, friction=0.5) for s in plain.shapes)
    plain = dataclasses.replace(plain, shapes=shapes, friction=None, excluded=(("disc0", "disc1"),))
    path = tmp_path / "heap.xml"
    path.write_text(mjcf(plain))
    read = slcp.load_mjcf(path)
    assert read.contacts == "auto" and friction_by_pair(read) == friction_by_pair(plain)
    slcp.save_scene(read, tmp_path / "heap.json")
    again = slcp.load_scene(tmp_path / "heap.json")
    assert again == read and again.structure == read.structure and again.contacts == "auto"


def test_every_bit_of_mjcf_may_be_set(tmp_path):
    """-1 is all bits, the last of which is no bit of ours; a pair by that bit alone is listed."""
    pytest.importorskip("mujoco")
    scene = slcp.scenes.heap(2).with_listed_contacts()
    shapes = tuple(dataclasses.replace(s, contype=7, friction=0.5) for s in scene.shapes)
    text = mjcf(dataclasses.replace(scene, shapes=shapes, contacts="auto"))
    for bits, contacts in ((-1, "auto"), (-(2**31), "listed")):
        path = tmp_path / "bits.xml"
        path.write_text(text.replace('contype="7"', f'contype="{bits}"').replace(
            'conaffinity="1"', 'conaffinity="-1"'))  # fmt: skip
        read = slcp.load_mjcf(path)
        assert read.pair_names == scene.pair_names and (read.contacts == "auto") == (contacts == "auto")


def test_a_joint_keeps_shapes_apart_unless_it_says_otherwise():
    arm = (Body("upper", 1.0, 0.1), Body("lower", 1.0, 0.1, parent="upper"))
    shapes = (GROUND, Shape("u", "upper", "disc", 0.1), Shape("l", "lower", "disc", 0.1))
    scene = slcp.Scene("arm", arm, shapes, "auto")
    assert [(c.shape_a, c.shape_b, c.friction) for c in scene.all_contacts] == [
        ("ground", "u", None), ("ground", "l", None)]  # fmt: skip
    meets = (arm[0], dataclasses.replace(arm[1], touches_parent=True))
    assert len(dataclasses.replace(scene, bodies=meets).all_contacts) == 3


def test_friction_is_the_larger_of_both_shapes_own_or_the_scenes():
    bodies = tuple(Body(n, 1.0, 0.1, joint="free") for n in "abc")
    shapes = tuple(Shape(n, n, "disc", 0.1, friction=mu) for n, mu in zip("abc", (None, 0.2, 0.9)))
    scene = slcp.Scene("three", bodies, shapes, "auto", friction=0.5)
    assert [c.friction for c in scene.all_contacts] == [0.5, 0.9, 0.9]
    bare = dataclasses.replace(scene, shapes=(shapes[0], dataclasses.replace(shapes[1], friction=None)))
    assert [c.friction for c in dataclasses.replace(bare, friction=None).all_contacts] == [None]


def test_what_is_listed_is_the_same_scene(tmp_path):
    auto = slcp.scenes.heap(6, width=0.8, variety=0.3)
    listed = auto.with_listed_contacts()
    assert auto.contacts == "auto" and len(listed.contacts) == 15 + 18
    assert listed.structure == auto.structure and listed.row_names == auto.row_names
    plain = slcp.scenes.tumbling_boxes(2).with_listed_contacts()  # nothing that is for "auto" is left
    assert {(s.contype, s.conaffinity, s.friction) for s in plain.shapes} == {(1, 1, None)}
    (tmp_path / "a.toml").write_text(
        'format = "slcp-scene"\nversion = 2\nname = "two"\ncontacts = "auto"\nfriction = 0.3\n'
        'excluded = [["a", "c"]]\n'
        + "".join(f'[[bodies]]\nname = "{n}"\nmass = 1\ninertia = 1\njoint = "free"\n' for n in "abc")
        + "".join(f'[[shapes]]\nname = "{n}"\nbody = "{n}"\nkind = "disc"\nradius = 1\n' for n in "abc")
    )
    assert slcp.load_scene(tmp_path / "a.toml").pair_names == ("a/b", "b/c")


@pytest.mark.parametrize("changes, words", [
    ({"contacts": "all"}, "contacts 'all' is unknown; choose one of .'auto'"),
    ({"contacts": (), "friction": 0.5}, "friction is for contacts='auto'"),
    ({"contacts": (), "excluded": (("a", "b"),)}, "excluded is for contacts='auto'"),
    ({"contacts": (), "shapes": (Shape("p", "a", "disc", 0.1, friction=0.3),)},
     "friction of shape 'p' is for contacts='auto'"),
    ({"friction": -1.0}, "friction is -1.0; it must not be negative"),
    ({"excluded": (("a", "d"),)}, r"excluded\[0\]: no body named 'd'; there are"),
    ({"excluded": ("ab",)}, r"excluded\[0\] is 'ab'; two names of bodies are needed"),
    ({"excluded": (("a", "a"),)}, r"excluded\[0\] names 'a' twice"),
    ({"excluded": 3}, "excluded is 3; pairs of names of bodies are needed"),
    ({"shapes": (Shape("e", "a", "ellipse", (0.2, 0.1)), Shape("c", "b", "capsule", (0.1, 0.1)))},
     "contacts 'auto': ellipse 'e' and capsule 'c' cannot touch"),
    ({"shapes": (Shape("e", "a", "ellipse", (0.2, 0.1)), *slcp.box("b4", "b", 1, 1, 0.1, sides=True))},
     r"ellipse 'e' and capsule 'b401' \(side 01 of box 'b4'\) cannot touch.*contype=2, conaffinity=3"),
])  # fmt: skip
def test_what_cannot_be_is_one_error(changes, words):
    bodies = tuple(Body(n, 1.0, 0.1, joint="free") for n in "abc")
    with pytest.raises(slcp.SceneError, match=words):
        slcp.Scene("bad", bodies, **{"contacts": "auto", **changes})


@pytest.mark.parametrize("field, value", [("friction", math.nan), ("contype", -1), ("conaffinity", 0.5)])
def test_numbers_of_a_shape_are_checked(field, value):
    with pytest.raises(slcp.SceneError, match=f"shape 'p': {field} is"):
        Shape("p", None, "disc", 0.1, **{field: value})


def test_there_may_be_so_many_pairs_and_no_more(monkeypatch):
    monkeypatch.setattr(auto_contacts, "MOST_PAIRS", 15)
    slcp.scenes.heap(5)
    with pytest.raises(slcp.SceneError, match="contacts 'auto' of 7 shapes are more than 15 pairs"):
        slcp.scenes.heap(6)
