"""The kernels' table of parameters made of arrays by name, in whatever library differentiates it."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from ..description.acting import BUILT, acting
from ..description.columns import places_of_all
from ..description.scene import Scene
from ..inputs import rules
from ..inputs.checks import shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..inputs.rules import COVARIANCES, shapes_of
from ..parameters import ParameterError, Parameters


class Library(Protocol):
    """What a table is made with: a library's arrays of one type on one device."""

    def known(self, name: str, value: Any) -> Any:
        """A value as an array of the type: an array of the library's own, or numbers.

        Raises:
            ParameterError: an array of another type or elsewhere, or no numbers.
        """

    def numbers(self, value: np.ndarray) -> Any:
        """An array of numbers."""

    def broadcast(self, value: Any, shape: tuple[int, ...]) -> Any:
        """A value repeated along axes of length one."""

    def where(self, which: Sequence[bool], first: Any, second: Any) -> Any:
        """The columns of `first` where `which` holds, of `second` elsewhere."""

    def join(self, columns: Sequence[Any]) -> Any:
        """Tables of equally many rows beside each other."""

    def put(self, table: Any, places: Sequence[int], columns: Any) -> Any:
        """The table with other columns in some places."""


def base_of(given: Any, own: Parameters, what: str, instead: str) -> Parameters:
    """The parameters that values by name replace some of, or those that were given in place of values.

    Args:
        given: `Parameters`, values by name, or None.
        own: the simulator's.
        what: the library's arrays, and `instead`, what to give in place of tracked parameters, in words.

    Raises:
        ArgumentTypeError, ParameterError: something else, another scene's, tracked ones.
    """
    if not isinstance(given, Parameters | Mapping | None):
        raise ArgumentTypeError(
            f"params is a {type(given).__name__}; Parameters or a dict of {what} by name is needed"
        )
    base = given if isinstance(given, Parameters) else own
    if base.scene.structure != own.scene.structure:
        raise ParameterError(
            f"params belong to scene {base.scene.name!r}; this simulator has {own.scene.name!r}"
        )
    if isinstance(given, Parameters) and given.requires_grad:
        raise ParameterError(f"params are tracked, which is for wp.Tape; {instead}")
    return base


def check_values(base: Parameters, rows: np.ndarray) -> None:
    """The errors of `Parameters.replace` for illegal values of a table; a covariance need be finite only."""
    values = {
        name: rows[:, start : start + math.prod(shape)].reshape(len(rows), *shape)
        for name, start, shape in base.layout.columns
    }
    for name in COVARIANCES:
        rules.check(name, values.pop(name, np.zeros(1)), ParameterError, name)
    Parameters(base.scene).replace(**values)


def fill(library: Library, table: Any, base: Parameters, values: Mapping[Any, Any]) -> Any:
    """The table (1 or B, P) of `base` with values by name in place of its numbers.

    Raises:
        ParameterError: an unknown name, another shape, values for different numbers of worlds.
    """
    parts = [name for name in values if isinstance(name, str) and "." in name]
    unknown = [name for name in values if name not in base.names and name not in parts]
    if unknown:
        raise ParameterError(f"no parameter {shown(unknown)}; there are {list(base.names)}")
    columns = []
    for name, start, shape in base.layout.columns:
        size = math.prod(shape)
        kept = table[:, start : start + size]
        given = _column(library, name, values[name], shape, size) if name in values else kept
        if name in values and name in BUILT and name != "shape_angle" and not _has_shape(values[name], shape):
            given = _where_it_acts(library, given, kept, acting(base.scene.structure, name))
        columns.append(given)
    rows = {len(c) for c in columns} - {1}
    if len(rows) > 1:
        raise ParameterError(f"params disagree on the number of worlds: {sorted(rows)}")
    count = rows.pop() if rows else 1
    table = library.join([library.broadcast(c, (count, c.shape[1])) for c in columns])
    return _with_parts(library, table, base.scene, {name: values[name] for name in parts})


def _has_shape(value: Any, shape: tuple[int, ...]) -> bool:
    """Whether a value has a number for everything that the parameter has one of, or that for each world."""
    own = tuple(value.shape) if hasattr(value, "shape") else np.shape(value)
    return own == shape or own[1:] == shape


def _where_it_acts(library: Library, given: Any, kept: Any, acts: list[bool]) -> Any:
    """One number for all parts, of those that the scene was built with; the others keep theirs."""
    each = given.shape[1] // max(len(acts), 1)
    return library.where([act for act in acts for _ in range(each)], given, kept)


def _with_parts(library: Library, table: Any, scene: Scene, values: Mapping[str, Any]) -> Any:
    """The table with numbers of single parts, "box.mass", after those of all."""
    try:
        places = places_of_all(scene, values, "params")
    except ArgumentError as error:
        raise ParameterError(str(error)) from None
    for name, value in values.items():
        column = _column(library, name, value, (), 1)
        if len(column) > 1 and len(table) == 1:
            table = library.broadcast(table, (len(column), table.shape[1]))
        if len(column) not in (1, len(table)):
            raise ParameterError(f"{name} is for {len(column)} worlds, other numbers are for {len(table)}")
        at = places[name]
        table = library.put(table, at, library.broadcast(column, (len(table), len(at))))
    return table


def _column(library: Library, name: str, given: Any, shape: tuple[int, ...], size: int) -> Any:
    """The columns of a parameter, (1 or B, size)."""
    value = library.known(name, given)
    if name in COVARIANCES and value.ndim < 2:  # times the identity, as in `Parameters.replace`
        value = value[..., None, None] * library.numbers(np.eye(shape[0]))
    if len(shape) == 2 and value.shape == shape[:1]:  # of each item, not of each world
        value = library.broadcast(value[:, None], shape)
    if value.shape == shape or value.ndim == 0:
        return library.broadcast(value.reshape(1, -1), (1, size))
    if value.shape[1:] == shape:
        return value.reshape(len(value), size)
    if value.ndim == len(shape) + 1 and value.shape[1:] == (1,) * len(shape):
        return library.broadcast(value.reshape(len(value), 1), (len(value), size))
    if value.ndim == 1:
        return library.broadcast(value[:, None], (len(value), size))
    raise ParameterError(f"{name} has shape {tuple(value.shape)}; give {shapes_of(shape)}")
