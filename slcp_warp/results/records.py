"""Files of results: archives (`storage.archive`) of a mechanism and what came out of it.

Kinds: "trajectory" (`Trajectory`), "plan" (`ddp.Result`), "surface" (of `slcp surface`). Each holds its
scene, options and parameters (`simulated.py`). Libraries and sweeps have files of their own: `ddp.Library`,
`SweepReport`.
"""

import os
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..description.scene import Scene
from ..inputs import checks
from ..inputs.errors import ArgumentError
from ..storage.archive import open_archive, write_archive
from ..storage.files import FileError, reading
from ..storage.printed import Printed
from ..storage.version import __version__
from .simulated import OLDER, Simulated

FORMAT, VERSION = "slcp-warp-", 2
Check = Callable[[dict[str, np.ndarray], Simulated], None]


class RecordError(FileError):
    """A file that cannot be read, or is of another kind than needed."""


@dataclass(frozen=True, repr=False)
class Record(Printed):
    """A file's content: kind, arrays by name, the header's other JSON values, and what was simulated."""

    kind: str
    arrays: dict[str, np.ndarray]
    simulated: Simulated
    header: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name]

    def _line(self) -> str:
        return f"{self.kind} of {self.scene.name!r}: {', '.join(self.arrays)}"

    @property
    def scene(self) -> Scene:
        """The scene that was simulated."""
        return self.simulated.scene

    @property
    def step_size(self) -> float:
        """The time step h, of the first world if they differ [s]."""
        return self.simulated.step_size

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the file; an existing one is replaced only once the new one is complete."""
        path = archive_path(path)
        form = {"format": FORMAT + self.kind, "version": VERSION, "slcp_warp": __version__}
        write_archive(
            path, self.simulated.header() | self.header | form, self.arrays | self.simulated.arrays()
        )
        return path

    def facts(self) -> dict[str, Any]:
        """The header's entries that say neither what the file is nor what was simulated."""
        known = {"format", "version", "slcp_warp", *self.simulated.header()}
        return {name: value for name, value in self.header.items() if name not in known}


def archive_path(path: str | os.PathLike[str]) -> Path:
    """A path that ends in .npz.

    Raises:
        ArgumentError: another ending.
    """
    given = checks.path("path", path)
    if given.suffix != ".npz":
        raise ArgumentError(f"path {given} ends in {given.suffix!r}; .npz is needed")
    return given


def read_kind(path: str | os.PathLike[str]) -> str:
    """The kind of a file by its header: "trajectory", "plan", "surface", "library", "sweep", ..

    Raises:
        RecordError: not a file of this project.
        FileNotFoundError: no such file.
    """
    with reading(path, "a file of slcp", RecordError), open_archive(path) as archive:
        form = archive.header.get("format")
        if not isinstance(form, str) or not form.startswith(FORMAT):
            raise RecordError(f"its format is {form!r:.60}")
        return form.removeprefix(FORMAT)


def read_record(path: str | os.PathLike[str], kind: str, names: Collection[str], check: Check) -> Record:
    """Read a file of a kind, whose arrays `check` judges. Arrays of other `names` are not looked at.

    Raises:
        RecordError: truncated, of another kind or of a newer version, without its scene, or inconsistent.
        FileNotFoundError: no such file.
    """
    found = read_kind(path)
    if found != kind:
        raise RecordError(f"{path} holds a {found:.60}; a {kind} is needed")
    with reading(path, f"a {kind}", RecordError), open_archive(path) as archive:
        version = archive.check_format(FORMAT + kind, OLDER, VERSION)
        simulated = Simulated.read(archive, version)
        arrays = archive.read_all(name for name in archive.names if name in names)
        check(arrays, simulated)
        return Record(kind, arrays, simulated, archive.header)
