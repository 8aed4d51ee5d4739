"""Where passes start from when nobody says: zero controls, or a state held by multiple shooting."""

from typing import Any

import numpy as np

from ..batches import fill
from ..problem import Problem
from ..results.status import Status
from .gaps import close_gaps

GROWTH = 100.0  # of errors over a plan: a start from which a rollout is of little use


def no_controls(problem: Problem, batch: int) -> np.ndarray:
    """(B, N, nu) zeros, or the limits nearest to them."""
    lower, upper = (a[:, None] for a in problem.limit_rows())
    return np.clip(np.zeros((batch, problem.horizon, problem.nu)), lower, upper)


def held_states(work: Any, way: str) -> np.ndarray:
    """(B, N+1, nx) a workspace's first states ("hold"), or the goals ("goal"), at every step.

    A goal is the minimum of the final cost's expansion about the first state; a direction that no cost feels,
    or that it does not bend, stays.
    """
    x0 = work.x0.numpy().astype(np.float64)
    xs = np.repeat(x0[:, None], work.problem.horizon + 1, axis=1)
    if way == "goal":
        work.xs.assign(xs.astype(work.numpy_dtype))
        work._state.fresh.fill_(1)
        work._run_cost()
        d = work._derivatives
        slope, bend = (a.numpy()[:, -1].astype(np.float64) for a in (d.lx, d.lxx))
        value, basis = np.linalg.eigh(bend)
        felt = value > 1e-9 * np.maximum(value.max(1, keepdims=True), 1e-300)
        inverse = np.where(felt, 1.0 / np.where(felt, value, 1.0), 0.0)
        xs[:, 1:] -= np.einsum("bij,bj,bkj,bk->bi", basis, inverse, basis, slope)[:, None]
    return xs


def unstable(work: Any, x0: Any) -> np.ndarray:
    """(B,) whether errors about x0 under zero controls grow beyond `GROWTH` in as many steps as a plan has.

    The workspace is left with the rollout of zero controls.
    """
    zeros = no_controls(work.problem, work.batch)
    fill(work.x0, x0, "x0", (work.batch, work.problem.nx))
    fill(work.us, zeros, "us0", zeros.shape)
    for array in (work.xs, work.K, work.k):
        array.zero_()
    work._run_first()
    work._passes.start()
    work._run_linearize()
    failed = work.status.numpy() == Status.DYNAMICS_FAILED
    fx = work._derivatives.fx.numpy()[:, 0].astype(np.float64)
    good = ~failed & (work._derivatives.status.numpy()[:, 0] == 0) & np.isfinite(fx).all((1, 2))
    size = np.abs(np.linalg.eigvals(np.where(good[:, None, None], fx, 0.0))).max(1)
    return np.asarray(failed | (work.problem.horizon * np.log(np.maximum(size, 1e-300)) > np.log(GROWTH)))


def start_automatically(work: Any, limit: int) -> int:
    """Start from zero controls or, where the first state is unstable and it costs less, from that state held.

    Returns 0: the passes that closed gaps are no part of the solve, whose trace begins after them.
    """
    own = unstable(work, work.x0)
    if not own.any():
        return 0
    rolled = [a.numpy().copy() for a in (work.us, work.xs)]
    cost = work.cost.numpy().copy()
    work.xs.assign(held_states(work, "hold").astype(work.numpy_dtype))
    close_gaps(work, limit)
    failed = work.status.numpy() == Status.DYNAMICS_FAILED
    better = (own & (np.where(failed, np.inf, work.cost.numpy()) < cost))[:, None, None]
    work.us.assign(np.where(better, work.us.numpy(), rolled[0]))
    work.xs.assign(np.where(better, work.xs.numpy(), rolled[1]))
    work.K.assign(np.where(better[..., None], work.K.numpy(), 0.0).astype(work.numpy_dtype))
    work.k.zero_()
    work._run_first()
    work._passes.start()
    return 0
