"""Fixed tendons of a MuJoCo model, for `reader.py`: weighted sums of joints' positions, with a spring, a
damper and what servos on them add.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..parts import Tendon
from .motors import TENDON, Coordinate, Servo
from .names import named
from .plane import MjcfError
from .refused import HINT


def joints_of(m: Any, i: int) -> dict[int, float]:
    """The joints of tendon i with their coefficients.

    Raises:
        MjcfError: it is none of joints.
    """
    import mujoco

    first = int(m.tendon_adr[i])
    places = range(first, first + int(m.tendon_num[i]))
    if any(m.wrap_type[at] != mujoco.mjtWrap.mjWRAP_JOINT for at in places):
        raise MjcfError(
            f"tendon {named(m, 'tendon', i)!r}: only fixed tendons, of joints, and those from one site to "
            f"another are supported{HINT}"
        )
    out: dict[int, float] = {}
    for at in places:
        joint = int(m.wrap_objid[at])
        out[joint] = out.get(joint, 0.0) + float(m.wrap_prm[at])
    return out


def read_tendons(
    m: Any,
    names: Mapping[int, str],
    coordinates: Mapping[int, Coordinate],
    servos: Mapping[tuple[str, int], Servo],
) -> tuple[Tendon, ...]:
    """The tendons of the model.

    Args:
        names: here, of those that are read.
        coordinates: ours of every joint.
        servos: what actuators do by themselves.

    Raises:
        MjcfError: one that is not fixed, or with what has no counterpart.
    """
    out = []
    for i, name in names.items():
        servo, offset = servos.get((TENDON, i), Servo()), 0.0
        parts = []
        for joint, coefficient in joints_of(m, i).items():
            parts.append((coordinates[joint].name, coefficient * coordinates[joint].sense))
            offset += coefficient * float(m.qpos0[m.jnt_qposadr[joint]])
        own = float(m.tendon_stiffness[i])
        low, high = (float(x) for x in m.tendon_lengthspring[i])
        if own != 0.0 and not np.isclose(low, high, rtol=0.0, atol=1e-12):
            raise MjcfError(
                f"tendon {name!r}: its spring is slack from {low:g} to {high:g}; one length is supported"
            )
        stiffness = own + servo.stiffness
        pull = own * low + servo.push
        if stiffness == 0.0 and pull != 0.0:
            raise MjcfError(
                f"tendon {name!r}: an actuator pulls it by {pull:g} without a control; that is supported "
                "only where a spring or a position servo acts, too"
            )
        if servo.armature:
            raise MjcfError(f"tendon {name!r}: its actuators have an armature; only joints' are supported")
        length = pull / stiffness if stiffness != 0.0 else 0.0
        along, coefficients = zip(*parts)
        out.append(
            Tendon(name, along, coefficients, stiffness, float(m.tendon_damping[i]) + servo.damping,
                   length - offset if stiffness != 0.0 else 0.0)
        )  # fmt: skip
    return tuple(out)
