"""The broad phase against all pairs: what the oracle's rows let act is listed, what is far is not."""

import dataclasses
import functools
import math

import numpy as np
import pytest
import warp as wp
from oracle import Oracle, complex_step

import slcp_warp as slcp
from slcp_warp import Body, Shape
from slcp_warp.kernels.generic.broad.items import item_tables, items_first
from slcp_warp.kernels.generic.broad.phase import CUT, make_broad
from slcp_warp.kernels.generic.topology import Topology, make_topology
from slcp_warp.kernels.generic.work import LISTED, Work, allocate_work, view

WORLDS = 40
F, V3, V4 = wp.float64, wp.vec3d, wp.vec4d


def crowd(rng, size):
    """Free and hinged bodies of one to three round shapes, half-planes of the world and of bodies, posts,
    often a ring of a body."""
    long = str(rng.choice(["capsule", "ellipse", "rectangle"]))
    bodies, shapes = (
        [],
        [Shape("ground", None, "halfplane", angle=math.pi / 2), Shape("post", None, "disc", 0.3)],
    )
    for i in range(size):
        parent = bodies[rng.integers(i)].name if i and rng.random() < 0.3 else None
        joint = "free" if parent is None else str(rng.choice(["revolute", "prismatic"]))
        bodies.append(
            Body(f"b{i}", 1.0, 0.1, parent=parent, joint=joint, anchor=tuple(rng.uniform(-1, 1, 2)))
        )
        for j in range(int(rng.integers(1, 4))):
            kind = str(rng.choice(["disc", long]))
            radius = (float(rng.uniform(0.0, 0.3)),) if kind == "disc" else tuple(rng.uniform(0.05, 0.4, 2))
            offset = tuple(rng.uniform(-0.3, 0.3, 2))
            corner = {"corner_radius": 0.03} if kind == "rectangle" else {}
            shapes.append(Shape(f"s{i}_{j}", f"b{i}", kind, radius, offset, rng.uniform(-3, 3), **corner))
    shapes.append(Shape("tray", "b0", "halfplane", offset=(0.1, 0.2), angle=1.0))
    if long != "ellipse":  # which rings do not touch
        shapes.append(Shape("hoop", "b1", "ring", 2.5, offset=(0.2, 0.0)))
    scene = slcp.Scene("crowd", tuple(bodies), tuple(shapes), "auto", friction=0.4)
    kept = [c for c in scene.all_contacts if rng.random() < 0.8]  # listed: any order, some pairs missing
    return dataclasses.replace(
        scene, contacts=tuple(kept[i] for i in rng.permutation(len(kept))), friction=None
    )


def states(scene, rng):
    """Some worlds dense, some wide or tall, some with bodies from afar that are fast."""
    nv = scene.nv
    width = rng.choice([0.3, 2.0, 20.0], (WORLDS, 1)) * np.where(
        np.arange(nv) % 3 == 0, rng.choice([1, 10], (WORLDS, 1)), 1
    )
    speed = rng.choice([0.1, 3.0, 100.0], (WORLDS, nv), p=[0.5, 0.4, 0.1])
    return width * rng.standard_normal((WORLDS, nv)), speed * rng.standard_normal((2, WORLDS, nv))


def bodies_at(oracle, q, vs):
    """Frames (B, nb, 4), twists (2, B, nb, 3) of joints, and poses of all shapes (B, shapes, 4)."""
    found = oracle.frames(q)
    frame = np.stack([np.concatenate([np.cos(a)[:, None], np.sin(a)[:, None], at], -1) for a, at in found], 1)

    def places(z):
        return np.concatenate([np.concatenate([at, a[..., None]], -1) for a, at in oracle.frames(z)], -1)

    twist = np.einsum("bij,kbj->kbi", complex_step(places, q), vs).reshape(2, len(q), -1, 3)
    shapes = []
    for i in range(len(oracle.structure.shapes)):
        centre, turn = oracle.shape_pose(q, i)
        turn = np.broadcast_to(turn, len(q))
        shapes.append(np.concatenate([centre, np.cos(turn)[:, None], np.sin(turn)[:, None]], -1))
    return frame, twist, np.stack(shapes, 1)


@functools.cache
def kernel():
    broad = make_broad("hard")

    @wp.kernel(module="unique", enable_backward=False)
    def find(
        t: Topology, work: Work, params: wp.array(dtype=F), frame: wp.array2d(dtype=V4),
        twist: wp.array3d(dtype=V3), shape: wp.array2d(dtype=V4), cut: F, margin: F,
        out: wp.array3d(dtype=wp.int32), made: wp.array2d(dtype=wp.int32),
    ):  # fmt: skip
        """Every slot takes as many states, one after the other, as there are for it."""
        b = wp.tid()
        k = view(work, b)
        k.numbers = params
        k.shape = shape[0]
        broad.measure(t, k)
        k.bound[wp.static(CUT)] = cut
        each = frame.shape[0] // work.q.shape[0]
        for i in range(b * each, (b + 1) * each):
            k.frame = frame[i]
            k.shape = shape[i]
            broad.start(t, k)
            for n in range(2):
                k.twist = twist[n, i]
                made[n, i] = broad.find(t, k, margin)
                for at in range(k.count[wp.static(LISTED)]):
                    out[n, i, at] = k.listed[at]

    return find


