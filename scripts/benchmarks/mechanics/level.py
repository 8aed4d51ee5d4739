"""Shapes as kernels in single precision take them: what a rounding of pi leaves of a right angle is none.

Given as pi/2 or pi in single precision, level ground and upright walls lean by 4e-8 and 9e-8, and two walls
that face each other open where a body between them is fast enough. Kernels under float32 take a shape's
cosine or sine below 2e-7 for 0; so does the oracle, by the angle alone.
"""

import copy
import dataclasses

import numpy as np

from slcp_warp.description.kinematics import Array

from .contact import Touches, touches
from .tree import Mechanics

UPRIGHT = 2e-7  # of the sine of an angle's distance from a right one
EXACT = 4e-16  # of a row's entry: what double precision leaves of pi


def level(m: Mechanics) -> Mechanics:
    """The scene, shapes that lean by a rounding of single precision upright; `m` itself without any."""
    angle = m.p["shape_angle"]
    right = 0.5 * np.pi * np.round(angle / (0.5 * np.pi))
    leans = (np.abs(np.sin(angle - right)) < UPRIGHT) & (angle != right)
    if not leans.any():
        return m
    out = copy.copy(m)
    out.p = m.p | {"shape_angle": np.where(leans, right, angle)}
    return out


def level_touches(m: Mechanics, q: Array, given: Touches | None = None) -> Touches:
    """Contacts of a scene that `level` gave, entries that are 0 but for the rounding of double precision 0 at
    half-planes: no velocity is fast enough to open what they would. `given`: the contacts, where known.
    """
    t = touches(m, q) if given is None else given
    kinds = [shape.kind for shape in m.s.shapes]
    wall = np.array(["halfplane" in (kinds[p.shape_a], kinds[p.shape_b]) for p in m.s.pairs], float)
    rest = EXACT * (np.abs(t.normal) + np.abs(t.tangent)) * wall[:, None]
    normal, tangent = (np.where(np.abs(rows) < rest, 0.0, rows) for rows in (t.normal, t.tangent))
    return dataclasses.replace(t, normal=normal, tangent=tangent)
