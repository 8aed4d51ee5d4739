"""A library of local feedback controllers (section IV.C) and its file.

Every entry is the first step of a plan: u = u_i + K_i (x - x_i), with what tells good plans from passive
ones.
The file is a NumPy archive (.npz) of plain arrays and a JSON header (`slcp_warp.storage.archive`); nothing is
pickled.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.inputs.checks import path as checked_path
from slcp_warp.inputs.checks import shown
from slcp_warp.storage.archive import open_archive, write_archive
from slcp_warp.storage.files import reading

from .entries import ARRAYS, LIMITS, NEEDED, Entries, LibraryError, check_shapes
from .nearest import NearestPolicy

FORMAT, VERSION = "slcp-warp-library", 2
WITHOUT_LIMITS = 1  # version of files that state no control limits
WHOLE = ("age", "chain", "plan")
OF_STEPS = ("end", "offset", "step_size")  # of a header: runs that differ in them are not joined


@dataclass(frozen=True, repr=False)
class Library(Entries):
    """Local controllers, first axis L = number of entries, with their policy and their file.

    Attributes:
        x: states where the controllers were planned, (L, nx).
        u, K: controls (L, nu) and gains (L, nu, nx).
        cost: of the plan, (L,).
        gain: how much less than with zero controls from the plan's first state, (L,).
        age: step within its plan, (L,).
        chain, plan: which chain and which of its plans, (L,).
        period: of every state component, 0 where there is none, (nx,).
        header: what it was built with (scene, digest, sigma, step size, seed, ...), JSON values.
        lower, upper: limits within which the controllers were planned, (L, nu); None: no limits.
    """

    def policy(self, **options: Any) -> NearestPolicy:
        """The nearest-neighbour policy (20) with these `options` of `NearestPolicy`."""
        return NearestPolicy(self, **options)

    def save(self, path: str | Path) -> Path:
        """Write the library; an existing file is replaced only once the new one is complete."""
        if not len(self):
            raise LibraryError("the library is empty; nothing to save")
        path = checked_path("path", path)
        header = {**self.header, "format": FORMAT, "version": VERSION}
        write_archive(path, header, {name: getattr(self, name) for name in NEEDED})
        return path

    @classmethod
    def load(cls, path: str | Path) -> "Library":
        """Read a library.

        Raises:
            FileNotFoundError: no such file.
            LibraryError: truncated, not a library, of a newer version, or with inconsistent or non-finite
                arrays.
        """
        with reading(path, "a trajectory library", LibraryError), open_archive(path) as archive:
            if archive.header.get("format") is None:
                raise LibraryError("it has no library header; was it written by Library.save?")
            version = archive.check_format(FORMAT, WITHOUT_LIMITS, VERSION)
            older = LIMITS if version == WITHOUT_LIMITS else ()
            data = archive.read_all(tuple(name for name in NEEDED if name not in older))
            _check(data)
            return cls(**data, header=archive.header)


def _check(data: dict[str, np.ndarray]) -> None:
    """Raise LibraryError unless a file's arrays fit each other and are finite."""
    check_shapes(data)
    if not data["x"].size:
        raise LibraryError(f"array 'x' has shape {data['x'].shape}; at least one entry is needed")
    for name, each in data.items():
        if np.isnan(each).any() or (name not in LIMITS and np.isinf(each).any()):
            raise LibraryError(f"array {name!r} contains numbers that are not finite")
        if name in WHOLE and (each.dtype.kind not in "iu" or each.min() < 0):
            raise LibraryError(f"array {name!r} contains what is no index; whole numbers >= 0 are needed")
    if data["period"].min() < 0.0:
        raise LibraryError(f"array 'period' contains {data['period'].min()}; numbers >= 0 are needed")


def concatenate(libraries: list[Library]) -> Library:
    """One library of the entries of several `libraries`; chains are renumbered.

    Raises:
        LibraryError: none, or of different scenes, periods, or steps of runs.
    """
    if not isinstance(libraries, list | tuple) or not all(isinstance(each, Library) for each in libraries):
        raise LibraryError(f"libraries is {shown(libraries)}; a list of ddp.Library is needed")
    if not libraries:
        raise LibraryError("libraries is empty; nothing to concatenate")
    parts, offset = [], 0
    for library in libraries:
        if library.header.get("digest") != libraries[0].header.get("digest"):
            raise LibraryError("the libraries were built for different scenes")
        of_runs = any(each.header.get("end") is not None for each in (library, libraries[0]))
        if of_runs and any(library.header.get(name) != libraries[0].header.get(name) for name in OF_STEPS):
            raise LibraryError("the libraries' entries belong to steps of different runs, or to none")
        if not np.array_equal(library.period, libraries[0].period):
            raise LibraryError(
                f"the libraries' periods are {shown(libraries[0].period.tolist())} and "
                f"{shown(library.period.tolist())}; the same ones are needed"
            )
        parts.append(replace(library, chain=library.chain + offset))
        offset += int(library.chain.max(initial=-1)) + 1
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS
    }
    return replace(libraries[0], **arrays)
