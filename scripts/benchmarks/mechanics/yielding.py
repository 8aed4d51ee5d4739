"""Tendons whose force has a limit: what they pull at a step's own end, and how that changes there."""

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
    return _asked(scene, worlds, after)[0]


def _asked(scene: Scene, worlds: Any, after: Array) -> tuple[Array, Array]:
    """The same, and the sizes of what of it hangs on the velocities after the step."""
    mech, s = Mechanics(scene, worlds.numbers), scene.structure
    q, v, new, h = worlds.x[:, : s.nv], worlds.x[:, s.nv :], after[:, s.nv :], mech.h[:, None]
    out, moved = np.zeros((len(q), len(s.tendons))), np.zeros((len(q), len(s.tendons)))
    for i, way in enumerate(mech.ways(len(q))):
        k, d = mech.p["tendon_stiffness"][:, i], mech.p["tendon_damping"][:, i]
        late = 0.5 * h * (k > 0.0)[:, None] * mech.stiff
        out[:, i] -= k * (np.sum(way * (q + late * (new - v)), -1) - mech.p["tendon_length"][:, i])
        out[:, i] -= d * np.sum(way * (new if mech.implicit else v), -1)
        moved[:, i] = np.sum(np.abs(way * new * (np.abs(k)[:, None] * late + d[:, None] * mech.implicit)), -1)
    for a, dof in enumerate(s.actuators):
        if dof < 0:
            out[:, -1 - dof] += mech.p["gear"][:, a] * worlds.u[:, a]
    return out, moved


def yielding(
    scene: Scene, worlds: Any, force: Array | None, after: Array, smoothed: bool, rounding: float
) -> tuple[Any, Array]:
    """Worlds in which tendons pull of what is asked for the share that their limit leaves by a step to
    `after`, and `force` (B, nv) with what they pull beside that: of a clamp all or nothing, of a `smoothed`
    limit the slope of its mean. What is asked for is known but for what the states' `rounding` makes of
    it: of all that it may be the share is the largest.
    """
    s, mech = scene.structure, Mechanics(scene, worlds.numbers)
    numbers = {name: np.array(value) for name, value in worlds.numbers.items()}
    out = np.zeros((len(after), s.nv)) if force is None else force.copy()
    pulls, moved = _asked(scene, worlds, after)
    limit, sigma = mech.p["tendon_force_limit"], mech.p["tendon_force_sigma"]
    for i, way in enumerate(mech.ways(len(after))):
        if i in s.limited:
            at = np.sign(pulls[:, i]) * np.maximum(np.abs(pulls[:, i]) - rounding * moved[:, i], 0.0)
            most = limit[:, i]
            share, pulled = 1.0 * (np.abs(at) <= most), np.clip(at, -most, most)
            if smoothed:
                mean, slope = _mean(at, most, sigma[:, i])
                share = np.where(sigma[:, i] > 0.0, slope, share)
                pulled = np.where(sigma[:, i] > 0.0, mean, pulled)
            out += (pulled - share * at)[:, None] * way
            for name in ("stiffness", "damping"):
                numbers[f"tendon_{name}"][:, i] *= share
            for a, dof in enumerate(s.actuators):
                numbers["gear"][:, a] *= share if dof == -1 - i else 1.0
    return dataclasses.replace(worlds, numbers=numbers), out


def _mean(f: Array, most: Array, sigma: Array) -> tuple[Array, Array]:
    """The mean of f under logistic noise, clamped, and its slope, the chance to be between the ends: the mean
    is the integral of that.
    """
    scale = np.where(sigma > 0.0, sigma, 1.0)
    ends = [np.logaddexp(0.0, (f - end) / scale) for end in (-most, most)]
    over = [0.5 * (1.0 + np.tanh(0.5 * (f - end) / scale)) for end in (-most, most)]
    mean = scale * (ends[0] - ends[1]) - most
    far = np.abs(f) > 40.0 * scale + most  # where the difference of large ones has no digits
    return np.where(far, np.sign(f) * most, mean), over[0] - over[1]
