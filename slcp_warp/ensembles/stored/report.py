"""The report of a sweep from its folder, whether or not the sweep can go on here."""

import os

from ...inputs import checks
from ...inputs.errors import InputError
from ...runs.job import plain
from ...runs.store import Store
from ...storage.files import FileError
from ...tasks.task import Task
from ..outcome import Report
from .identity import task_identity
from .job import KIND
from .layout import chunks_of
from .source import StoreSource
from .travel import unpack


def load_report(path: str | os.PathLike[str]) -> Report:
    """A report of what a sweep's folder holds (`sweep(..., out=)`), or of a file of `Report.save`.

    Of a folder nothing is read before it is asked for. The task is None where it cannot be read here, and
    of a .csv, which holds rows only.

    Raises:
        FileNotFoundError: not there.
        FileError: no report, or damaged.
    """
    found = checks.path("path", path)
    if not found.is_dir():
        return Report.load(found)
    store = Store(found)
    if store.manifest.kind != KIND:
        raise FileError(f"{found} holds a {store.manifest.kind}, not a {KIND}")
    source = StoreSource(store, chunks_of(store.manifest.layout))
    return Report(_task(store), source, complete=not store.missing())


def _task(store: Store) -> Task | None:
    """The task, if it can be read here and is still what was run."""
    there = store.manifest
    if there.reference is None:
        return None
    try:
        task = unpack(store.folder, there.reference["arguments"]["task"], {})[0]
        same = plain(task_identity(task), "Task") == there.specification["task"]
    except (InputError, OSError):  # of a Python file that is not here
        return None
    return task if same else None
