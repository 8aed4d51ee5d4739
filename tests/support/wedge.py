"""A disc between a wedge on a guide, a wall and the floor, and Coulomb's law of it in NumPy."""

import numpy as np

from slcp_warp import Body, Contact, Scene, Shape

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