def lists_of(scene, bodies, numbers, slots):
    """Listed pairs (2, B, pairs), -1 behind them, at the first and then at the second velocity; whether they
    were made anew (2, B).
    """
    p, s = slcp.Parameters(scene), scene.structure
    h, cut, margin = numbers
    table = p.replace(step_size=h).array(F, "cpu").flatten()
    local = np.concatenate([p["shape_offset"], 0.0 * p["shape_offset"]], -1)
    frame, twist, shape = bodies
    shape = np.concatenate([shape, np.broadcast_to(local, shape.shape)], 1)
    out = wp.full((2, len(bodies[0]), len(s.pairs)), -1, dtype=wp.int32, device="cpu")
    made = wp.zeros((2, len(bodies[0])), dtype=wp.int32, device="cpu")
    t = make_topology(s, True, False, None, "cpu")
    t.items, t.planes, _ = item_tables(s)  # however few pairs there are
    parts = zip((frame, twist, shape), (V4, V3, V4))
    arrays = (wp.array(x, dtype=kind, device="cpu") for x, kind in parts)
    inputs = [t, allocate_work(s, slots, "cpu"), table, *arrays, cut, margin, out, made]
    wp.launch(kernel(), slots, inputs, device="cpu")
    return out.numpy(), made.numpy()


def slowest_rates(oracle, q, vs, h):
    """The lowest J v + d/h of the rows of every pair, (2, B, pairs)."""
    rates = []
    for k in range(len(oracle.structure.pairs)):
        gap, normal, tangent, _ = oracle.contact_jacobian(q, k)
        n, t = (np.einsum("bj,kbj->kb", row, vs) for row in (normal, tangent))
        rates.append(n - oracle.p["friction"][k] * np.abs(t) + gap / h)
    return np.stack(rates, -1)


@pytest.mark.parametrize("seed", range(6))
def test_every_pair_that_can_act_is_listed(seed):
    rng = np.random.default_rng(seed)
    scene = crowd(rng, 2 + seed)
    oracle, pairs = Oracle(scene), len(scene.structure.pairs)
    q, vs = states(scene, rng)
    h, cut, margin = 0.01, rng.choice([0.0, 0.4]), rng.choice([0.0, 0.5])
    bodies = bodies_at(oracle, q, vs)
    numbers = (h, cut, margin)
    found, made = lists_of(scene, bodies, numbers, WORLDS)
    listed = np.zeros((2, WORLDS, pairs + 1), bool)
    np.put_along_axis(listed, found, True, -1)  # -1: the last one
    listed = listed[..., :-1]
    acts = slowest_rates(oracle, q, vs, h) <= cut + margin
    assert acts.any() and not (acts & ~listed).any()
    assert (made[0] == 1).all()
    assert not (listed[0] & ~listed[1]).any() and (listed[0] == listed[1])[made[1] == 0].all()
    for one in found.reshape(-1, pairs):  # ascending, each once
        count = (one >= 0).sum()
        assert (np.diff(one[:count]) > 0).all() and (one[count:] == -1).all()
    again, _ = lists_of(scene, bodies, numbers, 1)  # in one slot after each other: nothing is left of before
    np.testing.assert_array_equal(again, found)


def test_what_is_far_is_not_listed():
    """Discs in a wide row, at rest: neighbours only, whatever the axis, and only the ground below."""
    scene = slcp.scenes.heap(40, width=1.0)
    names = scene.pair_names
    for along in (0, 1):
        q = np.zeros((1, 40, 3))
        q[0, :, along] = 0.205 * np.random.default_rng(1).permutation(40)
        q[..., 1] += 0.105
        vs = np.zeros((2, 1, 120))
        bodies = bodies_at(Oracle(scene), q.reshape(1, -1), vs)
        found, made = lists_of(scene, bodies, (0.01, 0.0, 0.0), 1)
        near = [names[k] for k in found[0, 0] if k >= 0]
        rank = np.argsort(np.argsort(q[0, :, along]))
        between = [tuple(int(n.removeprefix("disc")) for n in name.split("/")) for name in near
                   if name.startswith("disc")]  # fmt: skip
        assert len(between) == 39 and all(abs(rank[a] - rank[b]) == 1 for a, b in between)
        assert sum(name.startswith("ground") for name in near) == (40, 1)[along]
        assert made.tolist() == [[1], [0]]


def test_items_of_a_scene():
    scene = slcp.scenes.tumbling_boxes(3)
    items, planes, tables = item_tables(scene.structure)
    assert (items, planes) == (3, 1)  # boxes with corners and sides, and the ground
    assert tables["item_partner"] == [1, 2, 2, 0, 1, 2]
    assert np.diff(tables["item_pair_start"]).tolist() == [32, 32, 32, 4, 4, 4]


def test_items_come_first_where_they_are_fewer_than_pairs():
    """In a stack every box has a pair or two with the next one: nothing is won."""
    first = [s for s in (slcp.scenes.heap(n) for n in (3, 9, 12)) if items_first(s.structure)]
    assert [len(s.bodies) for s in first] == [12]
    assert items_first(slcp.scenes.tumbling_boxes(3, width=1.0).structure)
    assert not items_first(slcp.scenes.stack(100).structure)
