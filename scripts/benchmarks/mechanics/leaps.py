"""The leapfrog's free motion: half of the Coriolis forces are those where Euler's step leads."""

import numpy as np

from slcp_warp.description.kinematics import Array

from .tree import COMPLEX_STEP, Mechanics


def late(mech: Mechanics, q: Array, v: Array, u: Array | None, reached: Array) -> tuple[Array, Array]:
    """What that adds to the momentum of Euler's step, which leads to `reached`, and the size of its terms
    (B, nv).
    """
    here, there = mech.motion(q, v, u), mech.motion(q, reached, u)
    half = 0.5 * mech.h[:, None]
    return half * (there.force - here.force), half * (there.size + here.size)


def reached_by(mech: Mechanics, q: Array, u: Array, reached: Array, inverse: Array, size: Array) -> Array:
    """What errors `size` of Euler's momentum, by the velocity it leads to, make of the leapfrog's (B, nv);
    `inverse`: of Euler's matrix (B, nv, nv).
    """
    speed = np.einsum("bij,bj->bi", np.abs(inverse), size)
    out = np.zeros(speed.shape)
    for j, unit in enumerate(np.eye(speed.shape[1])):
        change = mech.motion(q + 0j, reached + 1j * COMPLEX_STEP * unit, u).force.imag / COMPLEX_STEP
        out += 0.5 * mech.h[:, None] * np.abs(change) * speed[:, j : j + 1]
    return out
