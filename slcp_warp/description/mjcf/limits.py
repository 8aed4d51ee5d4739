"""Actuators of a MuJoCo model whose force has a range, for `reader.py`: each a tendon that has a limit.

MuJoCo clamps a u + b_0 + b_1 l + b_2 l', l being g q of a joint or g times a tendon's length, and pushes so.
"""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from ..parts import Tendon
from .motors import FORCERANGE, TENDON, Coordinate, gain_of, terms_of
from .names import named
from .plane import MjcfError
from .tendons import joints_of


def is_alike(m: Any, i: int) -> bool:
    """Whether actuator i has a range of its force that is alike to both sides: other ones are not read."""
    low, high = (float(x) for x in m.actuator_forcerange[i])
    return bool(m.actuator_forcelimited[i]) and -low == high


def limited(m: Any, left_out: Collection[str]) -> frozenset[int]:
    """The actuators that are read as tendons with a limit."""
    return frozenset(i for i in range(m.nu) if FORCERANGE not in left_out and is_alike(m, i))


def limited_tendon(m: Any, i: int, name: str, coordinates: Mapping[int, Coordinate]) -> Tendon:
    """What actuator i is here, but for its control: a tendon of this name.

    Raises:
        MjcfError: it pushes without a control, and no spring of its own does.
    """
    kind, which, _ = gain_of(m, i)
    gear, (push, stiffness, damping) = float(m.actuator_gear[i, 0]), terms_of(m, i)
    parts, offset = [], 0.0
    for joint, share in (joints_of(m, which) if kind == TENDON else {which: 1.0}).items():
        parts.append((coordinates[joint].name, gear * share * coordinates[joint].sense))
        offset += gear * share * float(m.qpos0[m.jnt_qposadr[joint]])
    if stiffness == 0.0 and push != 0.0:
        raise MjcfError(
            f"actuator {named(m, 'actuator', i)!r}: it pushes by {push:g} without a control; with forcerange "
            "that is supported only of a position servo"
        )
    length = push / stiffness - offset if stiffness != 0.0 else 0.0
    along, coefficients = zip(*parts)
    limit = float(np.asarray(m.actuator_forcerange)[i, 1])
    return Tendon(name, along, coefficients, stiffness, damping, length, limit)
