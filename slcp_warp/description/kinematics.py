"""Where joints put bodies, in plain NumPy: what pictures and the benchmarks' mechanics share."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from slcp_warp.kernels.structure import BodyStructure

Array = np.ndarray


def turn(angle: Array, vector: Array) -> Array:
    """`vector` (..., 2) turned by `angle` (...)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * vector[..., 0] - s * vector[..., 1], s * vector[..., 0] + c * vector[..., 1]], -1)


def across(vector: Array) -> Array:
    """`vector` (..., 2) turned by a right angle."""
    return np.stack([-vector[..., 1], vector[..., 0]], -1)


def slides(body: BodyStructure, i: int, numbers: Mapping[str, Any]) -> dict[int, Array]:
    """The axes (..., 2) along which body i slides in its parent's frame, by degree of freedom."""
    if body.joint == "prismatic":
        return {body.dofs[0]: numbers["axis"][..., i, :]}
    return {j: np.eye(2)[n] for n, j in enumerate(body.dofs[:2])} if body.joint == "free" else {}


def joint_pose(
    body: BodyStructure, i: int, numbers: Mapping[str, Any], q: Array, base: Array
) -> tuple[Array, Array]:
    """Where the joint puts body i at q (..., nv): its origin in the parent's frame (..., 2), and its angle.

    Args:
        body: of the scene's structure.
        i: its index.
        numbers: parameters by name, with or without worlds first.
        q: positions.
        base: the parent's angle (...).
    """
    local = numbers["anchor"][..., i, :] + 0.0 * q[..., :1]
    for j, axis in slides(body, i, numbers).items():
        local = local + axis * q[..., j, None]
    angle = base + numbers["angle"][..., i]
    return local, angle if body.joint == "prismatic" else angle + q[..., body.dofs[-1]]
