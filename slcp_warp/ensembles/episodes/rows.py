"""Rows of worlds that begin anew, beside others that go on."""

from typing import Any

import numpy as np
import warp as wp

from ...simulator import Simulator
from ..by_periods import Running, cold, progress
from ..launch import nothing_noted
from ..worlds import Worlds


def put_rows(into: wp.array, rows: np.ndarray, values: wp.array | None) -> None:
    """The rows (n,) of an array become those of `values` (n, ...); None: zeros."""
    if not into.size or not len(rows):
        return
    if wp.get_device(into.device).is_cpu:
        into.numpy()[rows] = 0 if values is None else values.numpy()
    else:
        scatter(into, rows, values)


def scatter(into: Any, rows: np.ndarray, values: wp.array | None) -> None:
    """`put_rows` by a copy on the arrays' device."""
    if values is None:
        values = wp.zeros((len(rows), *into.shape[1:]), dtype=into.dtype, device=into.device)
    places: wp.array = wp.array(rows, dtype=wp.int32, device=into.device)
    which: list[Any] = [places, *[None] * (into.ndim - 1)]
    own: Any = wp.indexedarray(into, which)
    wp.copy(own, values)


def begin_anew(
    sim: Simulator,
    conditions: Any,
    running: Running,
    worlds: Worlds,
    noted: wp.array,
    rows: np.ndarray,
    fresh: Worlds,
) -> None:
    """Worlds of some rows (n,) are others from here on, and stand at their first step.

    Args:
        sim: whose steps they make.
        conditions: what all worlds go through.
        running: all worlds (B,), and what they carry over.
        worlds: their numbers, on the simulator's device.
        noted: (B, NOTED).
        rows: of those that begin.
        fresh: what they are, (n,).
    """
    for name in ("x0", "params", "kicks", "pushes", "dropouts", "timing", "numbers"):
        own = getattr(worlds, name)
        if own is not None:
            put_rows(own, rows, getattr(fresh, name))
    span = running.span
    begun = progress(conditions, fresh.params, span.p.records)
    put_rows(span.p.steps, rows, begun.steps)
    put_rows(span.state, rows, fresh.x0)
    put_rows(span.warm, rows, cold(sim, len(rows)))
    put_rows(noted, rows, nothing_noted(sim, len(rows)))
    for each in (span.memory, span.p.record, span.p.event, span.p.status, running.next, running.kept):
        put_rows(each, rows, None)
