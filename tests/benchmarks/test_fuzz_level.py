"""The fuzz oracle in single precision: walls that lean by a rounding of pi, and overlaps that are one."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds
from slcp_warp.scripts.benchmarks.fuzz.judge import Outcome
from slcp_warp.scripts.benchmarks.fuzz.problem import Problem, Truth
from slcp_warp.scripts.benchmarks.fuzz.proofs import least_motion
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task
from slcp_warp.scripts.benchmarks.fuzz.verdicts import HOLDS, SILENT, Verdicts

PI = float(np.float32(np.pi))  # leans by 8.7e-8
WEDGE = (1.3e-4, np.pi - 2.1e-4)  # outward angles of its sides


def posed(scene, worlds, dtype, friction="anitescu"):
    """The oracle's hard problem of one world, as `Verdicts` asks for it."""
    method = slcp.Options(residual="hard", friction=friction).method

    def pose(_):
        truth = Truth(scene, worlds)
        return Problem(truth, truth.drive(), method, dtype)

    return pose


def alone(scene, x):
    numbers = {name: value[None] for name, value in scene.default_parameters().items()}
    numbers["sigma"] = np.zeros((1, scene.structure.nr))
    return Worlds(numbers, np.asarray(x, float)[None], np.zeros((1, 0)), np.zeros(1, int))


def verdict(pose, v, impulse):
    """Verdict and reason on an answer in single precision."""
    p = pose(None)
    v, impulse = (np.asarray(a, np.float32).astype(float)[None] for a in (v, impulse))
    q = (p.truth.q + p.truth.h[:, None] * v).astype(np.float32).astype(float)
    gap = p.rate * p.truth.h[:, None]
    found = Verdicts(p, Outcome(np.concatenate([q, v], 1), impulse, gap, np.zeros(1, int)), pose)
    return found.verdict[0], found.reason[0]


def touched(body, angles, depth):
    """Half-planes of these outward angles that a disc of .2 m at the origin touches, and is inside by."""
    planes = [
        Shape(f"{body} plane{i}", None, "halfplane", angle=angle,
              offset=tuple((inside - 0.2) * np.array([np.cos(angle), np.sin(angle)])))
        for i, (angle, inside) in enumerate(zip(angles, depth, strict=True))
    ]  # fmt: skip
    contacts = [Contact(plane.name, f"{body} disc") for plane in planes]
    return [Shape(f"{body} disc", body, "disc", 0.2), *planes], contacts


def slot_and_wedge(wall):
    """A disc between two upright walls, 1e-8 m too near, that the ground pushes out at 1 m/s, and one that
    runs into a wedge, which stops it with 2,900 N s on either side: scene, state, v' and impulses.
    """
    slot, first = touched("slotted", (0.0, wall, 0.5 * np.pi), (0.0, 1e-8, 0.01))
    wedge, other = touched("wedged", WEDGE, (0.0, 0.0))
    bodies = tuple(Body(name, 1.0, 0.02, joint="free") for name in ("slotted", "wedged"))
    scene = Scene("slot and wedge", bodies, (*slot, *wedge), (*first, *other), gravity=(0.0, 0.0))
    up = [0.0, 1.0, 0.0]
    x = np.r_[np.zeros(9), [-0.3, -1.0, 0.0]]
    push = np.linalg.solve([np.cos(WEDGE), np.sin(WEDGE)], [0.3, 1.0])
    return scene, x, np.r_[up, np.zeros(3)], np.r_[0.0, 0.0, 1.0, push]


@pytest.mark.parametrize("turn", range(4))
def test_in_single_precision_walls_are_level_to_the_rounding_of_pi(turn):
    right = 0.5 * np.pi * turn
    for lean, levels in ((0.0, True), (1.5e-7, True), (4e-7, False)):
        angle = right + lean if lean else float(np.float32(right))
        shapes, contacts = touched("a", (angle,), (0.0,))
        scene = Scene("wall", (Body("a", 1.0, 0.02, joint="free"),), tuple(shapes), tuple(contacts))
        pose = {d: posed(scene, alone(scene, np.zeros(6)), d)(None) for d in ("float32", "float64")}
        along = {dtype: abs(p.jac[0, 0, (turn + 1) % 2]) for dtype, p in pose.items()}
        assert (along["float32"] == 0.0) == levels
        assert along["float64"] == pytest.approx(abs(np.sin(angle - right)), rel=1e-6, abs=1e-15)


@pytest.mark.parametrize("friction", ["anitescu", "coulomb"])
def test_walls_that_lean_by_a_rounding_of_pi_do_not_close_upon_what_slides_between_them(friction):
    """Level walls let the disc out. Walls that do lean shut at any speed: no answer is right. Neither is a
    wedge that pushes more on one side.
    """
    for wall, wrong in ((PI, False), (PI + 1e-6, True)):
        scene, x, v, impulse = slot_and_wedge(wall)
        pose = posed(scene, alone(scene, x), "float32", friction)
        assert (verdict(pose, v, impulse) == (SILENT, "no solution exists")) == wrong
        assert verdict(pose, v, impulse * (1.0, 1.0, 1.0, 1.0, 1.01))[0] == SILENT
        assert verdict(pose, v * 1.01, impulse)[0] == SILENT


def test_a_gap_that_rounding_made_turns_nothing_along_the_surface():
    """A half-plane and an ellipse on its body meet to 3e-9 m, a rounding, and turn as one at 450 rad/s: the
    gap between their points moves them along each other by its rounding, which opens no row.
    """
    task = Task(9, 64, "generic")
    scene = task.make_scene()
    pose = posed(scene, task.worlds(0, scene).part([131]), "float32")
    eased = pose(None)
    assert least_motion(eased, 0) is None
    eased.ease()
    v, impulse = least_motion(eased, 0)
    assert verdict(pose, v, impulse)[0] == HOLDS
    for i in np.flatnonzero(impulse):
        more = impulse * (1.0 + 1e-2 * np.eye(len(impulse))[i])
        assert verdict(pose, v, more)[0] == SILENT
