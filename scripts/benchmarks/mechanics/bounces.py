"""Which pairs bounce in a step, by Newton's law (M54): a pair that closes in the step parts with a share of
the speed that it met with, unless the way back is shut within the step.
"""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from slcp_warp.description.kinematics import Array

from .overlaps import limited

RESTS = 2.0  # times what forces change of the speed in a step: what meets more slowly lies still
MOST = 5  # pairs of a world of which every part may have been given up


def met(p: Any) -> tuple[Array, Array, Array]:
    """By pair (B, pairs) of a `Problem`: e J_n v, whether it bounces, whether rounding may decide that."""
    truth, touches = p.truth, p.touches
    e = np.minimum(truth.mech.p["restitution"], 1.0) + np.zeros(touches.gap.shape)
    unhindered = p.drive.free if truth.meets is None else truth.meets
    speed, free = (np.einsum("bpj,bj->bp", touches.normal, v) for v in (truth.v, unhindered))
    closes = limited(p.method.depenetration_speed, touches.gap / truth.h[:, None]) + free
    quick = -speed - RESTS * np.abs(free - speed)
    bounces = (e > 0.0) & (closes <= 0.0) & (quick > 0.0)
    moved = np.abs(truth.v) + np.abs(unhindered)
    doubt = np.abs(touches.gap) / truth.h[:, None]
    doubt = doubt + p.loose * touches.size / truth.h[:, None]
    doubt = doubt + 2.0 * RESTS * np.einsum("bpj,bj->bp", np.abs(touches.normal), moved)
    doubt = p.tolerance * p.loss[:, None] * doubt * np.maximum(1.0, p.loose * touches.bend)
    unsure = (np.abs(closes) <= doubt) & (quick > -doubt) | (np.abs(quick) <= doubt) & (closes <= doubt)
    return speed * e, bounces, (e > 0.0) & unsure


def given_up(p: Any) -> Iterator[Any]:
    """The problem of one world with fewer of its pairs bouncing: every choice, most of them first."""
    pairs = np.flatnonzero(p.bounces[0])
    for kept in range(len(pairs) - 1, -1, -1) if len(pairs) <= MOST else (0,):
        for stay in itertools.combinations(pairs.tolist(), kept):
            yield p.with_bounces(stay)
