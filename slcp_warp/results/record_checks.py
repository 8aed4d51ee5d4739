"""What the arrays of a file of results must be: shapes that fit the scene, numbers, known statuses."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..options import Status
from ..storage.files import FileError
from .simulated import Simulated

Arrays = dict[str, np.ndarray]
TRAJECTORY = ("states", "status", "controls", "impulse", "contact_impulse", "gap")


def shapes(arrays: Arrays, need: dict[str, tuple[int, ...]]) -> None:
    """Raise FileError for an array that is missing or of another shape than it needs."""
    for name, shape in need.items():
        if name not in arrays:
            raise FileError(f"it lacks the array {name!r}")
        if arrays[name].shape != shape:
            raise FileError(f"array {name!r} has shape {arrays[name].shape}, {shape} is needed")


def finite(arrays: Arrays, *names: str) -> None:
    """Raise FileError for numbers that are not finite."""
    for name in names:
        if not np.isfinite(arrays[name]).all():
            raise FileError(f"array {name!r} contains numbers that are not finite")


def known_statuses(status: np.ndarray, known: Iterable[int]) -> None:
    """Raise FileError for a status that is none of the known ones."""
    codes = [int(s) for s in known]
    unknown = np.setdiff1d(status, codes)
    if len(unknown):
        raise FileError(f"array 'status' contains {unknown[0]}, which is none; of {codes} each is needed")


def worlds_of_parameters(simulated: Simulated, counts: Iterable[int]) -> None:
    """Raise FileError where parameters are of other worlds than there can be."""
    found, need = simulated.parameters.worlds, tuple(counts)
    if found is not None and found not in need:
        raise FileError(f"its parameters are of {found} worlds, {need[0]} is needed")


def length(arrays: Arrays, name: str, axis: int, axes: int) -> int:
    """Length of an array along one of its axes."""
    if name not in arrays or arrays[name].ndim != axes:
        shape = arrays[name].shape if name in arrays else "none"
        raise FileError(f"array {name!r} has shape {shape}; {axes} axes are needed")
    return arrays[name].shape[axis]


def made_steps(given: Any, shape: tuple[int, ...], path: Any) -> np.ndarray | None:
    """(B,) how many steps worlds made of which failures ended some, as a file's header has it; None: all."""
    if given is None:
        return None
    whole = isinstance(given, list) and all(type(each) is int and 1 <= each < shape[1] for each in given)
    if not whole or len(given) != shape[0]:
        raise FileError(
            f"{path}: made is {given!r:.60}; {shape[0]} whole numbers from 1 to {shape[1] - 1} are needed"
        )
    return np.array(given)


def check_trajectory(arrays: Arrays, simulated: Simulated) -> None:
    """States (B, N+1, nx), statuses (B,), and what was recorded: controls (B, N, nu), impulses and gaps (B,
    N, nr), impulses of pairs (B, N, pairs, 2).
    """
    scene = simulated.scene
    worlds, steps = length(arrays, "states", 0, 3), length(arrays, "states", 1, 3) - 1
    rows, pairs = scene.structure.nr, len(scene.structure.pairs)
    if steps < 1 or worlds < 1:
        raise FileError(f"array 'states' has shape {arrays['states'].shape}; a world and a step are needed")
    recorded = {
        "controls": (worlds, steps, scene.nu), "impulse": (worlds, steps, rows),
        "contact_impulse": (worlds, steps, pairs, 2), "gap": (worlds, steps, rows),
    }  # fmt: skip
    need = {"states": (worlds, steps + 1, 2 * scene.nv), "status": (worlds,)}
    need |= {name: shape for name, shape in recorded.items() if name in arrays}
    shapes(arrays, need)
    worlds_of_parameters(simulated, (worlds,))
    known_statuses(arrays["status"], Status)
    solved = arrays["status"] == Status.SOLVED
    names = [name for name in need if name != "gap"]  # of what does not act it is infinite
    finite({name: arrays[name][solved] for name in names}, *names)
