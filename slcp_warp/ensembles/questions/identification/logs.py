"""Recorded runs: what sensors showed and which controls acted, of one length or of several."""

from typing import Any, NamedTuple

import numpy as np

from ....inputs.checks import array, numeric, shown
from ....inputs.errors import ArgumentError, ArgumentTypeError
from ....policies import KalmanFilter


class Logs(NamedTuple):
    """R runs, the shorter ones filled up with steps in which nothing was measured.

    Attributes:
        measured: (R, N + 1, sensors), NaN where one was not read.
        controls: (R, N, nu).
        x0: (R, nx) what is believed of the first states: their mean.
    """

    measured: np.ndarray
    controls: np.ndarray
    x0: np.ndarray


def logs_of(filter: KalmanFilter, measured: Any, controls: Any, x0: Any) -> Logs:
    """Recorded runs as they are given.

    Args:
        measured: (R, N + 1, sensors), (N + 1, sensors) of one run, or a list with an array for each.
        controls: the same with (R, N, nu); (N, nu) for all runs of `measured` where they are as long.
        x0: (R, nx), or one (nx,); None: the filter's.

    Raises:
        ArgumentError, ArgumentTypeError: what does not fit together.
    """
    sensors, nu = len(filter.sensors), filter.model.nu
    seen = _runs("measured", measured, sensors)
    us = _runs("controls", controls, nu)
    if len(us) == 1:
        us = us * len(seen)
    if len(us) != len(seen):
        raise ArgumentError(f"controls are of {len(us)} runs, measured of {len(seen)}; one of each is needed")
    for i, (own, acted) in enumerate(zip(seen, us)):
        if len(own) != len(acted) + 1:
            raise ArgumentError(
                f"measured has {len(own)} times and controls {len(acted)} steps of run {i}; "
                f"{len(acted) + 1} times, the start among them, are needed"
            )
        if np.isinf(own).any() or not np.isfinite(acted).all():
            raise ArgumentError(
                f"run {i} of measured and controls holds what is infinite, or a control that is no number; "
                "finite numbers are needed, NaN only where a sensor was not read"
            )
    for own in seen:
        own[:1, filter.sensing.of_step] = np.nan  # no step comes before, whose forces they would show
    if not any(np.isfinite(own).any() for own in seen):
        raise ArgumentError("measured holds NaN only; numbers that a sensor showed are needed")
    longest = max(map(len, us))
    starts = filter.x0 if x0 is None else array("x0", x0)
    if starts.shape not in ((filter.model.nx,), (len(seen), filter.model.nx)):
        need = f"({filter.model.nx},) or ({len(seen)}, {filter.model.nx})"
        raise ArgumentError(f"x0 has shape {starts.shape}; {need} is needed")
    return Logs(
        np.stack([_filled(own, longest + 1, np.nan) for own in seen]),
        np.stack([_filled(acted, longest, 0.0) for acted in us]),
        np.broadcast_to(starts, (len(seen), filter.model.nx)).copy(),
    )


def _runs(name: str, given: Any, width: int) -> list[np.ndarray]:
    """An array (steps, width) for each run."""
    if isinstance(given, list | tuple) and any(map(_is_a_run, given)):
        rows = list(given)
    else:
        found = array(name, given, finite=False)
        if found.ndim not in (2, 3):
            raise ArgumentError(f"{name} has shape {found.shape}; (runs, times, {width}) is needed")
        rows = list(found) if found.ndim == 3 else [found]
    if not rows:
        raise ArgumentTypeError(f"{name} is {shown(given)}; one run, at least, is needed")
    return [array(f"{name}[{i}]", each, ("times", width), finite=False) for i, each in enumerate(rows)]


def _is_a_run(given: Any) -> bool:
    rows = numeric(given)
    return rows is not None and rows.ndim == 2


def _filled(rows: np.ndarray, length: int, value: float) -> np.ndarray:
    return np.concatenate([rows, np.full((length - len(rows), rows.shape[1]), value)])
