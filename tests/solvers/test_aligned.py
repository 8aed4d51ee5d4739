"""Boxes that fly about in line with each other and with their walls: many rows touch exactly, and nothing
presses, so that no set of rows is better than the next.
"""

import dataclasses

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape

HALF, ROOM = 0.1, 0.04
LAWS = {
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}


def room(side, tag="", left=0.0, apart=ROOM):
    """Walls, and side x side boxes between them, 4 cm apart."""
    width = side * (2.0 * HALF + apart)
    walls = [
        Shape(f"{tag}wall{i}", None, "halfplane", angle=turn,
              offset=(left + 0.5 * width * (1.0 - np.cos(turn)), 0.5 * width * (1.0 - np.sin(turn))))
        for i, turn in enumerate((0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi))
    ]  # fmt: skip
    names = [f"{tag}b{i}" for i in range(side * side)]
    return walls, [Shape(name, name, "rectangle", (HALF, HALF), corner_radius=0.02) for name in names]


def scene_of(boxes, shapes, contacts, friction=None):
    """Without gravity."""
    bodies = tuple(Body(box.name, 1.0, 0.006, joint="free") for box in boxes)
    how = {"friction": friction} if contacts == "auto" else {}
    return Scene("gas", bodies, tuple(shapes), contacts, gravity=(0.0, 0.0), step_size=0.005, **how)


def gas(side, friction):
    """side x side boxes in a box."""
    walls, boxes = room(side)
    return scene_of(boxes, [*walls, *boxes], "auto", friction)


def thrown(scene, side, worlds):
    x = np.zeros((worlds, scene.nv * 2))
    at = (np.arange(side) + 0.5) * (2.0 * HALF + ROOM)
    x[:, 0 : scene.nv : 3], x[:, 1 : scene.nv : 3] = np.repeat(at, side), np.tile(at, side)
    v = np.random.default_rng(0).standard_normal((worlds, side * side, 3))
    v[..., 2] = 0.0
    x[:, scene.nv :] = v.reshape(worlds, -1)
    return x


@pytest.mark.parametrize(
    "law, friction, dtype",
    [
        ("hard", None, "float64"),
        ("hard", 0.3, "float64"),
        ("coulomb", None, "float64"),
        ("coulomb", 0.3, "float64"),
        ("coulomb", 0.3, "float32"),
    ],
)
def test_aligned_boxes_are_solved(law, friction, dtype):
    """Of nine boxes three in five rollouts were NOT_CONVERGED, one in three under Coulomb's friction, of four
    one in ten; one in twenty-five of nine under Coulomb's friction now. In float32 three in five were.
    """
    for side, worlds, most in ((2, 60, 0), (3, 40, 2)):
        scene = gas(side, friction)
        sim = slcp.Simulator(scene, LAWS[law], device="cpu", dtype=dtype, strategy="generic")
        traj = sim.rollout(thrown(scene, side, worlds), steps=300, record="gap")
        assert (traj.status != slcp.Status.SOLVED).sum() <= most
        assert np.nanmin(traj.gap) > -1e-3  # corners that turn


def test_what_is_solved_beside_its_gaps_is_a_solution():
    """Of the data themselves, to 1e-10 of what the boxes' rows are judged by, whatever else flies elsewhere:
    rows open, press or neither.
    """
    quiet = gas(2, None)
    scene = dataclasses.replace(quiet, bodies=(*quiet.bodies, Body("far", 1.0, 1.0, joint="free")))
    sim = slcp.Simulator(scene, LAWS["hard"], device="cpu", dtype="float64", strategy="generic")
    x0 = np.zeros((60, 2 * scene.nv))
    x0[:, :12], x0[:, 15:27] = np.split(thrown(quiet, 2, 60), 2, axis=1)
    x0[:, 27] = 1e6
    traj = sim.rollout(x0, steps=20)
    assert (traj.status == slcp.Status.SOLVED).all()
    x = traj.states[:, :-1].reshape(-1, 30)
    step, problem = sim.step(x), Oracle(scene).problem(x)
    w = np.einsum("bij,bj->bi", problem["J"], step.state[:, 15:]) + problem["rate"]
    fastest = np.abs(x[:, 15:27]).max(axis=1, initial=1e-3)[:, None]
    assert (step.status == slcp.Status.SOLVED).all()
    assert (w > -1e-10 * fastest).all() and (step.impulse >= 0.0).all()
    assert (np.minimum(step.impulse * problem["D"], w) < 1e-10 * fastest).all()


