"""Servos: controls that are wanted positions, by an actuator with a spring and a damper in the joint."""

import dataclasses
import math
from typing import Any

import numpy as np

from ...inputs.checks import instance, number, whole
from ...inputs.errors import SceneError
from ..names import DOFS
from ..parts import JOINTS, Actuator, Body, Tendon


def servo(body: Body, stiffness: float, damping: float | None = None, dof: int = 0) -> tuple[Body, Actuator]:
    """A body and an actuator whose control is the position that a degree of freedom is to have.

    The force is kp (u - q) - kv q', with the spring and the damper in the step's implicit part: it never
    diverges, but rings where sqrt(kp / m) is faster than the step. What the joint has of them by itself
    stays, and `Task.control_limits` are limits of the wanted position, in m or rad. The force has no limit:
    `limited_servo` has one.

    Args:
        body: whose joint it is.
        stiffness: kp [N/m, N m/rad], > 0.
        damping: kv [N s/m, N m s/rad], >= 0; None: critical for the body's own mass, or its inertia about
            the joint, 2 sqrt(kp m). What hangs on it makes that less than critical.
        dof: which degree of freedom of the joint, from 0.

    Raises:
        SceneError: no such degree of freedom, or numbers that cannot be.
    """
    damping, count = _damping(body, stiffness, damping, dof), JOINTS[body.joint]
    own = _number(body.stiffness, dof)
    changes: dict[str, Any] = {
        "stiffness": _with(body.stiffness, count, dof, own + stiffness),
        "damping": _with(body.damping, count, dof, _number(body.damping, dof) + damping),
        "rest": _with(body.rest, count, dof, own * _number(body.rest, dof) / (own + stiffness)),
    }
    return dataclasses.replace(body, **changes), Actuator(body.name, dof, stiffness)


def limited_servo(
    body: Body,
    stiffness: float,
    force_limit: float,
    damping: float | None = None,
    dof: int = 0,
    force_sigma: float = 0.0,
) -> tuple[Tendon, Actuator]:
    """A servo whose force has a limit: a tendon and an actuator, for a scene's `tendons` and `actuators`.

    The force is kp (u - q) - kv q' at the end of the step, and no more than the limit to either side (M64): a
    motor that stalls, that pushes on at what stands in its way, that brakes no harder than it can. The joint
    keeps what it has of springs and dampers by itself. Tendon and control are called NAME_servo, NAME the
    body's name (of a joint of several degrees of freedom NAME_x_servo, as its coordinate is called). Such
    scenes are stepped by generic kernels.

    Where the force is at its limit nothing changes with u: a plan sees no slope there. `force_sigma` gives it
    one, and a cost of u - q, or a start whose targets are near, helps it.

    Args:
        body, stiffness, damping, dof: as of `servo`.
        force_limit: > 0 [N, N m]; the parameter "NAME_servo.tendon_force_limit".
        force_sigma: >= 0 [N, N m], as of a `Tendon`: noise of what is asked for, under smoothed laws.

    Raises:
        SceneError: no such degree of freedom, or numbers that cannot be.
    """
    damping = _damping(body, stiffness, damping, dof)
    number(f"body {body.name!r}: force_limit", force_limit, 0.0, above=True, error=SceneError)
    number(f"body {body.name!r}: force_sigma", force_sigma, 0.0, error=SceneError)
    word = DOFS[body.joint][dof]
    name = f"{body.name}_servo" if JOINTS[body.joint] == 1 else f"{body.name}_{word}_servo"
    coordinate = f"{body.name}.{word}"
    tendon = Tendon(name, (coordinate,), (1.0,), stiffness, damping, 0.0, force_limit, force_sigma)
    return tendon, Actuator(gear=stiffness, tendon=name)


def _damping(body: Body, stiffness: float, damping: float | None, dof: int) -> float:
    """The damping of a servo, critical where it is None; arguments of one that cannot be are a SceneError."""
    instance("body", body, Body, "a Body")
    number(f"body {body.name!r}: stiffness", stiffness, 0.0, above=True, error=SceneError)
    whole(f"body {body.name!r}: dof", dof, 0, error=SceneError)
    count = JOINTS[body.joint]
    if dof >= count:
        raise SceneError(f"body {body.name!r}: dof is {dof}; joint {body.joint!r} has {count}, from 0")
    if damping is None:
        damping = 2.0 * math.sqrt(stiffness * _inert(body, dof))
    return number(f"body {body.name!r}: damping", damping, 0.0, error=SceneError)


def _inert(body: Body, dof: int) -> float:
    """Mass of a body's degree of freedom, or inertia about its joint, of the body alone."""
    armature = _number(body.armature, dof)
    if body.joint == "revolute":
        return body.inertia + body.mass * float(np.dot(body.com, body.com)) + armature
    return (body.inertia if dof == 2 else body.mass) + armature


def _number(given: Any, dof: int) -> float:
    value = given[dof] if isinstance(given, tuple | list) else given
    return 0.0 if value is None else float(value)


def _with(given: Any, count: int, dof: int, value: float) -> Any:
    """One number for every degree of freedom, with one of them changed; a number of a joint that has one."""
    if count == 1:
        return value
    several = list(given) if isinstance(given, tuple | list) else [given] * count
    several[dof] = value
    return tuple(several)
