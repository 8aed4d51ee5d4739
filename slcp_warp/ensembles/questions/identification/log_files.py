"""Logs of a machine from tables: rows at times of their own, put on the steps of a model."""

import warnings
from pathlib import Path

import numpy as np

from ....inputs import checks
from ....inputs.errors import ArgumentError
from ....policies import KalmanFilter
from ....storage.files import FileError
from ....storage.rows import read_csv

WHAT = "a log"
JITTER = 0.25  # of a step, by which a row's time may be off
MOST = 10**7  # steps of a log
APART = 100  # steps between two rows, from which on a time is asked about


def load_log(path: str | Path, filter: KalmanFilter) -> tuple[np.ndarray, np.ndarray]:
    """A recorded run from a .csv table, as `identify` and `KalmanFilter.estimate` take it.

    Rows may be farther apart than the model's steps: in between nothing was measured, and controls hold.

    Args:
        path: of a table with a column "time" [s], one for every sensor of the filter by its name, and one for
            every control of its model, "control pusher.shift", as `Trajectory.table` names them; others are
            left out. The first row is the start. A sensor's empty cell was not read; controls of the last
            row do not count. Several runs, in a column "world", are for several files.
        filter: whose sensors and steps they are.

    Returns:
        Measured (N + 1, sensors), NaN where nothing was, and controls (N, nu), at the model's steps.

    Raises:
        FileNotFoundError: not there.
        FileError: no such table, what is no number, times that do not rise or lie between two steps.
    """
    path = checks.path("path", path)
    filter = checks.instance("filter", filter, KalmanFilter, "a policies.KalmanFilter")
    controls = tuple(f"control {name}" for name in filter.model.scene.control_names)
    taken = {"time", *controls} & set(filter.sensors)
    if taken:
        raise ArgumentError(
            f"filter has a sensor named {taken.pop()!r}, as a log's column is; another is needed"
        )
    if path.suffix != ".csv":
        raise ArgumentError(f"path {path} ends in {path.suffix!r}; .csv is needed")
    rows = read_csv(path, WHAT, ("time", *filter.sensors, *controls))
    try:
        if len({row.get("world") for row in rows}) > 1:
            raise FileError("it has rows of several worlds; a file for each is needed")
        time = _column(rows, "time")
        steps = _steps(time, filter.step_size)
        apart = float(np.median(np.diff(steps))) if len(steps) > 1 else 1.0
        if apart > APART:
            warnings.warn(
                f"{path}: rows are {apart:g} steps of the model apart, of {filter.step_size:g} s; is the "
                "time in seconds?",
                RuntimeWarning,
                stacklevel=2,
            )
        seen = np.full((steps[-1] + 1, len(filter.sensors)), np.nan)
        for i, name in enumerate(filter.sensors):
            seen[steps, i] = _column(rows, name, empty=True)
        us = np.zeros((steps[-1], len(controls)))
        held = np.searchsorted(steps, np.arange(steps[-1]), side="right") - 1
        for i, name in enumerate(controls):
            us[:, i] = _column(rows[:-1], name)[held]
    except FileError as error:
        raise FileError(f"{path} cannot be read as {WHAT}: {error}") from None
    return seen, us


def _steps(time: np.ndarray, h: float) -> np.ndarray:
    """The steps of the model that rows belong to."""
    exact = (time - time[0]) / h
    if not (np.diff(time) > 0.0).all():
        raise FileError(f"column 'time' does not rise at {time[1:][np.diff(time) <= 0.0][0]:g}")
    if exact[-1] > MOST:
        raise FileError(f"it lasts {time[-1] - time[0]:g} s, {exact[-1]:.3g} steps of the model")
    steps = np.round(exact).astype(int)
    off = np.abs(exact - steps)
    if off.max() > JITTER or (np.diff(steps) == 0).any():
        raise FileError(
            f"its row at {time[off.argmax()]:g} s lies between steps of the model, or two rows in one, of "
            f"{h:g} s; times at steps, or a model of finer ones, are needed"
        )
    return steps


def _column(rows: list[dict[str, str]], name: str, empty: bool = False) -> np.ndarray:
    out = np.full(len(rows), np.nan)
    for i, row in enumerate(rows):
        text = row[name].strip()
        if empty and text.lower() in ("", "nan"):
            continue
        try:
            out[i] = float(text)
        except ValueError:
            raise FileError(f"column {name!r} holds {text!r:.60}; numbers are needed") from None
        if not np.isfinite(out[i]):
            raise FileError(f"column {name!r} holds {text!r:.60}; finite numbers are needed")
    return out