def test_a_step_does_not_know_what_was_tried_before():
    """Two rooms. What was added to gaps of one for boxes at 1e9 m/s, whose step then was solved without it,
    is not there in another step of the same simulator, in which the other room needs a try.
    """
    left, right = room(2, "a"), room(3, "b", 10.0)
    pairs = [
        Contact(one.name, other.name)
        for walls, boxes in (left, right)
        for i, other in enumerate(boxes)
        for one in (*walls, *boxes[:i])
    ]
    scene = scene_of([*left[1], *right[1]], [*left[0], *left[1], *right[0], *right[1]], tuple(pairs))
    how = {"device": "cpu", "dtype": "float64", "strategy": "generic"}
    small = slcp.Simulator(gas(2, None), LAWS["hard"], **how).rollout(thrown(gas(2, None), 2, 60), steps=20)
    large = thrown(gas(3, None), 3, 24)
    large[:, 27:] = np.random.default_rng(7).standard_normal(39)[12:]  # of which one step is hard to solve
    large[:, 29::3] = 0.0
    q, v = np.split(small.states[:, :-1].reshape(50, 24, 24), 2, axis=2)
    x = np.zeros((24, 78))
    x[:, :12], x[:, 12:39] = q[0], large[:, :27]
    x[:, 12:39:3] += 10.0
    fast = x.copy()
    fast[:, 51:] = 1e9 * large[:, 27:]
    x[:, 24] = x[:, 15] + 2.0 * HALF - 1e-6  # two boxes that press
    x[:, 54], x[:, 63] = 0.5, -0.5
    used, new = (slcp.Simulator(scene, LAWS["hard"], **how) for _ in "ab")
    used.rollout(fast, None, used.params.replace(step_size=5e-12), steps=24)
    for x[:, :12], x[:, 39:51] in zip(q, v):
        np.testing.assert_array_equal(used.step(x).state, new.step(x).state)


def lying(ends):
    """Three capsules end to end that just fit between four walls, 1.2 m by .1 m."""
    walls = [
        Shape(f"wall{i}", None, "halfplane", angle=turn, offset=at)
        for i, (turn, at) in enumerate(zip((0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi), ends, strict=True))
    ]
    return walls, [Shape(f"b{i}", f"b{i}", "capsule", (0.05, 0.15)) for i in range(3)]


@pytest.mark.parametrize("law", ["hard", "coulomb"])
@pytest.mark.parametrize("kind", ["boxes", "capsules"])
def test_what_just_fits_is_no_overlap(kind, law):
    """Nine boxes, or three capsules, that leave no room between them and their walls and are turned by
    1e-17 rad: a corner's place is as uncertain as the centre and the half size that it is made from. One in
    twenty worlds of boxes was INFEASIBLE under Anitescu's friction.
    """
    worlds, rng = 100, np.random.default_rng(0)
    if kind == "boxes":
        walls, parts = room(3, apart=0.0)
        at = (np.arange(3) + 0.5) * 2.0 * HALF
        places = np.stack([np.repeat(at, 3), np.tile(at, 3)], -1)
    else:
        walls, parts = lying(((0.0, 0.0), (0.0, 0.0), (1.2, 0.0), (0.0, 0.1)))
        places = np.stack([0.2 + 0.4 * np.arange(3), np.full(3, 0.05)], -1)
    scene = scene_of(parts, [*walls, *parts], "auto", 0.5)
    sim = slcp.Simulator(scene, LAWS[law], device="cpu", dtype="float64", strategy="generic")
    x = np.zeros((worlds, 2, len(parts), 3))
    x[:, 0, :, :2] = places
    x[:, 0] += 1e-17 * rng.integers(-3, 4, x[:, 0].shape)
    thrown = rng.random((worlds, len(parts), 1)) < 0.3
    x[:, 1, :, :2] = thrown * rng.standard_normal((worlds, len(parts), 2))
    step = sim.step(x.reshape(worlds, -1))
    assert (step.status == slcp.Status.SOLVED).all()
    moved = step.state.reshape(x.shape)
    assert np.abs(moved[:, 0] - x[:, 0]).max() < 1e-12  # nothing has anywhere to go


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("kind", ["disc", "capsule"])
def test_one_part_that_just_fits_in_own_kernels(kind, dtype):
    """Between four walls; in half of the worlds it was INFEASIBLE."""
    size, at, room = (
        (0.1, (0.1, 0.1), (0.2, 0.2)) if kind == "disc" else ((0.05, 0.15), (0.2, 0.05), (0.4, 0.1))
    )
    walls, _ = lying(((0.0, 0.0), (0.0, 0.0), (room[0], 0.0), (0.0, room[1])))
    part = Shape("part", "part", kind, size)
    scene = scene_of([part], [*walls, part], "auto", 0.5)
    sim = slcp.Simulator(scene, LAWS["hard"], device="cpu", dtype=dtype, strategy="specialised")
    rng = np.random.default_rng(0)
    x = np.zeros((100, 2, 3))
    x[:, 0, :2] = at
    x[:, 0] += 1e-17 * rng.integers(-3, 4, (100, 3))
    x[:, 1, :2] = rng.standard_normal((100, 2)) * (rng.random((100, 1)) < 0.5)
    step = sim.step(x.reshape(100, -1))
    assert (step.status == slcp.Status.SOLVED).all()
    moved = step.state.reshape(x.shape)[:, 0] - x[:, 0]
    assert np.abs(moved).max() < (1e-12 if dtype == "float64" else 1e-7)
