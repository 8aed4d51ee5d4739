"""A library of local feedback controllers (section IV.C) and its file.

Every entry is the first step of a plan: u = u_i + K_i (x - x_i), with what tells good plans from passive
ones.
The file is an uncompressed-readable NumPy archive (.npz) of plain arrays and a JSON header; nothing is
pickled.
"""

import hashlib
import json
import zipfile
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp import ArgumentError, Scene

FORMAT, VERSION = "slcp-warp-library", 1
ARRAYS = ("x", "u", "K", "cost", "gain", "age", "chain", "plan")


class LibraryError(ArgumentError):
    """A library file that cannot be read, or a library that does not fit its use."""


def scene_digest(scene: Scene) -> str:
    """Digest of a scene's topology; numbers may differ between building and using a library."""
    return hashlib.sha256(repr(scene.structure).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Library:
    """Local controllers, first axis L = number of entries.

    Attributes:
        x: (L, nx) states where the controllers were planned. u: (L, nu). K: (L, nu, nx).
        cost: (L,) cost of the plan. gain: (L,) how much less than with zero controls from the plan's first
        state.
        age: (L,) step within its plan. chain, plan: (L,) which chain and which of its plans.
        period: (nx,) period of every state component, 0 where there is none.
        header: what it was built with (scene, digest, sigma, step size, seed, ...), JSON values.
    """

    x: np.ndarray
    u: np.ndarray
    K: np.ndarray
    cost: np.ndarray
    gain: np.ndarray
    age: np.ndarray
    chain: np.ndarray
    plan: np.ndarray
    period: np.ndarray
    header: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.x)

    def select(self, keep: np.ndarray) -> "Library":
        """The entries of an index or a mask (L,)."""
        return replace(self, **{name: getattr(self, name)[keep] for name in ARRAYS})

    def policy(self, **options: Any) -> Any:
        """The nearest-neighbour policy (20), see `NearestPolicy`."""
        from .policies import NearestPolicy

        return NearestPolicy(self, **options)

    def save(self, path: str | Path) -> Path:
        """Write the library; an existing file is replaced only once the new one is complete."""
        if not len(self):
            raise LibraryError("the library is empty; nothing to save")
        path = Path(path)
        header = {"format": FORMAT, "version": VERSION, **self.header}
        arrays = {name: getattr(self, name) for name in (*ARRAYS, "period")}
        temporary = path.with_name(path.name + ".part")
        with open(temporary, "wb") as file:
            np.savez_compressed(file, allow_pickle=False, header=np.array(json.dumps(header)), **arrays)
        temporary.replace(path)
        return path

    @classmethod
    def load(cls, path: str | Path) -> "Library":
        """Read a library.

        Raises:
            FileNotFoundError: no such file.
            LibraryError: truncated, not a library, of a newer version, or with inconsistent or non-finite
            arrays.
        """
        path = Path(path)
        try:
            archive = np.load(path, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ValueError("it holds a single array")
            with archive:
                data = {name: archive[name] for name in archive.files}
        except FileNotFoundError:
            raise
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            raise LibraryError(f"{path} cannot be read as a trajectory library: {error}") from error
        return cls._checked(path, data)

    @classmethod
    def _checked(cls, path: Path, data: dict[str, np.ndarray]) -> "Library":
        try:
            header = json.loads(str(data["header"]))
        except (KeyError, json.JSONDecodeError) as error:
            raise LibraryError(f"{path} has no library header; was it written by Library.save?") from error
        if not isinstance(header, dict) or header.get("format") != FORMAT:
            raise LibraryError(f"{path} is not a {FORMAT} file")
        if header.get("version") != VERSION:
            raise LibraryError(f"{path} has version {header.get('version')}; this program reads {VERSION}")
        missing = [name for name in (*ARRAYS, "period") if name not in data]
        if missing:
            raise LibraryError(f"{path} lacks the arrays {missing}")
        for name in (*ARRAYS, "period"):
            if data[name].dtype.kind not in "iuf":
                raise LibraryError(
                    f"{path}: array {name!r} is of type {data[name].dtype}; numbers are needed"
                )
        count, nx = data["x"].shape if data["x"].ndim == 2 else (-1, -1)
        nu = data["u"].shape[-1] if data["u"].ndim == 2 else -1
        need = {"x": (count, nx), "u": (count, nu), "K": (count, nu, nx), "period": (nx,)}
        for name in (*ARRAYS, "period"):
            shape = need.get(name, (count,))
            if data[name].shape != shape or count < 1:
                raise LibraryError(f"{path}: array {name!r} has shape {data[name].shape}, {shape} is needed")
            if not np.all(np.isfinite(data[name])):
                raise LibraryError(f"{path}: array {name!r} contains numbers that are not finite")
        return cls(**{name: data[name] for name in (*ARRAYS, "period")}, header=header)

    def check_scene(self, scene: Scene) -> None:
        """Raise LibraryError if the library was built for another mechanism."""
        if self.header.get("digest") != scene_digest(scene):
            raise LibraryError(
                f"the library was built for scene {self.header.get('scene')!r}, not {scene.name!r}"
            )


def concatenate(libraries: list[Library]) -> Library:
    """One library of the entries of several; chains are renumbered."""
    if not libraries:
        raise LibraryError("no libraries to concatenate")
    parts, offset = [], 0
    for library in libraries:
        if library.header.get("digest") != libraries[0].header.get("digest"):
            raise LibraryError("the libraries were built for different scenes")
        parts.append(replace(library, chain=library.chain + offset))
        offset += int(library.chain.max()) + 1
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS
    }
    return replace(libraries[0], **arrays)
