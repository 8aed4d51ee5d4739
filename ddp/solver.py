"""Solving optimal control problems by DDP: one call, for a batch or for one."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError

from .batches import batch_of
from .continuation import solve_continuation
from .options import Options, Regularization
from .problem import Problem
from .results.result import Result
from .results.status import Status
from .results.trace import Trace
from .sampling.options import Sampling
from .sampling.sampler import Sampler
from .workspace import Workspace

FELT = 1e-3  # of a cost: what gains less has felt next to nothing
STUCK = (Status.SMALL_IMPROVEMENT, Status.LINE_SEARCH_FAILED, Status.REGULARIZATION_LIMIT)
OF_CONTROLS = Regularization(initial=1.0, factor=1.6, state_weight=0.0, control_weight=1.0)  # as of `plan`
WIDER = (1.0, 4.0)  # deviations of sampled controls, in those of `Sampling`


def solve(
    problem: Problem,
    x0: Any,
    u0: Any = None,
    options: Options | None = None,
    *,
    xs0: Any = None,
    K0: Any = None,
    k0: Any = None,
) -> Result:
    """Solve a batch of problems, or one where the batch axis is left out.

    One descent from one start: it ends at what lies below that. `plan` tries many starts and two schedules.

    Where nobody says what to start from, and next to nothing can be felt from where `Options.start`
    "automatic" leads (`Status.FLAT`, or an end for want of improvement within a thousandth of the first
    cost), the problem is solved again from the best of sampled controls (`sample`), if they cost less. Where
    nobody says how to regularise, and the default ends at its limit (controls that hardly move the state, as
    of a grip that is squeezed), passes go on from there with the control regularised.

    Args:
        problem: what to minimise.
        x0: initial states (B, nx) or (nx,).
        u0: initial controls (B, N, nu) or (N, nu); None: zeros or what ``options.start`` makes. Or a
            `Result`, of any cost and numbers, to go on from with its feedback.
        options: see `Options`; with ``sigma_schedule`` this is `solve_continuation`.
        xs0: states of a policy to start from, with ``K0``; alone, states of multiple shooting (see
            `Workspace.run`).
        K0: its gains.
        k0: its open-loop step.
    """
    options = Options() if options is None else options
    if not isinstance(problem, Problem) or not isinstance(options, Options):
        raise ArgumentTypeError(
            f"problem and options are a {type(problem).__name__} and a {type(options).__name__}; "
            "a ddp.Problem and a ddp.Options are needed"
        )
    if isinstance(u0, Result):
        if xs0 is not None or K0 is not None:
            raise ArgumentError(
                "u0 is a ddp.Result, which has states and gains of its own: leave out xs0, K0"
            )
        u0, xs0, K0 = u0.us, u0.xs, u0.K
    if options.sigma_schedule is not None:
        return solve_continuation(problem, x0, u0, options.sigma_schedule, options, xs0=xs0, K0=K0, k0=k0)[-1]
    single, batch = batch_of(problem, x0, u0)
    work = Workspace(problem, batch, options)
    result = work.solve(x0, u0, xs0, K0, k0)
    if u0 is None and xs0 is None and options.start == "automatic":
        result = _felt(work, x0, result)
    if np.array_equal(options.regularization.rows(), Regularization().rows()):
        result = _stuck(work, x0, result)
    return result.select(0) if single else result


def _stuck(work: Workspace, x0: Any, result: Result) -> Result:
    """The result; of problems whose regularisation reached its limit from passes that go on from there with
    the control regularised, if they keep the limits of states alone or cost less.
    """
    stuck = result.status == Status.REGULARIZATION_LIMIT
    if not stuck.any():
        return result
    again = Workspace(work.problem, work.batch, replace(work.options, regularization=OF_CONTROLS))
    found = again.solve(x0, result.us)
    kept, before = (each.keeps_limits(work.options.limit_tolerance) for each in (found, result))
    better = (kept > before) | (kept == before) & (found.cost < result.cost)
    return _either(stuck & better, found, result)


def _felt(work: Workspace, x0: Any, result: Result) -> Result:
    """The result; of problems that felt next to nothing from sampled controls, where these cost less."""
    first = result.trace.cost[:, 0]
    still = np.isfinite(first) & (first - result.cost <= FELT * np.abs(first))
    flat = (result.status == Status.FLAT) | (still & np.isin(result.status, STUCK))
    if not flat.any():
        return result
    us, cost = result.us.copy(), result.cost.copy()
    for wider in WIDER:
        sampler = Sampler(work.problem, work.batch, Sampling(), wider)
        sampler.run(x0)
        lower = flat & (sampler.cost.numpy() < cost - FELT * np.abs(cost))
        us[lower], cost[lower] = sampler.us.numpy()[lower], sampler.cost.numpy()[lower]
    own = cost < result.cost
    return _either(own, work.solve(x0, us), result) if own.any() else result


def _either(own: np.ndarray, first: Result, second: Result) -> Result:
    """Results of the first where it says so (B,), else of the second; traces as long as the longer one."""

    def chosen(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.where(own.reshape(-1, *[1] * (a.ndim - 1)), a, b)

    def longer(a: np.ndarray, passes: int) -> np.ndarray:
        return np.pad(a, ((0, 0), (0, passes - a.shape[1])), constant_values=np.nan)

    passes = max(each.trace.cost.shape[1] for each in (first, second))
    history = {
        f.name: chosen(*(longer(getattr(each.trace, f.name), passes) for each in (first, second)))
        for f in fields(Trace)
    }
    arrays: dict[str, Any] = {
        f.name: chosen(getattr(first, f.name), getattr(second, f.name))
        for f in fields(Result)
        if isinstance(getattr(first, f.name), np.ndarray)
    }
    return replace(second, **arrays, trace=Trace(**history))
