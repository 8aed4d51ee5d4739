"""The pieces of a study that a run of `slcp bench charts` keeps until the study is complete.

A study whose module has `pieces(say)` comes in pieces with names, others in one. Each finished piece is a
part of a store beside the results, so that a run that is killed loses one piece.
"""

import importlib.util
import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.runs.sequence import Sequence, opened, step_of
from slcp_warp.runs.store import Store
from slcp_warp.storage.files import FileError

from ..shared.rows import Say
from .results import SAME, Rows

Piece = tuple[str, Callable[[], Rows]]  # its name, and what measures it


def pieces_of(module: Any, name: str, say: Say) -> list[Piece]:
    """The pieces of a module's rows."""
    if hasattr(module, "pieces"):
        return [(f"{name}, {label}", measure) for label, measure in module.pieces(say)]
    return [(name, lambda: module.rows(say))]


class Kept:
    """The folder of a study's pieces, of this commit on this machine; of others it is begun anew."""

    def __init__(self, folder: Path, study: str, names: list[str], facts: dict[str, Any]) -> None:
        self.folder, self.names = folder, names
        self.store: Store | None = None
        if not all(importlib.util.find_spec(package) for package in ("pyarrow", "filelock")):
            return
        specification = {"pieces": names} | {name: str(facts.get(name, "")) for name in SAME}
        job = Sequence(study, specification)
        try:
            self.store = opened(folder, job)
        except FileError:
            self.clear()
            self.store = opened(folder, job)

    def rows(self, piece: Piece, say: Say) -> Rows:
        """A piece's rows, measured now unless they are kept. What gives none is tried again next time."""
        name, measure = piece
        if self.store is None:
            return measure()
        index = self.names.index(name)
        if self.store.part(index).exists():
            say(f"{name}: kept from before")
        try:
            columns, _ = step_of(self.store, index, lambda: _columns(measure()))
        except _NothingMeasured:
            return []
        return [json.loads(text) for text in columns["row"].tolist()]

    def clear(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)


class _NothingMeasured(Exception):
    """A piece without rows."""


def _columns(rows: Rows) -> dict[str, np.ndarray]:
    if not rows:
        raise _NothingMeasured
    return {"row": np.array([json.dumps(row, default=_plain) for row in rows])}


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    return str(value)


def left_in(folder: Path) -> Iterator[Path]:
    """The folders of studies that were not complete when a run ended."""
    yield from sorted(path for path in folder.glob("*.kept") if path.is_dir())
