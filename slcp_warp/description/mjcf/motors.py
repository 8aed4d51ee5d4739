"""Actuators of a MuJoCo model, for `reader.py`: controls, and what they do to joints and tendons beside.

MuJoCo's servos are affine: along its joint or tendon an actuator of gear g pushes with
g (a u + b_0 + b_1 g q + b_2 g q'). The part with u is an `Actuator`; what depends on position and velocity
is a spring of -g^2 b_1 and a damper of -g^2 b_2 of the joint or tendon, exactly, and its rotor an armature of
g^2 times its own. One whose force has a range is a tendon of its own (`limits.py`).
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from .names import named
from .plane import MjcfError

JOINT, TENDON = "joint", "tendon"
FORCERANGE = "forcerange"


@dataclass(frozen=True)
class Coordinate:
    """What a joint of MuJoCo's is here: a degree of freedom of a body, of either sense, and its name."""

    body: str
    dof: int
    sense: float
    name: str


@dataclass
class Servo:
    """What the actuators of a joint or tendon do to it by themselves, in MuJoCo's sense of turning: a push at
    qpos = 0 [N m, N], a stiffness, a damping and an armature.
    """

    push: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    armature: float = 0.0


def gain_of(m: Any, i: int) -> tuple[str, int, float]:
    """What an actuator acts on, `JOINT` or `TENDON`, and which, and the push along it for a control of one.

    Raises:
        MjcfError: it acts on something else, or its force is not affine in control, position and velocity.
    """
    import mujoco

    servo = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
    kinds = {int(mujoco.mjtTrn.mjTRN_JOINT): JOINT, int(mujoco.mjtTrn.mjTRN_TENDON): TENDON}
    kind = kinds.get(int(m.actuator_trntype[i]))
    if kind is None or not (
        m.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED
        and int(m.actuator_biastype[i]) in servo
        and m.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_NONE
    ):
        raise MjcfError(
            f"actuator {named(m, 'actuator', i)!r}: only a motor, or a position or velocity servo without "
            "dynamics of its own, on a joint or a fixed tendon is supported"
        )
    gain = float(m.actuator_gear[i, 0] * m.actuator_gainprm[i, 0])
    return kind, int(m.actuator_trnid[i, 0]), gain


def force_limits(m: Any) -> tuple[np.ndarray, np.ndarray]:
    """What the forceranges of motors leave of their controls, (lower, upper), each (nu,): MuJoCo clamps gain
    u; infinite of other actuators, whose force is not the control's alone.
    """
    import mujoco

    lower, upper = np.full(m.nu, -np.inf), np.full(m.nu, np.inf)
    for i in np.flatnonzero(np.asarray(m.actuator_forcelimited, bool)):
        gain = float(m.actuator_gainprm[i, 0])
        motor = m.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED and gain != 0.0
        if motor and m.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE:
            lower[i], upper[i] = sorted(np.asarray(m.actuator_forcerange[i], float) / gain)
    return lower, upper


def terms_of(m: Any, i: int) -> tuple[float, float, float]:
    """What actuator i pushes by itself along its joint or tendon, geared: the push at length 0, a stiffness
    and a damping, b_0, -b_1 and -b_2.
    """
    import mujoco

    if m.actuator_biastype[i] != mujoco.mjtBias.mjBIAS_AFFINE:
        return 0.0, 0.0, 0.0
    constant, by_length, by_rate = (float(x) for x in m.actuator_biasprm[i, :3])
    return constant, -by_length, -by_rate


def servos(m: Any, limited: Collection[int]) -> dict[tuple[str, int], Servo]:
    """What actuators do to their joints and tendons, by what they act on; the forces of those that are
    `limited` are tendons' of their own.
    """
    out: dict[tuple[str, int], Servo] = {}
    for i in range(m.nu):
        own = out.setdefault(gain_of(m, i)[:2], Servo())
        gear = float(m.actuator_gear[i, 0])
        for name in ("armature", "damping"):
            part = gear**2 * float(getattr(m, f"actuator_{name}", [0.0] * m.nu)[i])
            setattr(own, name, getattr(own, name) + part)
        if i not in limited:
            push, stiffness, damping = terms_of(m, i)
            own.push += gear * push
            own.stiffness += gear**2 * stiffness
            own.damping += gear**2 * damping
    return out
