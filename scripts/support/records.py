"""The commands' own files: archives (`slcp_warp.storage.archive`) of a mechanism and what came out of it.

Kinds: "trajectory" (states of worlds over time), "plan" (a result of DDP with its trace) and "surface"
(signed distances on a grid). Each holds its scene, options and parameters (`slcp_warp.simulated`). Libraries
and sweeps have files of their own: `ddp.Library`, `slcp_warp.SweepReport`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.simulated import OLDER, Simulated
from slcp_warp.storage.archive import open_archive, write_archive
from slcp_warp.storage.files import FileError, reading

from .record_checks import check_plan, check_surface, check_trajectory

PREFIX, VERSION = "slcp-warp-", 2
CHECKS: dict[str, Callable[[dict[str, np.ndarray], Simulated], None]] = {
    "trajectory": check_trajectory,
    "plan": check_plan,
    "surface": check_surface,
}


class RecordError(FileError):
    """A file that cannot be read, or is of another kind than needed."""


@dataclass(frozen=True)
class Record:
    """A file's content: kind, arrays by name, the header's other JSON values, and what was simulated."""

    kind: str
    arrays: dict[str, np.ndarray]
    simulated: Simulated
    header: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name]

    @property
    def scene(self) -> slcp.Scene:
        """The scene that was simulated."""
        return self.simulated.scene

    @property
    def step_size(self) -> float:
        """The time step h, of the first world if they differ [s]."""
        return float(np.ravel(self.simulated.parameters["step_size"])[0])

    def save(self, path: Path) -> Path:
        """Write the file; an existing one is replaced only once the new one is complete."""
        form = {"format": PREFIX + self.kind, "version": VERSION, "slcp_warp": slcp.__version__}
        header = self.simulated.header() | self.header | form
        write_archive(path, header, self.arrays | self.simulated.arrays())
        return path


def read_kind(path: Path) -> str:
    """The kind of a file by its header: "trajectory", "plan", "surface", "library", "sweep", ..

    Raises:
        RecordError: not a file of this project.
        FileNotFoundError: no such file.
    """
    with reading(path, "a file of slcp", RecordError), open_archive(path) as archive:
        form = archive.header.get("format")
        if not isinstance(form, str) or not form.startswith(PREFIX):
            raise RecordError(f"its format is {form!r:.60}")
        return form.removeprefix(PREFIX)


def load_record(path: Path, kind: str) -> Record:
    """Read a file of a kind.

    Raises:
        RecordError: truncated, of another kind or of a newer version, without its scene, or inconsistent.
        FileNotFoundError: no such file.
    """
    found = read_kind(path)
    if found != kind:
        raise RecordError(f"{path} holds a {found:.60}; a {kind} is needed")
    with reading(path, f"a {kind}", RecordError), open_archive(path) as archive:
        version = archive.check_format(PREFIX + kind, OLDER, VERSION)
        simulated = Simulated.read(archive, version)
        own = {f"param_{name}" for name in simulated.parameters.names}
        arrays = archive.read_all(name for name in archive.names if name not in own)
        CHECKS[kind](arrays, simulated)
        return Record(kind, arrays, simulated, archive.header)


def device_facts(sim: slcp.Simulator) -> dict[str, Any]:
    """Header entries: where and in which precision was simulated."""
    return {"device": str(sim.device), "dtype": sim.dtype.__name__}


def result_arrays(result: ddp.Result) -> dict[str, np.ndarray]:
    """A single problem's result as arrays; the trace's columns as trace_<name>."""
    arrays = {f.name: np.asarray(getattr(result, f.name)) for f in fields(result) if f.name != "trace"}
    return arrays | {f"trace_{f.name}": getattr(result.trace, f.name) for f in fields(result.trace)}


def result_of(record: Record) -> ddp.Result:
    """The result that a plan file holds."""
    trace = ddp.Trace(**{f.name: record[f"trace_{f.name}"] for f in fields(ddp.Trace)})
    values: dict[str, Any] = {
        "lower": np.full(record["us"].shape[-1], -np.inf),  # of files that state no limits
        "upper": np.full(record["us"].shape[-1], np.inf),
    }
    values |= {f.name: record[f.name] for f in fields(ddp.Result) if f.name in record.arrays}
    return ddp.Result(**values, trace=trace)


def load_policy(path: Path, scene: slcp.Scene) -> tuple[Any, dict[str, Any]]:
    """The policy that a library or plan file holds, and header entries about it."""
    kind = read_kind(path)
    if kind == "library":
        library = ddp.Library.load(path)
        library.check_scene(scene)
        return library.policy(), {"policy": "nearest", "policy_file": path.name, "entries": len(library)}
    plan = load_record(path, "plan")
    if scene_digest(plan.scene) != scene_digest(scene):
        raise RecordError(f"{path} was planned for scene {plan.scene.name!r}, not {scene.name!r}")
    facts = {"policy": "tracking", "policy_file": path.name, "planned_step_size": plan.step_size}
    return ddp.TrackingPolicy(result_of(plan), scene.state_period), facts
