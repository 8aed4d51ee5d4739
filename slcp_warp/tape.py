"""Rollouts on a `wp.Tape`: the implicit adjoint of every step, attached by hand.

Gradients flow from the recorded states to x0, controls and parameters (`Parameters.track`). They are exact to
solver tolerance wherever the status is SOLVED; a world with another status gets NaN. Nothing flows through
impulses, gaps or the status.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import warp as wp

from slcp_warp.kernels.expansion import make_adjoint_kernel
from slcp_warp.kernels.launch import launch
from slcp_warp.kernels.parameter_gradient import offered
from slcp_warp.kernels.reduce import make_sum_kernel

from .options import OptionError


def active_tape() -> wp.Tape | None:
    """The tape that is recording, if any."""
    return getattr(wp._src.context.runtime, "tape", None)  # Warp 1.19 has no public way to ask


def wants_gradient(*arrays: wp.array | None) -> bool:
    """Whether a tape is recording and one of these requires a gradient."""
    return active_tape() is not None and any(a is not None and a.requires_grad for a in arrays)


def record(backward: Callable[[], None], inputs: Sequence[wp.array], output: wp.array) -> None:
    """Put a backward pass on the tape that is recording."""
    tape = active_tape()
    if tape is not None:
        tape.record_func(backward, arrays=[a for a in (*inputs, output) if a.requires_grad])


@dataclass(frozen=True)
class Recorded:
    """What the backward pass of a rollout needs: the kernels' key, the arrays that went in and came out."""

    key: tuple[Any, ...]
    table: wp.array
    x0: wp.array
    us: wp.array
    external: wp.array
    states: wp.array
    status: wp.array

    @property
    def inputs(self) -> list[wp.array]:
        """The arrays that may require a gradient."""
        return [self.x0, self.us, self.table]

    @property
    def wanted(self) -> bool:
        """Whether a tape records and an input requires a gradient.

        Raises:
            OptionError: gradients by parameters are wanted, and the options have none.
        """
        structure, _, method = self.key
        if wants_gradient(self.table) and not offered(structure, method):
            raise OptionError(
                "params are tracked, but gradients by parameters exist neither for springs between points, "
                f"nor for capsules, nor for every method; this is {method}"
            )
        return wants_gradient(*self.inputs)


def record_rollout(run: Recorded) -> None:
    """Record the backward pass of an open-loop rollout if a tape is active and an input requires a
    gradient.
    """
    if not run.wanted:
        return
    run.states.requires_grad = True

    def backward() -> None:
        adjoint(run, run.states.grad)
        run.states.grad.zero_()

    record(backward, run.inputs, run.states)


def record_step(run: Recorded) -> None:
    """Record the backward pass of one step, a rollout of length one: here x0, us and states of `run` are
    (B, nx), (B, nu) and (B, nx).
    """
    if not run.wanted:
        return
    x, u, after = run.x0, run.us, run.states
    after.requires_grad = True
    worlds, nx = x.shape
    states, states_grad = (wp.zeros((worlds, 2, nx), dtype=x.dtype, device=x.device) for _ in range(2))
    us = wp.zeros((worlds, 1, u.shape[1]), dtype=x.dtype, device=x.device, requires_grad=u.requires_grad)
    wp.copy(states[:, 0], x)
    wp.copy(us[:, 0], u)
    longer = replace(run, us=us, states=states)

    def backward() -> None:
        wp.copy(states_grad[:, 1], after.grad)
        adjoint(longer, states_grad)
        if u.requires_grad:
            launch(make_sum_kernel(x.dtype), u.shape[1], [us.grad[:, 0], u.grad], x.device)
            us.grad.zero_()
        after.grad.zero_()

    record(backward, run.inputs, after)


def refuse_policy(x0: wp.array) -> None:
    """A rollout under a policy has no recorded gradient: an error instead of a silent zero."""
    if active_tape() is not None and x0.requires_grad:
        raise ValueError(
            "x0 requires a gradient, but only open-loop rollouts (controls=...) are recorded on a tape"
        )


def adjoint(run: Recorded, states_grad: wp.array) -> None:
    """Add the gradients by x0, controls and parameters to theirs, where they are wanted."""
    x0, us, table = run.x0, run.us, run.table
    dtype, device = x0.dtype, x0.device
    x_grad = x0.grad if x0.requires_grad else wp.zeros((0, x0.shape[1]), dtype=dtype, device=device)
    u_grad = us.grad if us.requires_grad else wp.zeros((0, 1, 1), dtype=dtype, device=device)
    worlds = x0.shape[0] if table.requires_grad else 0
    part = wp.zeros((worlds, table.shape[1]), dtype=dtype, device=device)
    kernel = make_adjoint_kernel(*run.key, table.requires_grad)
    inputs = [table, us, run.external, run.states, run.status, states_grad, x_grad, u_grad, part]
    launch(kernel, x0.shape[0], inputs, device, grain=max(1, 64 // us.shape[1]))
    if table.requires_grad:
        launch(make_sum_kernel(dtype), table.shape[1], [part, table.grad], device)
