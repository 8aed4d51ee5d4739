"""Rectangles move as what they are made of: corners on planes, sides that keep others out."""

from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape

LAWS = {
    "smoothed": slcp.Options(),
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}


def rolled(scene, x0, steps, options=LAWS["hard"], strategy="generic"):
    traj = slcp.Simulator(scene, options, device="cpu", strategy=strategy).rollout(x0, steps=steps)
    assert not np.any(traj.status)
    return traj.states


def on_ground(shapes, mass=1.0):
    ground = Shape("ground", None, "halfplane", angle=np.pi / 2)
    body = Body("b", mass, 0.02 * mass, joint="free")
    return Scene("toss", (body,), (ground, *shapes), contacts="auto", friction=0.5, sigma=0.02)


@pytest.mark.parametrize("strategy", ["generic", "specialised"])
def test_tossed_as_its_four_corners(strategy):
    """The same rows in the same order as those of `box`, wherever the shape sits on its body."""
    at, turn = (0.03, -0.02), 0.4
    corners = slcp.box("c", "b", 0.4, 0.2, corner_radius=0.03, offset=at, angle=turn)
    whole = Shape("c", "b", "rectangle", (0.2, 0.1), at, turn, corner_radius=0.03)
    x0 = np.array([[0.0, 0.5, 0.3, 1.0, 0.0, 4.0], [0.0, 0.3, 1.2, -1.0, 0.0, 0.0]])
    one, other = (
        rolled(on_ground(shapes), x0, 150, LAWS["smoothed"], strategy) for shapes in (corners, (whole,))
    )
    assert np.ptp(other[:, :, 2], axis=1).min() > 0.5  # they tumble
    np.testing.assert_allclose(other, one, atol=1e-9)


def test_as_flat_as_its_corners_it_is_a_capsule():
    def scene(bar):
        ball = Body("ball", 0.5, 0.01, joint="free")
        bodies = (Body("arm", 2.0, 0.3, stiffness=30.0, damping=0.5), ball)
        disc = Shape("ball", "ball", "disc", 0.08)
        return Scene("bounce", bodies, (bar, disc), (Contact("bar", "ball", 0.4),), sigma=0.02)

    place = {"offset": (0.2, 0.0), "angle": 0.2}
    rng = np.random.default_rng(0)
    x0 = np.zeros((20, 8))
    x0[:, 1], x0[:, 2] = rng.uniform(-0.4, 0.8, 20), 0.6
    one, other = (
        rolled(scene(bar), x0, 100)
        for bar in (
            Shape("bar", "arm", "capsule", (0.05, 0.3), **place),
            Shape("bar", "arm", "rectangle", (0.35, 0.05), corner_radius=0.05, **place),
        )
    )
    assert np.abs(one[:, -1, 0]).max() > 0.02  # it was hit
    np.testing.assert_allclose(other, one, atol=1e-8)


@pytest.mark.parametrize("law", LAWS)
def test_a_stack_of_them_stands(law):
    """Sides of one width: every corner stands at the end of a side of the other."""
    n, half, corner = 3, 0.1, 0.01
    ground = Shape("ground", None, "halfplane", angle=np.pi / 2)
    boxes = [Shape(f"s{i}", f"b{i}", "rectangle", (half, half), corner_radius=corner) for i in range(n)]
    bodies = tuple(Body(f"b{i}", 1.0, 2.0 / 3.0 * half**2, joint="free") for i in range(n))
    scene = Scene("stack", bodies, (ground, *boxes), contacts="auto", friction=0.5, sigma=1e-3)
    x0 = np.zeros(6 * n)
    x0[1 : 3 * n : 3] = half + 2.0 * half * np.arange(n)
    end = rolled(scene, x0, 200, LAWS[law])[-1]
    np.testing.assert_allclose(end[: 3 * n], x0[: 3 * n], atol=3e-3)
    np.testing.assert_allclose(end[3 * n :], 0.0, atol=2e-3)


