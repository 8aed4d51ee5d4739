"""What the worlds of a case are judged by: how fast the observed coordinate turns, and after a kick again."""

from typing import Any

import numpy as np

from ..measures import Measure, rate
from ..options import Status
from .spec import SweepSpec
from .statistics.intervals import mean_interval, quantile_interval, share_interval

NOWHERE = 1e30  # lowest gap of a world without an acting contact


def table_of(
    residual: str, step_size: float, found: dict[str, np.ndarray], spec: SweepSpec
) -> dict[str, np.ndarray]:
    """Tidy columns, one row a world, of what a case found: records, measures by name, status, what was drawn.

    A world that was not solved neither spins nor recovers.
    """
    columns, count = dict(found), len(found["status"])
    samples = columns.pop("records")
    contacts = {
        "contact_share": columns.pop("contact_share").astype(np.float32),
        "lowest_gap": np.minimum(columns.pop("lowest_gap"), NOWHERE).astype(np.float32),
    }
    failed = found["status"] != Status.SOLVED
    recovery = recovery_times(samples, spec.sample_every, spec.window, spec.threshold, spec.kick_times)
    names = "rate", "late_rate"
    spin: dict[str, np.ndarray] = {name: columns.pop(name).astype(np.float32) for name in names}
    spin["spinning"] = spin["late_rate"] > spec.threshold
    spin["spinning"] = spin["spinning"] & ~failed
    spin["recovery_time"] = np.where(failed, np.inf, recovery)
    head = {
        "residual": np.full(count, residual),
        "step_size": np.full(count, step_size),
        "world": np.arange(count),
    }
    return head | contacts | columns | spin


def summary_of(
    residual: str, step_size: float, table: dict[str, np.ndarray], spec: SweepSpec, seconds: float
) -> dict[str, Any]:
    """Counts, statuses and (value, low, high) with 95 % intervals of a case's table."""
    worlds = len(table["status"])
    above = (table["rate"] > spec.threshold) & (table["status"] == Status.SOLVED)
    recovered = np.isfinite(table["recovery_time"])
    return {
        "residual": residual,
        "step_size": step_size,
        "worlds": worlds,
        "seconds": seconds,
        "mean_rate": mean_interval(table["rate"]),
        "share_above": share_interval(int(above.sum()), worlds),
        "share_spinning": share_interval(int(table["spinning"].sum()), worlds),
        "share_recovered": share_interval(int(recovered.sum()), worlds),
        "median_recovery_time": quantile_interval(table["recovery_time"]),
        "contact_share": mean_interval(table["contact_share"]),
        "statuses": {s.name: int((table["status"] == s).sum()) for s in Status},
    }


def spin_measures(spec: SweepSpec) -> dict[str, Measure]:
    """The rate of the observed coordinate over the run, and over its second half, or from the last kick on if
    that is later; both from a sample of it on.
    """
    half = (round(spec.duration / spec.sample_every) + 1) // 2
    late = max(half, round(max((0.0, *spec.kick_times)) / spec.sample_every)) * spec.sample_every
    return {"rate": rate(spec.observe), "late_rate": rate(spec.observe, start=late)}


def recovery_times(
    samples: np.ndarray, interval: float, window: float, threshold: float, kicks: tuple[float, ...]
) -> np.ndarray:
    """Times (B,) after the last kick from which the rate over the next window exceeds the threshold.

    Args:
        samples: (B, S) of the observed coordinate at times 0, interval, ...
        window: of a rate [s].
        threshold: of a rate [1/s].
        kicks: times of kicks [s]; time 0 counts as one (the perturbed start).

    Returns:
        [s], infinite: never.
    """
    last, count = max((0.0, *kicks)), samples.shape[1]
    span = max(1, min(count - 1, round(window / interval)))
    moving = (samples[:, span:] - samples[:, :-span]) / (span * interval)
    begin = min(round(last / interval), moving.shape[1] - 1)
    after = moving[:, begin:] > threshold
    return np.where(after.any(axis=1), np.argmax(after, axis=1) * interval, np.inf)
