"""Solving at a decreasing list of noise levels, each from the policy of the one before (section VI)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from slcp_warp.inputs.checks import instance, numeric, shown
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError

from .batches import batch_of
from .options import Options
from .problem import Problem
from .results.result import Result
from .workspace import Workspace


def solve_continuation(
    problem: Problem,
    x0: Any,
    u0: Any,
    sigmas: Sequence[float],
    options: Options | None = None,
    *,
    parameter: str = "sigma",
    xs0: Any = None,
    K0: Any = None,
    k0: Any = None,
) -> list[Result]:
    """Solve with ``parameter`` at each of ``sigmas``, each from the policy before, rolled out with feedback.

    A problem whose warm start fails at the next level (non-finite, or a step not solved) is started again
    open loop from the last controls. A batch of one may leave out the batch axis.

    Args:
        problem, x0, u0, options, xs0, K0, k0: as for `solve`.
        sigmas: values of the parameter, one level after the other.
        parameter: name of a parameter of the dynamics.

    Returns:
        One result per level; the last one is the answer.
    """
    instance("problem", problem, Problem, "a ddp.Problem")
    instance("options", options, Options | None, "a ddp.Options")
    levels = numeric(sigmas)
    if levels is None or levels.ndim != 1 or not levels.size:
        raise ArgumentError(f"sigmas must hold at least one value, all numbers; got {shown(sigmas)}")
    if not isinstance(parameter, str):
        raise ArgumentTypeError(f"parameter is {shown(parameter)}; the name of a parameter is needed")
    options = replace(options or Options(), sigma_schedule=None)
    single, batch = batch_of(problem, x0, u0)
    results: list[Result] = []
    workspace = None
    for sigma in levels:
        level = problem.with_params(**{parameter: sigma})
        if workspace is None:
            workspace = Workspace(level, batch, options)
            result = workspace.solve(x0, u0, xs0, K0, k0)
        else:
            workspace.set_params(level.params)
            last = results[-1]
            result = workspace.solve(x0, last.us, last.xs, last.K)
            if not np.isfinite(result.cost).all():
                gains = np.where(np.isfinite(result.cost)[:, None, None, None], last.K, 0.0)
                result = workspace.solve(x0, last.us, last.xs, gains)
        results.append(replace(result, simulated=level.simulated()))
    return [r.select(0) for r in results] if single else results
