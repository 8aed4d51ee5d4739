"""Solving optimal control problems by DDP: one call, for a batch or for one."""

from typing import Any

from slcp_warp.inputs.errors import ArgumentTypeError

from .batches import batch_of
from .continuation import solve_continuation
from .options import Options
from .problem import Problem
from .results.result import Result
from .workspace import Workspace


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

    Args:
        problem: what to minimise.
        x0: initial states (B, nx) or (nx,).
        u0: initial controls (B, N, nu) or (N, nu); None: zeros or what ``options.start`` makes.
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
    if options.sigma_schedule is not None:
        return solve_continuation(problem, x0, u0, options.sigma_schedule, options, xs0=xs0, K0=K0, k0=k0)[-1]
    single, batch = batch_of(problem, x0, u0)
    result = Workspace(problem, batch, options).solve(x0, u0, xs0, K0, k0)
    return result.select(0) if single else result
