"""What the worlds of a case are judged by: how fast the observed coordinate turns, and after a kick again."""

from typing import Any

import numpy as np

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
    spin = spin_statistics(samples, spec.sample_every, spec.window, spec.threshold, spec.kick_times)
    failed = found["status"] != Status.SOLVED
    spin["spinning"] = spin["spinning"] & ~failed
    spin["recovery_time"] = np.where(failed, np.inf, spin["recovery_time"])
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


def spin_statistics(
    samples: np.ndarray, interval: float, window: float, threshold: float, kicks: tuple[float, ...]
) -> dict[str, np.ndarray]:
    """Rates of one observed coordinate.

    Args:
        samples: (B, S) coordinate at times 0, interval, ...
        window: of a rate [s].
        threshold: of "spinning" [1/s].
        kicks: times of kicks [s]; time 0 counts as one (the perturbed start).

    Returns:
        Columns (B,): rate over the whole time; late_rate over its second half, or from the last kick on
        if that is later; spinning (late_rate above threshold); recovery_time after the last kick: first time
        from which the rate over the next window exceeds the threshold, inf if never.
    """
    count = samples.shape[1]
    total = (count - 1) * interval
    last = max((0.0, *kicks))
    half = max(count // 2, round(last / interval))
    span = max(1, min(count - 1, round(window / interval)))
    moving = (samples[:, span:] - samples[:, :-span]) / (span * interval)
    begin = min(round(last / interval), moving.shape[1] - 1)
    after = moving[:, begin:] > threshold
    first = np.argmax(after, axis=1)
    return {
        "rate": (samples[:, -1] - samples[:, 0]) / total,
        "late_rate": (samples[:, -1] - samples[:, half]) / ((count - 1 - half) * interval),
        "spinning": (samples[:, -1] - samples[:, half]) / ((count - 1 - half) * interval) > threshold,
        "recovery_time": np.where(after.any(axis=1), first * interval, np.inf),
    }
