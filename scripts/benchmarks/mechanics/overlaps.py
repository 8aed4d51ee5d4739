"""Overlaps that leave by no more than a speed, and stay where there is no way for them (M60)."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from slcp_warp.description.kinematics import Array

ROOM = 1e-4  # of sigma, where smoothed overlaps stay
REACH = 1e3  # times slack, within which rows may act


def limited(speed: float | None, near: Array) -> Array:
    """What rows hold in place of d/h, at a largest speed or none."""
    return near.copy() if speed is None else np.maximum(near, -speed)


def room(p: Any) -> Array:
    """What rows of a `Problem` hold at least where they stay."""
    return np.zeros_like(p.near) if p.method.hard else ROOM * p.sigma


def left(p: Any, velocities: Array, slack: Array) -> Iterator[Any]:
    """The `Problem` of one world with overlaps that stay: those that velocities (1, nv) do not open by more
    than `slack` (1, nr), those of what hangs together with or may touch their bodies, and all. None where
    all are opened.
    """
    w = p.rate + np.einsum("bij,bj->bi", p.jac, velocities)
    may = (p.rate <= room(p)) & ~p.tangent
    shut = may & (w < -slack)
    if not shut.any():
        return
    touches = (w < REACH * (slack + np.abs(p.near)))[0]
    moves = np.concatenate([np.abs(p.drive.h_mass[0]) > 0.0, p.jac[0][touches] != 0.0]).astype(int)
    joined = np.any(p.jac[0][shut[0]] != 0.0, axis=0)
    for _ in range(len(joined)):
        joined = np.any(moves[(moves @ joined) > 0] > 0, axis=0) | joined
    beside = may & np.any((p.jac[0] != 0.0) & joined, axis=1)[None]
    for stays in (shut, beside, may):
        yield p.with_overlaps(stays)
