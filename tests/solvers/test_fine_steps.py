"""Steps so short that what moves in one is near the rounding of lengths in single precision."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape

COULOMB = slcp.Options(residual="hard", friction="coulomb")
# a disc between a wedge on a guide, a wall and the floor
TILT, FRICTION, RADIUS, GRAVITY = 0.15, 0.6, 0.1, 9.81
C, S = np.cos(TILT), np.sin(TILT)
# rows of the contacts wedge-disc, wall-disc, floor-disc and floor-foot by (wedge, x, y, angle)
NORMAL = np.array([[-C, 1, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0], [S, 0, 0, 0]])
TANGENT = np.array([[-S, 0, 1, -RADIUS], [0, 0, -1, -RADIUS], [0, -1, 0, -RADIUS], [-C, 0, 0, 0]])
INVERSE = np.diag([1.0, 2.0, 2.0, 500.0])
SCENE = Scene(
    "wedge",
    (
        Body("wedge", 1.0, 1.0, joint="prismatic", axis=(C, S), anchor=(-0.3, 0.1)),
        Body("ball", 0.5, 0.002, joint="free"),
    ),
    (
        Shape("face", "wedge", "halfplane"),
        Shape("wall", None, "halfplane", offset=(0.1, 0.0), angle=np.pi),
        Shape("floor", None, "halfplane", angle=np.pi / 2),
        Shape("rim", "ball", "disc", RADIUS),
        Shape("foot", "wedge", "disc", 0.1, offset=(-0.2, 0.0)),
    ),
    tuple(
        Contact(a, b, FRICTION)
        for a, b in (("face", "rim"), ("wall", "rim"), ("floor", "rim"), ("floor", "foot"))
    ),
    gravity=(0.0, -GRAVITY),
)


def states(rng, count, h, speed):
    """States (count, 8) whose gaps are of the size of h times the speed."""
    x, off = np.zeros((count, 8)), h * speed
    x[:, 1] = off * rng.uniform(-1.0, 1.0, count)
    x[:, 2] = RADIUS + off * rng.uniform(-0.3, 1.0, count)
    x[:, 3] = rng.uniform(-1.0, 1.0, count)
    x[:, 0] = (x[:, 1] - 0.1 + 0.3 + off * rng.uniform(-1.0, 0.3, count)) / C
    x[:, 4:] = rng.normal(size=(count, 4)) * speed * np.array([1.0, 1.0, 1.0, 5.0])
    return x


def violation(x, v, impulse, gap, h):
    """By how much steps violate the law, relative to what their data set (count,)."""
    a_n, a_t = (np.einsum("ij,jk,ik->i", J, INVERSE, J) for J in (NORMAL, TANGENT))
    w, slip = v @ NORMAL.T + gap[:, 0::2] / h, v @ TANGENT.T
    normal, tangent = impulse[:, 0::2], impulse[:, 1::2]
    bound = a_t * FRICTION * normal
    rubs = a_t * tangent - np.clip(a_t * tangent - slip, -bound, bound)
    free = x[:, 4:] + h * np.array([-GRAVITY * S, 0.0, -GRAVITY, 0.0])
    into = np.abs(free @ NORMAL.T) + np.abs(np.minimum(gap[:, 0::2], 0.0)) / h
    scale = np.maximum(into, np.abs(free @ TANGENT.T)).max(axis=1)
    return np.maximum(np.abs(np.minimum(a_n * normal, w)), np.abs(rubs)).max(axis=1) / scale


@pytest.mark.parametrize("step_size, speed", [(1e-3, 0.01), (1e-4, 0.01), (1e-5, 0.01), (1e-5, 1.0)])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_the_law_holds_on_the_scale_of_the_data(step_size, speed, dtype, strategy):
    """Of a disc between a wedge, a wall and the floor, whose gaps are of the size of h v, as float32 has
    them: w of 4e-7 m / h was let pass, a third of the speeds, SOLVED.
    """
    sim = slcp.Simulator(SCENE, COULOMB, device="cpu", dtype=dtype, strategy=strategy)
    x = states(np.random.default_rng(0), 200, step_size, speed).astype(np.float32).astype(float)
    step = sim.step(x, np.zeros((200, 0)), sim.params.replace(step_size=step_size))
    v, impulse, gap = (np.asarray(a, float) for a in (step.state[:, 4:], step.impulse, step.gap))
    assert (step.status == slcp.Status.SOLVED).all()
    assert violation(x, v, impulse, gap, step_size).max() < 1e-4


def test_what_enters_by_more_than_a_rounding_is_jammed():
    """A foot on a guide that friction holds: in double precision none has a solution, in single precision
    those that are less than 4e-7 m inside rest there, and their velocities do not enter.
    """
    angle, speed, h = 0.2, 0.1, 1e-3
    body = slcp.Body("foot", 1.0, 1.0, joint="prismatic", axis=(np.cos(angle), np.sin(angle)))
    shapes = (
        slcp.Shape("ground", None, "halfplane", angle=np.pi / 2),
        slcp.Shape("tip", "foot", "disc", 0.1),
    )
    scene = slcp.Scene("guide", (body,), shapes, (slcp.Contact("ground", "tip", 0.5),))
    rng = np.random.default_rng(0)
    x = np.stack(
        [(0.1 - h * speed * rng.uniform(0, 0.3, 200)) / np.sin(angle), -speed * rng.uniform(0.1, 1, 200)], 1
    )
    for dtype in ("float64", "float32"):
        sim = slcp.Simulator(scene, COULOMB, device="cpu", dtype=dtype, strategy="specialised")
        step = sim.step(x, np.zeros((200, 0)), sim.params.replace(step_size=h))
        solved = step.status == slcp.Status.SOLVED
        assert set(step.status[~solved].tolist()) == {int(slcp.Status.JAMMED)}
        assert (step.gap[solved, 0] > -4e-7).all() and solved.sum() < 10
        assert (np.sin(angle) * step.state[solved, 1] > -1e-5 * speed).all()
