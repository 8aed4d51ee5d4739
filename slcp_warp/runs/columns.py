"""Columns of a chunk: what they may be, and a hash of their contents in which no file format has a part.

A column's hash covers its type, the shape of an entry and its bytes, little-endian, in order; of texts the
bytes of all in UTF-8, and their lengths. It can be fed chunk by chunk, so that the hash of a table does not
depend on where it was cut.
"""

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..inputs.errors import ArgumentError
from .job import Columns

KINDS = "biufU"  # of dtypes


def checked(columns: Any, label: str) -> Columns:
    """Columns as arrays of equal length.

    Raises:
        ArgumentError: no columns, or a column that cannot be kept.
    """
    if not isinstance(columns, Mapping) or not columns:
        raise ArgumentError(f"{label} gave a {type(columns).__name__}; columns by name are needed")
    arrays = {str(name): np.asarray(column) for name, column in columns.items()}
    lengths = {name: len(a) if a.ndim else -1 for name, a in arrays.items()}
    for name, a in arrays.items():
        texts = a.dtype.kind == "U" and a.ndim > 1
        if a.dtype.kind not in KINDS or a.dtype.itemsize > 8 and a.dtype.kind != "U" or texts:
            raise ArgumentError(
                f"{label}: column {name!r} is of type {a.dtype}; numbers of at most 64 bits or texts needed"
            )
    if len(set(lengths.values())) != 1 or -1 in lengths.values():
        raise ArgumentError(f"{label}: columns have the lengths {lengths}; equal ones are needed")
    return {name: np.ascontiguousarray(a) for name, a in arrays.items()}


class ColumnHash:
    """The hash of a column, fed piece by piece."""

    def __init__(self, first: np.ndarray) -> None:
        self.form = form_of(first)
        self._lengths, self._bytes = hashlib.sha256(), hashlib.sha256()

    def feed(self, piece: np.ndarray) -> None:
        """Take the next rows, of the same form."""
        if form_of(piece) != self.form:
            raise ArgumentError(f"a column of {self.form} goes on with {form_of(piece)}")
        if piece.dtype.kind == "U":
            lengths, text = _texts(piece)
            self._lengths.update(lengths)
            self._bytes.update(text)
        else:
            little = piece.astype(piece.dtype.newbyteorder("<"), copy=False)
            self._bytes.update(np.ascontiguousarray(little).reshape(-1).view(np.uint8).data)

    def hexdigest(self) -> str:
        """Of all rows so far."""
        parts = (self.form, self._lengths.hexdigest(), self._bytes.hexdigest())
        return hashlib.sha256(" ".join(parts).encode()).hexdigest()


def form_of(column: np.ndarray) -> str:
    """Type and shape of a column's entries: "float32", "float64 (2, 8)", "text"."""
    shape = f" {column.shape[1:]}" if column.ndim > 1 else ""
    return ("text" if column.dtype.kind == "U" else column.dtype.name) + shape


def _texts(column: np.ndarray) -> tuple[bytes, bytes]:
    """Lengths of texts in UTF-8, as little-endian 32-bit integers, and all of them in a row."""
    if len(column) and (column == column[0]).all():
        one = str(column[0]).encode()
        return np.full(len(column), len(one), "<i4").tobytes(), one * len(column)
    each = [text.encode() for text in column.tolist()]
    return np.array([len(text) for text in each], "<i4").tobytes(), b"".join(each)
