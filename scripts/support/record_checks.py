"""What the arrays of the commands' files must be: shapes that fit the scene, numbers, known statuses."""

from dataclasses import fields

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.simulated import Simulated
from slcp_warp.storage.files import FileError

Arrays = dict[str, np.ndarray]


def _shapes(arrays: Arrays, need: dict[str, tuple[int, ...]]) -> None:
    """Raise FileError for an array that is missing or of another shape than it needs."""
    for name, shape in need.items():
        if name not in arrays:
            raise FileError(f"it lacks the array {name!r}")
        if arrays[name].shape != shape:
            raise FileError(f"array {name!r} has shape {arrays[name].shape}, {shape} is needed")


def _finite(arrays: Arrays, *names: str) -> None:
    for name in names:
        if not np.isfinite(arrays[name]).all():
            raise FileError(f"array {name!r} contains numbers that are not finite")


def _statuses(status: np.ndarray, known: type[slcp.Status] | type[ddp.Status]) -> None:
    unknown = np.setdiff1d(status, [int(s) for s in known])
    if len(unknown):
        raise FileError(f"array 'status' contains {unknown[0]}, which is none")


def _length(arrays: Arrays, name: str, axis: int, axes: int) -> int:
    """Length of an array along one of its axes."""
    if name not in arrays or arrays[name].ndim != axes:
        shape = arrays[name].shape if name in arrays else "none"
        raise FileError(f"array {name!r} has shape {shape}; {axes} axes are needed")
    return arrays[name].shape[axis]


def check_trajectory(arrays: Arrays, simulated: Simulated) -> None:
    """States (B, N+1, nx), controls (B, N, nu), impulses and gaps (B, N, nr), statuses (B,)."""
    scene = simulated.scene
    worlds, steps = _length(arrays, "states", 0, 3), _length(arrays, "states", 1, 3) - 1
    rows, pairs = scene.structure.nr, len(scene.structure.pairs)
    if steps < 1 or worlds < 1:
        raise FileError(f"array 'states' has shape {arrays['states'].shape}; a world and a step are needed")
    need = {
        "states": (worlds, steps + 1, 2 * scene.nv), "controls": (worlds, steps, scene.nu),
        "impulse": (worlds, steps, rows), "contact_impulse": (worlds, steps, pairs, 2), "status": (worlds,),
    }  # fmt: skip
    _shapes(arrays, need | ({"gap": (worlds, steps, rows)} if "gap" in arrays else {}))
    if simulated.parameters.worlds not in (None, worlds):
        raise FileError(f"its parameters are of {simulated.parameters.worlds} worlds, its states of {worlds}")
    _statuses(arrays["status"], slcp.Status)
    solved = arrays["status"] == slcp.Status.SOLVED
    _finite({name: arrays[name][solved] for name in need}, *need)


def check_plan(arrays: Arrays, simulated: Simulated) -> None:
    """A `ddp.Result` of one problem, its trace's columns of one length, and what the noise levels cost."""
    nx, nu = 2 * simulated.scene.nv, simulated.scene.nu
    steps, passes = _length(arrays, "us", 0, 2), _length(arrays, "trace_cost", 0, 1)
    levels = _length(arrays, "level_sigma", 0, 1)
    if steps < 1 or passes < 1 or levels < 1:
        raise FileError("it holds no step, no pass or no noise level")
    each = ("cost", "status", "iterations", "gradient", "min_pivot")
    columns = (*(f"trace_{f.name}" for f in fields(ddp.Trace)), "trace_level")
    need = {
        "xs": (steps + 1, nx), "us": (steps, nu), "K": (steps, nu, nx), "k": (steps, nu),
        "Vx": (steps + 1, nx), "Vxx": (steps + 1, nx, nx), **dict.fromkeys(each, ()),
        **dict.fromkeys(columns, (passes,)), "level_sigma": (levels,), "level_cost": (levels,),
    }  # fmt: skip
    limits = ("lower", "upper") if {"lower", "upper"} & arrays.keys() else ()  # files without state none
    _shapes(arrays, need | dict.fromkeys(limits, (nu,)))
    if limits and not (arrays["lower"] <= arrays["upper"]).all():
        raise FileError("a lower control limit is above the upper one")
    _finite(arrays, "xs", "us", "K")
    _statuses(arrays["status"], ddp.Status)
    if np.setdiff1d(arrays["trace_level"], np.arange(levels)).size:
        raise FileError(f"array 'trace_level' names noise levels beyond its {levels}")


def check_surface(arrays: Arrays, simulated: Simulated) -> None:
    """Distances on a grid of the first three coordinates."""
    axes = [f"axis{i}" for i in range(3)]
    counts = tuple(_length(arrays, name, 0, 1) for name in axes)
    if min(counts) < 2 or simulated.scene.nv < 3:
        raise FileError(f"a grid of {counts} points; two a coordinate and three coordinates are needed")
    _shapes(arrays, {"gap": counts})
    _finite(arrays, *axes, "gap")
    for name in axes:
        if np.any(np.diff(arrays[name]) <= 0.0):
            raise FileError(f"array {name!r} does not rise")
