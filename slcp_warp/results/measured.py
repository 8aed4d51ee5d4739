"""Measures of a run that is there, from what it recorded."""

from typing import Any

import numpy as np

from ..inputs import checks
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..measures.recorded import Recorded, of_worlds
from ..measures.reductions import Measure, Success
from ..measures.signals import OF_TENDONS, Signal
from ..options import Status
from .pictures.contacts import slips
from .worlds import pair_gap

RECORDED = ("controls", "impulse", "gap")


def measured(run: Any, what: Measure | Success) -> np.ndarray:
    """(B,) values of a measure, or whether worlds succeeded; see `Trajectory.measure`.

    Args:
        run: a Trajectory.
        what: the measure, or comparisons of measures.
    """
    if not isinstance(what, Measure | Success):
        raise ArgumentTypeError(
            f"what is {checks.shown(what)}; a measure of slcp_warp.measures, or comparisons, is needed"
        )
    solved = run.recorded("status") == Status.SOLVED
    worlds = _recorded(run, {signal.kind for signal in what.signals()}, solved)
    found = of_worlds(what, None if run._made is None else run._made[solved], worlds)
    out = np.full(len(solved), np.nan if isinstance(what, Measure) else False, found.dtype)
    out[solved] = found
    return out


def series(run: Any, signal: Signal) -> np.ndarray:
    """(B, N+1) values of a signal in every step; see `Trajectory.series`.

    Args:
        run: a Trajectory.
        signal: which.
    """
    signal = checks.instance("signal", signal, Signal, "a signal of slcp_warp.measures")
    solved = run.recorded("status") == Status.SOLVED
    worlds = _recorded(run, {each.kind for each in signal.parts()}, solved)
    out = np.full(run.recorded("states").shape[:2], np.nan)
    out[solved] = worlds.series(signal)
    return out


def _recorded(run: Any, kinds: set[str], solved: np.ndarray) -> Recorded:
    """What signals of these kinds are read from, of some of the worlds."""
    if run.kept is not None:
        raise ArgumentError("this trajectory has checkpoints only; a measure needs all states")
    seen = {name: None if getattr(run, name) is None else run.recorded(name) for name in RECORDED}
    seen["impulse"] = None if run.impulse is None else run._by_pair[..., 0]
    seen["gap"] = None if seen["gap"] is None else pair_gap(run.scene, seen["gap"])
    own = run._known().select(solved).parameters["step_size"]
    of = {name: None if array is None else array[solved] for name, array in seen.items()}
    if seen["impulse"] is not None:
        of["tangential"] = run._by_pair[solved][..., 1]
    if seen["impulse"] is not None and "slip" in kinds:
        found = np.zeros(run._by_pair[solved].shape[:-1])
        for slip, i in zip(found, np.flatnonzero(solved).tolist()):
            slip[:] = slips(run.motion(i), run._by_pair[i, ..., 0])
        of["slip"] = found
    if OF_TENDONS in kinds:
        of["pull"] = run._pulls(solved)
    return Recorded(run.scene, own, run.recorded("states")[solved], **of)
