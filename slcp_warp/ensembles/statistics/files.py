"""Rows of a sweep in one file: .csv, the table alone; .npz and .parquet with all that a report needs."""

import csv
import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...inputs.errors import ArgumentError
from ...runs import parts
from ...storage.archive import open_archive, write_archive
from ...storage.files import FileError, reading, replacing
from ...tasks.files import TaskFileError, task_content, task_of
from ...tasks.task import Task
from ..chunks import KEYS
from .csv_table import WHAT, read_table
from .row_checks import all_there, check_rows, checked_key
from .source import OF_ROWS, Columns, MemorySource, Source, joined

FORMAT, VERSION = "slcp-warp-report", 1
PREFIX = "table_"  # of the arrays of an archive
FIELDS: dict[str, Any] = {"rows": int, "columns": list}


def tables(source: Source) -> Iterator[Columns]:
    """The table piece by piece, `KEYS` first; NaN where a part has not got a column."""
    empty: dict[str, float | np.floating] = {}  # by column
    for key in source.keys:
        for name, column in next(source.blocks(key), {}).items():
            empty.setdefault(name, column.dtype.type(math.nan) if column.dtype.kind == "f" else math.nan)
    for key in source.keys:
        for block in source.blocks(key):
            count = len(block["world"])
            left = {name: np.full(count, value) for name, value in zip(KEYS, key)}
            yield left | {
                name: block[name] if name in block else np.full(count, nan) for name, nan in empty.items()
            }


def table(source: Source) -> Columns:
    """The whole table."""
    pieces = list(tables(source))
    return joined(pieces) if pieces else {}


def write(path: Path, source: Source, task: Task | None, complete: bool) -> None:
    """Write the rows as .csv, .npz or .parquet; replaced only once complete.

    Raises:
        ArgumentError: another suffix.
        ImportError: pyarrow is not installed (.parquet); it names the extra.
        OSError: the file cannot be written.
    """
    if path.suffix == ".csv":
        with replacing(path) as part, open(part, "w", newline="", encoding="utf-8") as file:
            writer, pieces = csv.writer(file), tables(source)
            for first in itertools.islice(pieces, 1):
                writer.writerow(first)
                pieces = itertools.chain([first], pieces)
            for piece in pieces:
                writer.writerows(zip(*(column.tolist() for column in piece.values()), strict=True))
        return
    header = _header(source, task, complete)
    if path.suffix == ".npz":
        arrays = {PREFIX + name: array for name, array in table(source).items() if name not in KEYS}
        write_archive(path, header, arrays)
    elif path.suffix == ".parquet":
        rows = table(source) or {name: np.zeros(0) for name in ("policy", *OF_ROWS)}
        data = parts.encode(rows, header)
        with replacing(path) as part:
            part.write_bytes(data)
    else:
        raise ArgumentError(f"path {path} ends in {path.suffix!r}; .csv, .npz or .parquet is needed")


def _header(source: Source, task: Task | None, complete: bool) -> dict[str, Any]:
    """What a file says beside its rows; a task whose cost or measures are code has no content."""
    try:
        content = None if task is None else task_content(task)
    except TaskFileError:
        content = None
    listed = [
        dict(zip(KEYS, key)) | {"rows": source.worlds(key), "columns": list(source.names(key))}
        for key in source.keys
    ]
    return {"format": FORMAT, "version": VERSION, "task": content, "complete": complete, "parts": listed}


def read(path: Path) -> tuple[Task | None, MemorySource, bool]:
    """Task, rows and whether they are complete, of a file that `write` made; a .csv says no task.

    Raises:
        FileNotFoundError: not there.
        FileError: truncated, no report, or inconsistent.
        ArgumentError: another suffix.
    """
    if path.suffix == ".csv":
        return None, *read_table(path)
    if path.suffix not in (".npz", ".parquet"):
        raise ArgumentError(f"path {path} ends in {path.suffix!r}; .csv, .npz or .parquet is needed")
    with reading(path, WHAT, FileError):
        header, columns = _archive(path) if path.suffix == ".npz" else _parquet(path)
        complete, listed, content = (header.get(name) for name in ("complete", "parts", "task"))
        if not isinstance(complete, bool) or not isinstance(listed, list):
            raise FileError("parts or complete of its header are missing")
        task = None if content is None else task_of(content)
        source = _split(listed, columns)
        if complete and (why := all_there(source)):
            raise FileError(f"it says that it is complete, and {why}")
        if task is not None:
            _check_measures(task, source)
        return task, source, complete


def _archive(path: Path) -> tuple[dict[str, Any], Columns]:
    with open_archive(path) as archive:
        archive.check_format(FORMAT, VERSION)
        names = [name for name in archive.names if name.startswith(PREFIX)]
        return archive.header, {name[len(PREFIX) :]: archive.read(name, "biuf") for name in names}


def _parquet(path: Path) -> tuple[dict[str, Any], Columns]:
    header = parts.facts_of(path)
    if (header.get("format"), header.get("version")) != (FORMAT, VERSION):
        raise FileError(f"its format is {header.get('format')!r:.60}, {header.get('version')!r:.20}")
    listed = header.get("parts")
    given = (
        [part.get("columns") for part in listed if isinstance(part, dict)] if isinstance(listed, list) else []
    )
    names = [name for each in given if isinstance(each, list) for name in each if isinstance(name, str)]
    return header, parts.read(path, list(dict.fromkeys(names)))[1] if names else {}


def _split(listed: list[Any], columns: Columns) -> MemorySource:
    """The rows of every part."""
    total = 0
    for number, part in enumerate(listed):
        _check_part(f"part {number}", part, columns)
        total += part["rows"]
    for name, column in columns.items():
        if column.shape != (total,) or column.dtype.kind not in "biuf":
            raise FileError(f"column {name!r} is {column.dtype} {column.shape}; ({total},) numbers needed")
    source, begin = MemorySource(), 0
    for number, part in enumerate(listed):
        key = checked_key(f"part {number}", part)
        if key in source.pieces:
            raise FileError(f"it has the part {key} twice")
        end = begin + part["rows"]
        rows = {name: columns[name][begin:end] for name in part["columns"]}
        check_rows(f"part {key}", rows)
        source.add(key, rows)
        begin = end
    return source


def _check_part(label: str, part: Any, columns: Columns) -> None:
    if not isinstance(part, dict):
        raise FileError(f"{label} is {part!r:.60}; a table of values is needed")
    if missing := [name for name in (*KEYS, *FIELDS) if name not in part]:
        raise FileError(f"{label} lacks {', '.join(missing)}")
    for name, kind in FIELDS.items():
        if not isinstance(part[name], kind) or isinstance(part[name], bool):
            raise FileError(f"{label}: {name} is {part[name]!r:.60}; a {kind.__name__} is needed")
    if part["rows"] < 0:
        raise FileError(f"{label}: rows is {part['rows']}; a whole number of at least 0 is needed")
    names = part["columns"]
    if not all(isinstance(name, str) and name in columns for name in names) or len(set(names)) < len(names):
        raise FileError(f"{label}: its columns are {names!r:.80}, which the table has not got")
    if not set(OF_ROWS) <= set(names) or names[0] != "world":
        raise FileError(f"{label} lacks one of the columns {', '.join(OF_ROWS)}")


def _check_measures(task: Task, source: MemorySource) -> None:
    for key in source.keys:
        missing = [name for name in task.measures if name not in source.names(key)]
        if missing:
            raise FileError(f"part {key} lacks the measures {', '.join(missing)} of its task")
