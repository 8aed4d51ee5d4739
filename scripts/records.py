"""The commands' own files: NumPy archives (.npz) of plain arrays and a JSON header; nothing is pickled.

Kinds: "trajectory" (states of worlds over time), "plan" (a result of DDP with its trace) and "surface"
(signed distances on a grid). Libraries and sweeps have files of their own: `ddp.Library`,
`slcp_warp.SweepReport`.
"""

import json
import zipfile
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp

PREFIX, VERSION = "slcp-warp-", 1
NEEDED = {
    "trajectory": ("states", "controls", "impulse", "contact_impulse", "status"),
    "plan": ("xs", "us", "K", "cost", "status"),
    "surface": ("axis0", "axis1", "axis2", "gap"),
}


class RecordError(ValueError):
    """A file that cannot be read, or is of another kind than needed."""


@dataclass(frozen=True)
class Record:
    """A file's content: kind, arrays by name, and the header's JSON values."""

    kind: str
    arrays: dict[str, np.ndarray]
    header: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name]

    def save(self, path: Path) -> Path:
        """Write the file; an existing one is replaced only once the new one is complete."""
        header = {"format": PREFIX + self.kind, "version": VERSION, "slcp_warp": slcp.__version__}
        temporary = path.with_name(path.name + ".part")
        with open(temporary, "wb") as file:
            text = np.array(json.dumps(header | self.header))
            np.savez_compressed(file, allow_pickle=False, header=text, **self.arrays)
        temporary.replace(path)
        return path


def read_kind(path: Path) -> str:
    """The kind of a file by its header: "trajectory", "plan", "surface", "library", "sweep", ..

    Raises:
        RecordError: not a file of this project. FileNotFoundError: no such file.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            header = json.loads(str(archive["header"]))
        kind = str(header["format"])
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file") from None
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise RecordError(f"{path} cannot be read as a file of slcp: {error}") from error
    return kind.removeprefix(PREFIX)


def load_record(path: Path, kind: str) -> Record:
    """Read a file of a kind.

    Raises:
        RecordError: truncated, of another kind or of a newer version. FileNotFoundError: no such file.
    """
    found = read_kind(path)
    if found != kind:
        raise RecordError(f"{path} holds a {found}; a {kind} is needed")
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise RecordError(f"{path} cannot be read as a {kind}: {error}") from error
    header = json.loads(str(arrays.pop("header")))
    if header.get("version") != VERSION:
        raise RecordError(f"{path} has version {header.get('version')}; this program reads {VERSION}")
    missing = [name for name in NEEDED[kind] if name not in arrays]
    if missing:
        raise RecordError(f"{path} lacks the arrays {missing}")
    return Record(kind, arrays, header)


def scene_facts(sim: slcp.Simulator, params: slcp.Parameters) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays (every parameter, as param_<name>) and header entries that say what was simulated."""
    arrays = {f"param_{name}": np.asarray(params[name]) for name in params.names}
    header = {
        "scene": sim.scene.name,
        "residual": sim.options.residual,
        "scaling": sim.options.scaling,
        "friction": sim.options.friction,
        "integrator": sim.options.integrator,
        "device": str(sim.device),
        "dtype": sim.dtype.__name__,
        "step_size": float(np.ravel(params["step_size"])[0]),
        "sigma": None if sim.options.hard else float(np.ravel(params["sigma"])[0]),
    }
    return arrays, header


def result_arrays(result: ddp.Result) -> dict[str, np.ndarray]:
    """A single problem's result as arrays; the trace's columns as trace_<name>."""
    arrays = {f.name: np.asarray(getattr(result, f.name)) for f in fields(result) if f.name != "trace"}
    return arrays | {f"trace_{f.name}": getattr(result.trace, f.name) for f in fields(result.trace)}


def result_of(record: Record) -> ddp.Result:
    """The result that a plan file holds."""
    trace = ddp.Trace(**{f.name: record[f"trace_{f.name}"] for f in fields(ddp.Trace)})
    values: dict[str, Any] = {f.name: record[f.name] for f in fields(ddp.Result) if f.name != "trace"}
    return ddp.Result(**values, trace=trace)


def load_policy(path: Path, scene: slcp.Scene) -> tuple[Any, dict[str, Any]]:
    """The policy that a library or plan file holds, and header entries about it."""
    kind = read_kind(path)
    if kind == "library":
        library = ddp.Library.load(path)
        library.check_scene(scene)
        return library.policy(), {"policy": "nearest", "policy_file": path.name, "entries": len(library)}
    plan = load_record(path, "plan")
    if plan.header["scene"] != scene.name:
        raise RecordError(f"{path} was planned for scene {plan.header['scene']!r}, not {scene.name!r}")
    facts = {"policy": "tracking", "policy_file": path.name, "planned_step_size": plan.header["step_size"]}
    return ddp.TrackingPolicy(result_of(plan), scene.state_period), facts
