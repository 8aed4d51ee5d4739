"""Open-loop rollouts and their adjoints on arrays that another library made: what its operators call.

Nothing is recorded: a library that differentiates asks for the backward pass itself.
"""

from collections.abc import Sequence

import warp as wp

from slcp_warp.kernels.device.tables import copy_rows, empty_table, laid_out

from .checkpoint import Segments, checkpointed, pull_back
from .tape import Differentiable, Recorded, adjoint


def bounds_of(steps: int, every: int) -> Sequence[int]:
    """The steps whose states are kept: every `every`-th and the last; of every = 0 the ends of the rollout,
    all of whose states are.
    """
    return (*range(0, steps, every), steps) if every else (0, steps)


def roll_out(
    kernels: Differentiable,
    rows: wp.array,
    x0: wp.array,
    us: wp.array,
    force: wp.array,
    status: wp.array,
    every: int = 0,
    states: wp.array | None = None,
) -> wp.array:
    """States (B, N+1, nx) of a rollout, or every `every`-th of them, (B, S+1, nx).

    Args:
        kernels: that step.
        rows: the table of parameters, (1 or B, P), row by row.
        x0: (B, nx).
        us: (B, N, nu).
        force: (0 or B, 3 bodies), external force.
        status: (B,), zeros; filled.
        states: (B, N+1, nx), zeros, where all of them come; None: some come in an array of their own.
    """
    numbers = laid_out(rows)
    if states is None:
        return checkpointed(kernels, numbers, x0, us, force, status, every)
    return Segments(kernels, numbers, us, force, bounds_of(us.shape[1], 0), states).run(0, x0, status)


def pull(
    kernels: Differentiable,
    rows: wp.array,
    x0: wp.array,
    us: wp.array,
    force: wp.array,
    states: wp.array,
    status: wp.array,
    by_states: wp.array,
    every: int = 0,
) -> None:
    """Add the gradients to those of x0, us and rows, where these require one.

    Args:
        kernels, rows, x0, us, force, every: of the rollout.
        states, status: of it.
        by_states: the gradient by them.
    """
    numbers = laid_out(rows)
    apart = numbers is not rows and rows.requires_grad
    if apart:
        numbers.grad = empty_table(rows.shape, rows.dtype, rows.device)
        numbers.requires_grad = True
    run = Recorded(kernels, numbers, x0, us, force, states, status)
    if every:
        worlds, steps, nx = len(x0), us.shape[1], x0.shape[1]
        room = wp.zeros((worlds, min(every, steps) + 1, nx), dtype=x0.dtype, device=x0.device)
        states.grad = wp.clone(by_states)
        pull_back(run, Segments(kernels, numbers, us, force, bounds_of(steps, every), room))
    else:
        adjoint(run, by_states)
    if apart:
        copy_rows(numbers.grad, rows.grad)
