"""Rollouts on a `wp.Tape`: the implicit adjoint of every step, attached by hand.

Gradients flow from the recorded states to x0 and controls. They are exact to solver tolerance wherever the
status is SOLVED; a world with another status gets NaN. Nothing flows through impulses, gaps or the status.
"""

from typing import Any

import warp as wp

from slcp_warp.kernels.expansion import make_adjoint_kernel
from slcp_warp.kernels.launch import launch


def active_tape() -> wp.Tape | None:
    """The tape that is recording, if any."""
    return getattr(wp._src.context.runtime, "tape", None)  # Warp 1.19 has no public way to ask


def wants_gradient(*arrays: wp.array | None) -> bool:
    """Whether a tape is recording and one of these requires a gradient."""
    return active_tape() is not None and any(a is not None and a.requires_grad for a in arrays)


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
    """Record the backward pass of an open-loop rollout if a tape is active and an input requires a
    gradient.
    """
    tape = active_tape()
    if tape is None or not (x0.requires_grad or us.requires_grad):
        return
    states.requires_grad = True

    def backward() -> None:
        _adjoint(key, table, x0, us, external, states, status, states.grad, device)
        states.grad.zero_()

    tape.record_func(backward, arrays=_with_gradient(x0, us, states))


def record_step(
    key: tuple[Any, ...],
    table: wp.array,
    x: wp.array,
    u: wp.array,
    external: wp.array,
    after: wp.array,
    status: wp.array,
    device: Any,
) -> None:
    """Record the backward pass of one step from x (B, nx) under u (B, nu) to `after`: a rollout of length
    one.
    """
    tape = active_tape()
    if tape is None or not (x.requires_grad or u.requires_grad):
        return
    after.requires_grad = True
    worlds, nx = x.shape
    states, states_grad = (wp.zeros((worlds, 2, nx), dtype=x.dtype, device=device) for _ in range(2))
    us = wp.zeros((worlds, 1, u.shape[1]), dtype=x.dtype, device=device, requires_grad=u.requires_grad)
    wp.copy(states[:, 0], x)
    wp.copy(us[:, 0], u)

    def backward() -> None:
        wp.copy(states_grad[:, 1], after.grad)
        _adjoint(key, table, x, us, external, states, status, states_grad, device)
        if u.requires_grad:
            add = us.grad.numpy()[:, 0] + u.grad.numpy()
            u.grad.assign(add)
            us.grad.zero_()
        after.grad.zero_()

    tape.record_func(backward, arrays=_with_gradient(x, u, after))


def refuse_policy(x0: wp.array) -> None:
    """A rollout under a policy has no recorded gradient: an error instead of a silent zero."""
    if active_tape() is not None and x0.requires_grad:
        raise ValueError(
            "x0 requires a gradient, but only open-loop rollouts (controls=...) are recorded on a tape"
        )


def _with_gradient(*arrays: wp.array) -> list[wp.array]:
    return [a for a in arrays if a.requires_grad]


def _adjoint(
    key: tuple[Any, ...],
    table: wp.array,
    x0: wp.array,
    us: wp.array,
    external: wp.array,
    states: wp.array,
    status: wp.array,
    states_grad: wp.array,
    device: Any,
) -> None:
    """Add the gradients by x0 and controls to theirs, where they are wanted."""
    x_grad = x0.grad if x0.requires_grad else wp.zeros((0, x0.shape[1]), dtype=x0.dtype, device=device)
    u_grad = us.grad if us.requires_grad else wp.zeros((0, 1, 1), dtype=x0.dtype, device=device)
    inputs = [table, us, external, states, status, states_grad, x_grad, u_grad]
    launch(make_adjoint_kernel(*key), x0.shape[0], inputs, device, grain=max(1, 64 // us.shape[1]))
