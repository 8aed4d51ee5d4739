"""A library of local feedback controllers (section IV.C) and its file.

Every entry is the first step of a plan: u = u_i + K_i (x - x_i), with what tells good plans from passive
ones.
The file is a NumPy archive (.npz) of plain arrays and a JSON header (`slcp_warp.storage.archive`); nothing is
pickled.
"""

import hashlib
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp import Scene
from slcp_warp.inputs.checks import array, instance, shown
from slcp_warp.inputs.checks import path as checked_path
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.storage.archive import open_archive, write_archive
from slcp_warp.storage.files import reading

FORMAT, VERSION = "slcp-warp-library", 2
WITHOUT_LIMITS = 1  # version of files that state no control limits
LIMITS = ("lower", "upper")
ARRAYS = ("x", "u", "K", "cost", "gain", "age", "chain", "plan", *LIMITS)
NEEDED = (*ARRAYS, "period")
WHOLE = ("age", "chain", "plan")


class LibraryError(ArgumentError):
    """A library file that cannot be read, or a library that does not fit its use."""


def scene_digest(scene: Scene) -> str:
    """Digest of a scene's topology; numbers, and the rule by which dampers act, may differ between building
    and using a library. It is what it was before there was a choice of that rule: files stay readable.
    """
    s = scene.structure
    parts = (f"{f.name}={getattr(s, f.name)!r}" for f in fields(s) if f.repr and f.name != "implicit_damping")
    return hashlib.sha256(f"Structure({', '.join(parts)})".encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Library:
    """Local controllers, first axis L = number of entries.

    Attributes:
        x: (L, nx) states where the controllers were planned.
        u: (L, nu).
        K: (L, nu, nx).
        cost: (L,) cost of the plan.
        gain: (L,) how much less than with zero controls from the plan's first state.
        age: (L,) step within its plan.
        chain, plan: (L,) which chain and which of its plans.
        period: (nx,) period of every state component, 0 where there is none.
        header: what it was built with (scene, digest, sigma, step size, seed, ...), JSON values.
        lower, upper: (L, nu) limits within which the controllers were planned, infinite where there is none;
            the library's policy keeps them. None: no limits.
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
    lower: Any = None
    upper: Any = None

    def __post_init__(self) -> None:
        instance("header", self.header, dict, "a dict")
        for name in NEEDED:
            given = getattr(self, name)
            if given is not None or name not in LIMITS:
                plain = isinstance(given, np.ndarray) and given.dtype.kind in "iuf"
                found = given if plain else array(name, given, finite=False, error=LibraryError)
                object.__setattr__(self, name, found)
        _check_shapes({name: getattr(self, name) for name in NEEDED if name not in LIMITS})
        for name, none in zip(LIMITS, (-np.inf, np.inf), strict=True):
            given = getattr(self, name)
            limit = np.full(self.u.shape, none) if given is None else given.astype(np.float64)
            if limit.shape != self.u.shape:
                raise LibraryError(f"{name} has shape {limit.shape}; {self.u.shape} is needed, as of u")
            object.__setattr__(self, name, limit)
        if not (self.lower <= self.upper).all():
            raise LibraryError("lower: every lower control limit must be at most the upper one")

    def __len__(self) -> int:
        return len(self.x)

    def select(self, keep: np.ndarray) -> "Library":
        """The entries of an index or a mask (L,)."""
        given: Any = keep
        count = len(self)
        if isinstance(given, list | tuple) and all(isinstance(i, int | np.integer | np.bool_) for i in given):
            given = np.array(given, dtype=None if given else int)
        plain = isinstance(given, np.ndarray) and given.ndim == 1
        mask = plain and given.dtype == bool and len(given) == count
        index = plain and given.dtype.kind in "iu" and ((given >= -count) & (given < count)).all()
        if not mask and not index:
            raise LibraryError(f"keep is {shown(keep)}; indices of entries or a mask ({count},) is needed")
        return replace(self, **{name: getattr(self, name)[given] for name in ARRAYS})

    def policy(self, **options: Any) -> Any:
        """The nearest-neighbour policy (20), see `NearestPolicy`."""
        from ..policies import NearestPolicy

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

    def check_scene(self, scene: Scene) -> None:
        """Raise LibraryError if the library was built for another mechanism."""
        if self.header.get("digest") != scene_digest(scene):
            raise LibraryError(
                f"the library was built for scene {self.header.get('scene')!r}, not {scene.name!r}"
            )


def _check_shapes(data: dict[str, np.ndarray]) -> None:
    """Raise LibraryError unless arrays fit each other."""
    for name in ("x", "u"):
        if data[name].ndim != 2:
            raise LibraryError(f"array {name!r} has shape {data[name].shape}, two axes are needed")
    (count, nx), nu = data["x"].shape, data["u"].shape[1]
    need = {"x": (count, nx), "K": (count, nu, nx), "period": (nx,)}
    need |= dict.fromkeys(("u", *LIMITS), (count, nu))
    for name, each in data.items():
        shape = need.get(name, (count,))
        if each.shape != shape:
            raise LibraryError(f"array {name!r} has shape {each.shape}, {shape} is needed, as of 'x' and 'u'")


def _check(data: dict[str, np.ndarray]) -> None:
    """Raise LibraryError unless a file's arrays fit each other and are finite."""
    _check_shapes(data)
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
    """One library of the entries of several; chains are renumbered."""
    if not isinstance(libraries, list | tuple) or not all(isinstance(each, Library) for each in libraries):
        raise LibraryError(f"libraries is {shown(libraries)}; a list of ddp.Library is needed")
    if not libraries:
        raise LibraryError("libraries is empty; nothing to concatenate")
    parts, offset = [], 0
    for library in libraries:
        if library.header.get("digest") != libraries[0].header.get("digest"):
            raise LibraryError("the libraries were built for different scenes")
        parts.append(replace(library, chain=library.chain + offset))
        offset += int(library.chain.max(initial=-1)) + 1
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS
    }
    return replace(libraries[0], **arrays)
