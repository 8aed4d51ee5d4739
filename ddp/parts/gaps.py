"""Passes of multiple shooting, problem by problem: none waits for another, nor goes on because of one."""

from typing import Any

import numpy as np

from ..results.status import Status

GAP_PASSES = 30  # then what gaps are left are closed by a rollout


def close_gaps(work: Any, limit: int) -> int:
    """Passes over the states in a workspace's `xs` and the controls in `us` until no gap is open; how many.

    A problem without gaps makes no more of them: what it comes to does not depend on others.
    """
    shooting, state = work._shooting, work._state
    lower, upper = (a[:, None].astype(work.numpy_dtype) for a in work.problem.limit_rows())
    work.us.assign(np.clip(work.us.numpy(), lower, upper))
    shooting.shoot()
    shooting.start()
    done = 0
    while _some_are_open(state) and done < min(limit, GAP_PASSES):
        work.differentiate()
        shooting.backward()
        if work.active():
            shooting.search()
        done += 1
    gap, ended = state.gap.numpy(), state.status.numpy()
    state.active.assign((ended == Status.RUNNING).astype(np.int32))
    start_again(work, (gap != 0.0) | (ended > 0))  # what is open is closed by a rollout under the policy
    return done


def _some_are_open(state: Any) -> bool:
    """Whether problems that go on have gaps; the others wait."""
    going = (state.active.numpy() == 1) & (state.gap.numpy() > 0.0)
    state.active.assign(going.astype(np.int32))
    return bool(going.any())


def start_again(work: Any, which: np.ndarray) -> None:
    """Roll these problems (B,) of a workspace out under their controls, and let them go on from there."""
    if not which.any():
        return
    state = work._state
    state.searching.assign(which.astype(np.int32))
    for array in (state.gap, work.k):
        values = array.numpy()
        values[which] = 0.0
        array.assign(values)
    work._run_first()
    work._passes.start(again=True)
