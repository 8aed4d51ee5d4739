"""Entries of a library of local feedback controllers (section IV.C), as arrays that fit each other."""

import hashlib
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np

from slcp_warp import Scene
from slcp_warp.inputs.checks import array, instance, shown
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.storage.printed import Printed, Table, counted

LIMITS = ("lower", "upper")
ARRAYS = ("x", "u", "K", "cost", "gain", "age", "chain", "plan", *LIMITS)
NEEDED = (*ARRAYS, "period")


class LibraryError(ArgumentError):
    """A library file that cannot be read, or a library that does not fit its use."""


def scene_digest(scene: Scene) -> str:
    """Digest of a scene's topology; numbers, and the rules by which dampers and springs act, may differ
    between building and using a library. It is what it was before there was a choice of rules: files stay
    readable.
    """
    s = scene.structure
    names = [f.name for f in fields(s) if not f.name.startswith("implicit_")]
    parts = (
        f"{name}={getattr(s, name)!r}"
        for name in names
        if name not in ("armature", "tendons", "limited") or getattr(s, name)
    )
    return hashlib.sha256(f"Structure({', '.join(parts)})".encode()).hexdigest()[:16]


@dataclass(frozen=True, repr=False)
class Entries(Printed):
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
        header: what it was built with (scene, digest, sigma, step size, seed, ...), JSON values; with `end`,
            the steps of a run, its entries belong to steps.
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
        check_shapes({name: getattr(self, name) for name in NEEDED if name not in LIMITS})
        for name, none in zip(LIMITS, (-np.inf, np.inf), strict=True):
            given = getattr(self, name)
            limit = np.full(self.u.shape, none) if given is None else given.astype(np.float64)
            if limit.shape != self.u.shape:
                raise LibraryError(f"{name} has shape {limit.shape}; {self.u.shape} is needed, as of u")
            object.__setattr__(self, name, limit)
        if not (self.lower <= self.upper).all():
            raise LibraryError("lower: every lower control limit must be at most the upper one")
        if self.header.get("end") is not None:
            self._check_steps()

    def __len__(self) -> int:
        return len(self.x)

    @property
    def step(self) -> np.ndarray | None:
        """(L,) the steps of a run that the entries belong to; None: they belong to none."""
        if self.header.get("end") is None:
            return None
        return np.asarray(self.plan * int(self.header["offset"]) + self.age)

    @property
    def step_size(self) -> float | None:
        """Of the run's steps [s]; None where the entries belong to none."""
        return None if self.header.get("end") is None else float(self.header["step_size"])

    def _check_steps(self) -> None:
        """Raise LibraryError unless the header says which steps of a run the entries belong to."""
        for name in ("end", "offset", "step_size"):
            given: Any = self.header.get(name)
            whole = name == "step_size" or isinstance(given, int)
            if not isinstance(given, int | float) or isinstance(given, bool) or not given > 0 or not whole:
                raise LibraryError(f"header: {name} is {shown(given)}; a positive number is needed")
        for name in ("age", "plan"):
            column = getattr(self, name)
            if column.dtype.kind not in "iu" or (column < 0).any():
                raise LibraryError(f"{name}: whole numbers of at least 0 are needed for steps of a run")

    def _line(self) -> str:
        name = self.header.get("scene")
        of = f"of {shown(name)}: " if isinstance(name, str) else ""
        plans = len(np.unique(np.stack([self.chain, self.plan]), axis=1).T) if len(self) else 0
        return f"{of}{counted(len(self), 'controller')} from {counted(plans, 'plan')}"

    def _tables(self) -> list[Table]:
        columns = {"cost": self.cost, "gain": self.gain, "step within its plan": self.age}
        columns |= {f"x[{j}]": self.x[:, j] for j in range(self.x.shape[1])}
        columns |= {f"u[{j}]": self.u[:, j] for j in range(self.u.shape[1])}
        rows = [
            (name, *map(float, (v.min(), np.median(v), v.max()))) for name, v in columns.items() if v.size
        ]
        return [Table("", ("", "lowest", "median", "highest"), rows)]

    def select(self, keep: np.ndarray) -> Self:
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

    def check_scene(self, scene: Scene) -> None:
        """Raise LibraryError if the library was built for another mechanism."""
        if self.header.get("digest") != scene_digest(scene):
            raise LibraryError(
                f"the library was built for scene {self.header.get('scene')!r}, not {scene.name!r}"
            )


def check_shapes(data: dict[str, np.ndarray]) -> None:
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
