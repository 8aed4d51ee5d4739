"""Tendons whose force has a limit: where a step's own end says that it is reached, it is a force like any."""

import dataclasses
from typing import Any

import numpy as np

from slcp_warp import Scene
from slcp_warp.description.kinematics import Array

from .tree import Mechanics


def asked(scene: Scene, worlds: Any, after: Array) -> Array:
    """What the tendons of a scene would pull by a step to states `after` (B, 2 nv) without a limit (B,
    tendons): by its controls, its spring half a step on, its damper at the step's end or, where a scene wants
    that, at its beginning.
    """
    mech, s = Mechanics(scene, worlds.numbers), scene.structure
    q, v, new, h = worlds.x[:, : s.nv], worlds.x[:, s.nv :], after[:, s.nv :], mech.h[:, None]
    out = np.zeros((len(q), len(s.tendons)))
    for i, way in enumerate(mech.ways(len(q))):
        k, d = mech.p["tendon_stiffness"][:, i], mech.p["tendon_damping"][:, i]
        place = q + 0.5 * h * (new - v) * (k > 0.0)[:, None] * mech.stiff
        out[:, i] -= k * (np.sum(way * place, -1) - mech.p["tendon_length"][:, i])
        out[:, i] -= d * np.sum(way * (new if mech.implicit else v), -1)
    for a, dof in enumerate(s.actuators):
        if dof < 0:
            out[:, -1 - dof] += mech.p["gear"][:, a] * worlds.u[:, a]
    return out


def yielding(scene: Scene, worlds: Any, force: Array | None, after: Array) -> tuple[Any, Array]:
    """Worlds in which tendons that a step to `after` has at their limit pull nothing, and `force` (B, nv)
    with what they pull in place of that.
    """
    s, mech = scene.structure, Mechanics(scene, worlds.numbers)
    numbers = {name: np.array(value) for name, value in worlds.numbers.items()}
    out = np.zeros((len(after), s.nv)) if force is None else force.copy()
    pulls, limit = asked(scene, worlds, after), mech.p["tendon_force_limit"]
    for i, way in enumerate(mech.ways(len(after))):
        if i in s.limited:
            at = np.abs(pulls[:, i]) > limit[:, i]
            out += np.where(at, np.sign(pulls[:, i]) * limit[:, i], 0.0)[:, None] * way
            for name in ("stiffness", "damping"):
                numbers[f"tendon_{name}"][at, i] = 0.0
            numbers["gear"][np.ix_(at, [a for a, dof in enumerate(s.actuators) if dof == -1 - i])] = 0.0
    return dataclasses.replace(worlds, numbers=numbers), out
