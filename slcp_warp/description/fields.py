"""Fields of the scene's classes: each is checked by the rules of `rules.py` and kept as plain floats, texts
and tuples, whatever kind of sequence and number came.
"""

import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..inputs import rules
from ..inputs.checks import shown, whole
from ..inputs.errors import SceneError

TURNS = 4.0 * math.pi  # rad: where no part is turned to by intent


def several(value: Any) -> bool:
    """Whether a value has entries that may be numbers."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


class Fields:
    """The fields of one object of a scene, for errors that say which."""

    def __init__(self, item: Any, label: str) -> None:
        self.item, self.label = item, label

    def _get(self, name: str) -> tuple[Any, str]:
        return getattr(self.item, name), f"{self.label}{name}"

    def _put(self, name: str, value: Any) -> None:
        object.__setattr__(self.item, name, value)  # the classes are frozen

    def text(self, name: str, optional: bool = False, none: str = " for the world") -> None:
        """A name, not empty, of printable characters, or (optional) None, which stands for `none`."""
        value, label = self._get(name)
        if not (value is None and optional or isinstance(value, str) and value and value.isprintable()):
            need = f"a name, or None{none}," if optional else "a name"
            need += " of printable characters" if isinstance(value, str) and value else ""
            raise SceneError(f"{label} is {shown(value)}; {need} is needed")

    def choice(self, name: str, choices: Sequence[str]) -> None:
        """One of some texts."""
        value, label = self._get(name)
        if not isinstance(value, str) or value not in choices:
            raise SceneError(f"{label} {shown(value)} is unknown; choose one of {sorted(choices)}")

    def flag(self, name: str) -> None:
        """True or False."""
        value, label = self._get(name)
        if not isinstance(value, bool | np.bool_):
            raise SceneError(f"{label} is {shown(value)}; True or False is needed")
        self._put(name, bool(value))

    def whole(self, name: str) -> None:
        """A whole number of at least 0."""
        value, label = self._get(name)
        self._put(name, whole(label, value, 0, error=SceneError))

    def number(self, name: str, rule: str = "", optional: bool = False) -> None:
        """A number that obeys the rule of a parameter (default: of the field's name)."""
        value, label = self._get(name)
        if value is None and optional:
            return
        self._put(name, float(rules.numbers(label, value, SceneError, rule or name, ndim=0)))

    def angle(self, name: str, rule: str = "") -> None:
        """A number in radians; of one that looks like degrees a RuntimeWarning says so."""
        self.number(name, rule)
        value, label = self._get(name)
        if abs(value) > TURNS:
            warnings.warn(f"{label} is {value:g}; angles are in radians (np.radians({value:g}))",
                          RuntimeWarning, stacklevel=5)  # fmt: skip

    def pair(self, name: str, rule: str = "") -> None:
        """Two numbers."""
        value, label = self._get(name)
        self._put(name, self._entries(label, value, 2, rule or name, False))

    def per_dof(self, name: str, count: int, optional: bool = False) -> None:
        """One number for every degree of freedom, or one for all; None where it may be."""
        value, label = self._get(name)
        if value is None and optional:
            return
        if several(value):
            self._put(name, self._entries(label, value, count, name, optional))
        else:
            self.number(name)

    def entries(self, name: str, count: int, rule: str = "", optional: bool = False) -> None:
        """So many numbers, or None; `optional`: None may stand among them, too."""
        value, label = self._get(name)
        if value is not None:
            self._put(name, self._entries(label, value, count, rule or name, optional))

    def _entries(self, label: str, value: Any, count: int, rule: str, optional: bool) -> tuple[Any, ...]:
        if not several(value):
            raise SceneError(f"{label} is {shown(value)}; {count} numbers are needed")
        if len(value) != count:
            raise SceneError(f"{label} has {len(value)} entries; {count} are needed")
        return tuple(
            None if entry is None and optional
            else float(rules.numbers(f"{label}[{i}]", entry, SceneError, rule, ndim=0))
            for i, entry in enumerate(value)
        )  # fmt: skip

    def objects(self, name: str, kind: type) -> None:
        """A tuple of objects of a class."""
        value, label = self._get(name)
        if not isinstance(value, list | tuple):
            raise SceneError(f"{label} is {shown(value)}; a tuple of {kind.__name__} is needed")
        for i, entry in enumerate(value):
            if not isinstance(entry, kind):
                raise SceneError(f"{label}[{i}] is {shown(entry)}; a {kind.__name__} is needed")
        self._put(name, tuple(value))
