"""Files of sweeps: the table as .csv; everything as .npz, written and read with its checks."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..options import Status
from ..storage.archive import Archive, open_archive, write_archive
from ..storage.files import FileError, reading
from ..storage.rows import save_rows

FORMAT, VERSION = "slcp-warp-sweep", 1
INTERVALS = ("mean_rate", "share_above", "share_spinning", "share_recovered", "median_recovery_time",
             "contact_share")  # fmt: skip
COLUMNS = ("residual", "step_size", "world", "status", "rate", "spinning", "recovery_time", "contact_share",
           "lowest_gap")  # fmt: skip

SHARES = ("spinning", "contact_share")  # columns in [0, 1]
ROUNDING = 1e-5  # of shares in single precision

Table = dict[str, np.ndarray]
Cases = list[dict[str, Any]]


def save_table(path: str | Path, table: Table) -> Path:
    """The table as .csv; replaced only once complete."""
    return save_rows(path, table, zip(*(column.tolist() for column in table.values()), strict=True))


def write(
    path: Path, cases: Cases, table: Table, samples: list[np.ndarray], spec: dict[str, Any], complete: bool
) -> None:
    """Everything as .npz, without pickle; replaced only once complete."""
    header = {"format": FORMAT, "version": VERSION, "spec": spec, "cases": cases, "complete": complete}
    arrays = {f"table_{name}": column for name, column in table.items()}
    arrays |= {f"samples_{i}": a for i, a in enumerate(samples)}
    write_archive(path, header, arrays)


def read(path: str | Path) -> tuple[Cases, Table, list[np.ndarray], dict[str, Any], bool]:
    """Cases, table, samples, spec and whether it is complete, of a file that `write` made.

    Raises:
        FileNotFoundError: not there.
        FileError: truncated, not a sweep, or inconsistent.
    """
    with reading(path, "a sweep", FileError), open_archive(path) as archive:
        archive.check_format(FORMAT, VERSION)
        header = archive.header
        cases, spec, complete = header.get("cases"), header.get("spec"), header.get("complete")
        if not isinstance(cases, list) or not isinstance(spec, dict) or not isinstance(complete, bool):
            raise FileError("cases, spec or complete of its header are missing")
        for i, case in enumerate(cases):
            _check_case(f"case {i}", case)
        _check_spec(spec)
        names = [name for name in archive.names if name.startswith("table_")]
        table = {name[6:]: archive.read(name, "biufU") for name in names}
        _check_table(table, cases)
        return cases, table, _samples(archive, cases), spec, complete


def _check_case(label: str, case: Any) -> None:
    """Raise FileError unless a case has its counts, statuses and intervals."""
    if not isinstance(case, dict):
        raise FileError(f"{label} is {case!r:.60}; a table of values is needed")
    if not isinstance(case.get("residual"), str) or not _number(case.get("step_size"), positive=True):
        raise FileError(f"{label}: residual and step_size are missing")
    worlds, statuses = case.get("worlds"), case.get("statuses")
    if not _count(worlds):
        raise FileError(f"{label}: worlds is {worlds!r:.60}; a whole number is needed")
    known = {status.name for status in Status}
    if not isinstance(statuses, dict) or not set(statuses) <= known or "SOLVED" not in statuses:
        raise FileError(f"{label}: statuses is {statuses!r:.60}; counts of {sorted(known)} are needed")
    if not all(_count(n) for n in statuses.values()) or sum(statuses.values()) != worlds:
        raise FileError(f"{label}: statuses do not count its {worlds} worlds: {statuses}")
    for name in INTERVALS:
        interval = case.get(name)
        if not isinstance(interval, list) or len(interval) != 3 or not all(map(_number, interval)):
            raise FileError(f"{label}: {name} is {interval!r:.60}; (value, low, high) is needed")
        value, low, high = interval
        if value < low - ROUNDING or high + ROUNDING < value:
            raise FileError(f"{label}: {name} is {interval!r:.80}; low <= value <= high is needed")


def _check_spec(spec: dict[str, Any]) -> None:
    for name in ("duration", "window", "sample_every"):
        if not _number(spec.get(name), positive=True):
            raise FileError(f"spec: {name} is {spec.get(name)!r:.60}; a positive and finite number is needed")
    if not _number(spec.get("threshold")) or not math.isfinite(spec["threshold"]):
        raise FileError(f"spec: threshold is {spec.get('threshold')!r:.60}; a finite number is needed")


def _check_table(table: dict[str, np.ndarray], cases: list[dict[str, Any]]) -> None:
    """Raise FileError unless every case has a row a world, in every column."""
    rows = sum(case["worlds"] for case in cases)
    missing = [name for name in COLUMNS if name not in table] if cases else []
    if missing:
        raise FileError(f"its table lacks the columns {missing}")
    for name, column in table.items():
        if column.shape != (rows,):
            raise FileError(f"column {name!r} has shape {column.shape}, ({rows},) is needed")
        if (column.dtype.kind == "U") != (name == "residual"):
            raise FileError(f"column {name!r} is of type {column.dtype}")
    begin = 0
    for i, case in enumerate(cases):
        own = slice(begin, begin + case["worlds"])
        _check_rows(f"case {i}", case, {name: column[own] for name, column in table.items()})
        begin = own.stop


def _check_rows(label: str, case: dict[str, Any], rows: Table) -> None:
    """Raise FileError unless the rows of a case are those that it names and counts."""
    for status in Status:  # counts add up to all worlds, so that what is no status is missed here
        found, named = int((rows["status"] == status).sum()), case["statuses"].get(status.name, 0)
        if found != named:
            raise FileError(f"{label}: {found} rows are {status.name}, it counts {named}")
    if (rows["world"] != np.arange(case["worlds"])).any():
        raise FileError(f"{label}: column 'world' does not count up from 0")
    need = {"residual": case["residual"], "step_size": case["step_size"]}
    for name, value in need.items():
        column = rows[name]
        same = column == value if column.dtype.kind == "U" else np.isclose(column, value, rtol=1e-6, atol=0.0)
        if not same.all():
            raise FileError(f"{label}: column {name!r} holds {column[~same][0]}, {value!r} is needed")
    solved = rows["status"] == Status.SOLVED
    for name in SHARES:
        column = rows[name][solved]
        if not ((column >= 0.0) & (column <= 1.0 + ROUNDING)).all():
            raise FileError(f"{label}: column {name!r} holds what is not in [0, 1]")
    for name in ("rate", "lowest_gap", "recovery_time"):
        column = rows[name][solved]
        if np.isnan(column).any() or (name == "rate" and np.isinf(column).any()):
            raise FileError(f"{label}: column {name!r} holds what is no number, of a world that is solved")
    if (rows["recovery_time"] < 0.0).any():
        raise FileError(f"{label}: column 'recovery_time' holds a negative time")


def _samples(archive: Archive, cases: list[dict[str, Any]]) -> list[np.ndarray]:
    """The samples of every case, (worlds, S)."""
    samples = [archive.read(f"samples_{i}") for i in range(len(cases))]
    for i, (case, trace) in enumerate(zip(cases, samples)):
        if trace.ndim != 2 or len(trace) != case["worlds"] or trace.shape[1] != samples[0].shape[1]:
            raise FileError(f"array 'samples_{i}' has shape {trace.shape}; ({case['worlds']}, S) is needed")
    return samples


def _number(value: Any, positive: bool = False) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and (not positive or 0.0 < value < math.inf)


def _count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0
