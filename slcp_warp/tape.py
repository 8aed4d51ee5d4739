"""Rollouts on a `wp.Tape`: the implicit adjoint of every step, attached by hand.

Gradients flow from the recorded states to x0 and controls. They are exact to solver tolerance wherever the status is
SOLVED; a world with another status gets NaN. Nothing flows through impulses, gaps or the status.
"""

from typing import Any

import warp as wp

from slcp_warp.kernels.expansion import make_adjoint_kernel
from slcp_warp.kernels.launch import launch


def active_tape() -> wp.Tape | None:
    """The tape that is recording, if any."""
    return wp._src.context.runtime.tape


def record_rollout(
    key: tuple[Any, ...],
    table: wp.array,
    x0: wp.array,
    us: wp.array,
    external: wp.array,
    states: wp.array,
    status: wp.array,
    device: Any,
) -> None:
    """Record the backward pass of an open-loop rollout if a tape is active and an input requires a gradient."""
    tape = active_tape()
    if tape is None or not (x0.requires_grad or us.requires_grad):
        return
    states.requires_grad = True
    empty_x = wp.zeros((0, x0.shape[1]), dtype=x0.dtype, device=device)
    empty_u = wp.zeros((0, 1, 1), dtype=x0.dtype, device=device)

    def backward() -> None:
        x_grad = x0.grad if x0.requires_grad else empty_x
        u_grad = us.grad if us.requires_grad else empty_u
        inputs = [table, us, external, states, status, states.grad, x_grad, u_grad]
        launch(make_adjoint_kernel(*key), x0.shape[0], inputs, device, grain=max(1, 64 // us.shape[1]))
        states.grad.zero_()

    tape.record_func(backward, arrays=[x0, us, states])
