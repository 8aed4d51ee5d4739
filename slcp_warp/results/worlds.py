"""Some of the worlds of a rollout, and all of them as columns of a table."""

from typing import Any

import numpy as np
import warp as wp

from ..description.scene import Scene
from ..inputs.arrays import Array, kind_of, to_numpy
from ..inputs.checks import shown
from ..inputs.errors import ArgumentError

SIZES = {"controls": "control", "impulse": "impulse", "gap": "gap"}


def some_worlds(given: Any, count: int) -> int | slice | np.ndarray:
    """Which worlds are meant: a number, a slice, or whole numbers.

    Raises:
        IndexError: a world beyond the last.
        ArgumentError: no number, slice, list of numbers or mask of all worlds.
    """
    if isinstance(given, slice):
        return given
    found = np.asarray(given) if not isinstance(given, bool) else np.empty(0)
    if found.dtype == bool and found.shape == (count,):
        return np.flatnonzero(found)
    if found.dtype.kind not in "iu" or found.ndim > 1:
        raise ArgumentError(
            f"worlds are {shown(given)}; a whole number, a slice, numbers or a mask ({count},) is needed"
        )
    if found.size and not (-count <= found.min() and found.max() < count):
        raise IndexError(f"worlds are {shown(given)}; there are {count}")
    return found if found.ndim else int(found)


def selected(array: Array | None, index: int | slice | np.ndarray) -> Array | None:
    """The worlds of an array, of its kind; for a whole number without an axis of worlds."""
    if array is None:
        return None
    if kind_of(array) != "warp":
        return array[index]
    found = np.ascontiguousarray(np.atleast_1d(to_numpy(array)[index]))  # Warp has no arrays without an axis
    return wp.array(found, dtype=array.dtype, device=array.device)


def pair_gap(scene: Scene, gap: np.ndarray) -> np.ndarray:
    """Distance of every pair (B, N, pairs) from that of its rows (B, N, nr), which is the same."""
    first = [0] * len(scene.structure.pairs)
    for i, row in reversed(list(enumerate(scene.structure.rows))):
        if row.kind == "contact":
            first[row.index] = i
    return gap[..., first]


def columns(
    scene: Scene, times: np.ndarray, states: np.ndarray, status: np.ndarray, steps: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Columns with a row for every world and state; numbers of a step stand where it begins.

    Args:
        scene: gives the names.
        times: (N+1,) or (B, N+1).
        states: (B, N+1, nx).
        status: (B,).
        steps: controls (B, N, nu), impulse and gap (B, N, nr), what there is.
    """
    worlds, nodes, _ = states.shape
    out = {
        "world": np.repeat(np.arange(worlds), nodes),
        "time": np.broadcast_to(times, (worlds, nodes)).ravel(),
        "status": np.repeat(status, nodes),
    }
    out |= {name: states[:, :, j].ravel() for j, name in enumerate(scene.state_names)}
    for name, values in steps.items():
        full = np.concatenate([values, np.full((worlds, 1, values.shape[2]), np.nan, values.dtype)], axis=1)
        labels = scene.control_names if name == "controls" else scene.row_names
        out |= {f"{SIZES[name]} {label}": full[:, :, j].ravel() for j, label in enumerate(labels)}
    return out