def test_what_is_inside_leaves_by_the_nearest_side():
    """A disc whose centre is inside of a slab: a capsule along its edge would push it on through."""
    slab = Shape("slab", None, "rectangle", (0.5, 0.1))
    disc = Shape("disc", "b", "disc", 0.05)
    scene = Scene("sunk", (Body("b", 1.0, 1e-3, joint="free"),), (slab, disc), (Contact("slab", "disc"),),
                  gravity=(0.0, 0.0))  # fmt: skip
    x0 = np.zeros((4, 6))
    x0[:, :2] = (0.2, 0.06), (0.2, -0.06), (0.47, 0.0), (-0.46, 0.05)
    step = slcp.Simulator(scene, LAWS["hard"], device="cpu", strategy="generic").step(x0)
    np.testing.assert_allclose(step.gap[:, 0], [-0.09, -0.09, -0.08, -0.09], atol=1e-12)
    out = step.state[:, :2] - x0[:, :2]
    np.testing.assert_allclose(out, [[0.0, 0.09], [0.0, -0.09], [0.08, 0.0], [-0.09, 0.0]], atol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_a_block_pushed_off_a_ledge_tips_over_its_edge(law):
    """Its centre beyond the edge it turns clockwise and falls beside the ledge, which it never enters."""
    shapes = (
        Shape("ground", None, "halfplane", angle=np.pi / 2),
        Shape("ledge", None, "rectangle", (0.3, 0.25), offset=(-0.3, 0.25)),
        Shape("block", "block", "rectangle", (0.1, 0.05), corner_radius=0.01),
    )
    body = Body("block", 1.0, 1.0 / 3.0 * (0.1**2 + 0.05**2), joint="free")
    scene = Scene("ledge", (body,), shapes, contacts="auto", friction=0.5, step_size=0.005, sigma=1e-3)
    sim = slcp.Simulator(scene, LAWS[law], device="cpu", strategy="generic")
    starts = np.zeros((2, 6))
    starts[:, 0], starts[:, 1] = (0.02, -0.02), 0.552  # beyond the edge, and not
    traj = sim.rollout(starts, steps=200, record="gap")
    assert not traj.status.any()
    end = traj.states[:, -1]
    assert end[0, 2] < -1.0 and 0.04 < end[0, 1] < 0.12 and end[0, 0] > 0.04
    np.testing.assert_allclose(end[1, :3], [-0.02, 0.55, 0.0], atol=4e-3)
    assert np.nanmin(traj.gap) > -5e-3


def in_a_row(height=0.125, friction=0.5):
    """Two boxes of .3 m on the ground, the second as high as the first or not."""
    ground = Shape("ground", None, "halfplane", angle=np.pi / 2)
    bodies = tuple(Body(name, 1.0, 0.01, joint="free") for name in "ab")
    boxes = [
        Shape(name, name, "rectangle", (0.15, high), corner_radius=0.005)
        for name, high in zip("ab", (0.125, height))
    ]
    contacts = tuple(Contact(a, b, friction) for a, b in (("ground", "a"), ("ground", "b"), ("a", "b")))
    return Scene("row", bodies, (ground, *boxes), contacts, step_size=0.005)


@pytest.mark.parametrize("height", [0.125, 0.128])
@pytest.mark.parametrize("law", ["hard", "coulomb"])
def test_boxes_side_by_side_are_pushed_apart_sideways(law, height):
    """As deep as they are in each other; at the top and bottom corners have shorter ways out, up and down."""
    scene = in_a_row(height)
    depth = np.array([1e-3, 0.01, 0.05, 0.15])
    x0 = np.array([scene.state({"a.y": 0.125, "b.y": height, "b.x": 0.3 - d}) for d in (*depth, *-depth)])
    x0[4:, scene.state_index("b.x")] = -(0.3 - depth)
    options = replace(LAWS[law], depenetration_speed=0.2)
    sim = slcp.Simulator(scene, options, dtype="float64", device="cpu")
    pairs = [i for i, name in enumerate(scene.pair_names) if name.startswith("a")]
    gap = sim.step(x0).gap
    rows = [row.index in pairs and row.kind == "contact" for row in scene.structure.rows]
    deepest = gap[:, np.array(rows)].min(axis=1)
    np.testing.assert_allclose(deepest, -np.tile(depth, 2), atol=1e-12 if height == 0.125 else 3e-3)
    found = rolled(scene, x0, 400, options)
    apart = found[:, -1, scene.state_index("b.x")] - found[:, -1, scene.state_index("a.x")]
    assert (np.sign(apart) == np.sign(x0[:, scene.state_index("b.x")])).all() and (
        np.abs(apart) > 0.2995
    ).all()
    heights = found[:, -1][:, [scene.state_index(name) for name in ("a.y", "b.y")]]
    np.testing.assert_allclose(heights, np.tile([0.125, height], (8, 1)), atol=2e-3)


def test_boxes_in_the_same_place_part():
    """Along the axis of the least overlap, the higher-numbered one up: which way is as good."""
    scene = in_a_row()
    options = replace(LAWS["coulomb"], depenetration_speed=0.2)
    last = rolled(scene, scene.state({"a.y": 0.125, "b.y": 0.125})[None], 400, options)[0, -1]
    assert last[scene.state_index("b.y")] - last[scene.state_index("a.y")] > 0.2495


def test_forces_of_boxes_in_each_other_are_what_moves_them():
    """Places and normals of a recorded run, which other code finds: they sum to the momentum that b gains."""
    scene = replace(in_a_row(), gravity=(0.0, 0.0), contacts=(Contact("a", "b", 0.5),))
    options = replace(LAWS["coulomb"], depenetration_speed=0.2)
    sim = slcp.Simulator(scene, options, dtype="float64", device="cpu")
    x0 = scene.state({"b.x": 0.28, "b.vy": 0.1, "b.angle": 0.01})
    run = sim.rollout(x0, steps=5, record=("impulse", "gap"))
    table = run.contacts()
    gained = slcp.momentum(run.states, sim.params, "b").linear
    for step in range(3):
        own = table["step"] == step
        n = np.stack([table["normal_x"][own], table["normal_y"][own]], -1)
        t = np.stack([-n[:, 1], n[:, 0]], -1)
        force = table["normal_force"][own, None] * n + table["tangential_force"][own, None] * t
        np.testing.assert_allclose(
            scene.step_size * force.sum(0), gained[step + 1] - gained[step], rtol=1e-4, atol=1e-8
        )
    assert gained[1, 0] > 0.01


def test_a_corner_that_came_out_of_a_plate_keeps_it_there():
    """Corners of the plate lie deep in the box; pushed back through it, against that corner, it flew off."""
    bodies = (
        Body("box", 1.0, (0.15**2 + 0.12**2) / 3.0, joint="free"),
        Body("plate", 1.0, (0.3**2 + 0.015**2) / 3.0, joint="free"),
    )
    shapes = (
        Shape("box", "box", "rectangle", (0.15, 0.12), corner_radius=0.003),
        Shape("plate", "plate", "rectangle", (0.3, 0.015), corner_radius=0.003),
    )
    scene = Scene(
        "plate", bodies, shapes, (Contact("box", "plate", 0.3),), gravity=(0.0, 0.0), step_size=0.01
    )
    x0 = np.r_[-0.62522, 0.42001, -1.57052, -0.39367, 0.303, -1.09868, np.zeros(6)]
    for options, most in ((replace(LAWS["coulomb"], depenetration_speed=0.5), 3.0), (LAWS["coulomb"], 6.0)):
        step = slcp.Simulator(scene, options, dtype="float64", device="cpu").step(x0)
        assert step.status == 0 and np.abs(step.state[6:]).max() < most
