"""How a problem reaches other processes: as a file of plain arrays, its functions by the names of modules."""

import hashlib
import importlib
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from slcp_warp import Options as SimulatorOptions
from slcp_warp import Simulator
from slcp_warp.description.scene_file import scene_content, scene_of
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.storage.archive import open_archive, write_archive
from slcp_warp.storage.files import FileError, reading

from ..costs import Cost
from ..dynamics import WarpDynamics
from ..options import Options
from ..problem import Problem

FORMAT, VERSION = "slcp-warp-starts", 1
PARAMETER = "param_"
LIMITS, BEFORE = ("control_limits", "state_limits"), "controls_before"
Content = tuple[dict[str, Any], dict[str, np.ndarray]]


def content_of(problem: Problem, arrays: Mapping[str, np.ndarray], options: Options) -> Content:
    """Header and arrays of the file.

    Raises:
        ArgumentError: a function that other processes cannot import, or dynamics of another class.
    """
    settings = asdict(options)
    settings.pop("regularization")
    values = {PARAMETER + name: np.asarray(value) for name, value in _parameters(problem).items()}
    for name, rows in zip(LIMITS, (problem.limit_rows(), problem.state_limit_rows())):
        if getattr(problem, name) is not None:
            values |= {f"{name}_{side}": row[0] for side, row in zip(("lower", "upper"), rows)}
    if problem.before is not None:
        values[BEFORE] = np.asarray(problem.before, float)
    cost = problem.cost
    header = {
        "dynamics": _dynamics(problem.dynamics), "horizon": problem.horizon, "options": settings,
        "cost": {
            "make": name_of(cost.make, "Problem.cost"), "nx": cost.nx, "nu": cost.nu, "nodes": cost.nodes,
        },
    }  # fmt: skip
    return header, values | {"weights": cost.weights} | dict(arrays)


def _dynamics(dynamics: Any) -> dict[str, Any]:
    device = "cpu" if wp.get_device(dynamics.device).is_cpu else "cuda"
    shared = {"dtype": dynamics.dtype.__name__, "device": device}
    if isinstance(dynamics, Simulator):
        return shared | {
            "scene": scene_content(dynamics.scene), "options": asdict(dynamics.options),
            "strategy": dynamics.strategy,
        }  # fmt: skip
    if isinstance(dynamics, WarpDynamics):
        make = name_of(dynamics.make, "Problem.dynamics")
        return shared | {"make": make, "nx": dynamics.nx, "nu": dynamics.nu}
    raise ArgumentError(
        f"Problem.dynamics is a {type(dynamics).__name__}, which other processes cannot make; a Simulator or "
        "a ddp.WarpDynamics can be handed to them; or leave out the executor"
    )


def _parameters(problem: Problem) -> dict[str, Any]:
    params = problem.params
    if isinstance(params, wp.array):
        raise ArgumentError(
            "Problem.params is a Warp array; parameters by name can be handed to other processes"
        )
    if isinstance(problem.dynamics, Simulator):
        return {name: params[name] for name in params.names}
    return dict(params.values)


def name_of(function: Callable[..., Any], what: str) -> str:
    """`module:name` of a function of a module.

    Raises:
        ArgumentError: other processes could not find it there.
    """
    module, name = getattr(function, "__module__", ""), getattr(function, "__qualname__", "")
    try:
        found = getattr(importlib.import_module(module), name, None) if module != "__main__" else None
    except (ImportError, ValueError):
        found = None
    if found is not function:
        raise ArgumentError(
            f"{what} is made by {name or function!r}, which other processes cannot import: a function of a "
            "module is needed; or leave out the executor"
        )
    return f"{module}:{name}"


def _named(text: str) -> Any:
    module, _, name = text.partition(":")
    return getattr(importlib.import_module(module), name)


def digest_of(problem: Problem, arrays: Mapping[str, np.ndarray], options: Options) -> str:
    """SHA-256 of what the file holds."""
    return _digest(*content_of(problem, arrays, options))


def _digest(header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name}\0{array.dtype.str}{array.shape}\0".encode() + array.tobytes())
    return digest.hexdigest()


def write_starts(
    path: str | os.PathLike[str], problem: Problem, arrays: Mapping[str, np.ndarray], options: Options
) -> None:
    """Write the file, whole or not at all."""
    header, values = content_of(problem, arrays, options)
    write_archive(path, header | {"format": FORMAT, "version": VERSION}, values)


def read_starts(path: Path, digest: str) -> tuple[Problem, dict[str, np.ndarray], Options]:
    """Problem, arrays and options of a file.

    Raises:
        FileError: damaged, or not the one that `digest` is of: its functions are not imported then.
    """
    with reading(path, "the starts of a multistart", FileError), open_archive(path) as archive:
        archive.check_format(FORMAT, VERSION)
        header = {name: archive.header[name] for name in ("dynamics", "horizon", "options", "cost")}
        arrays = archive.read_all(archive.names)
        if _digest(header, arrays) != digest:
            raise FileError("it is not what was written")
    dynamics = _made(header["dynamics"], arrays)
    cost = header["cost"]
    limits = {
        name: (arrays[f"{name}_lower"], arrays[f"{name}_upper"])
        for name in LIMITS
        if f"{name}_lower" in arrays
    }
    made = Cost(_named(cost["make"]), arrays["weights"], cost["nx"], cost["nu"], cost["nodes"])
    problem = Problem(dynamics, made, header["horizon"], _replaced(dynamics, arrays),
                      before=arrays.get(BEFORE), **limits)  # fmt: skip
    return problem, arrays, Options(**header["options"])


def _made(values: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Any:
    shared = {"dtype": values["dtype"], "device": values["device"]}
    if "scene" in values:
        options = SimulatorOptions(**values["options"])
        return Simulator(scene_of(values["scene"]), options, strategy=values["strategy"], **shared)
    return WarpDynamics(_named(values["make"]), values["nx"], values["nu"], _given(arrays), **shared)


def _given(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {n.removeprefix(PARAMETER): a for n, a in arrays.items() if n.startswith(PARAMETER)}


def _replaced(dynamics: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    return dynamics.params.replace(**_given(arrays))
