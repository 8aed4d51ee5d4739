"""Rollouts on a `wp.Tape`: the implicit adjoint of every step, attached by hand.

Gradients flow from the recorded states and controls to x0, controls, parameters (`Parameters.track`) and the
nominal states, controls and gains of a tracking policy (none where its control is at a limit). They are
exact to solver tolerance wherever the status is SOLVED; a world with another status gets NaN, or 0 if the
loss depends on no state of it. Nothing flows through impulses and gaps: a loss of them is refused.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.device.reduce import add_rows
from slcp_warp.kernels.device.tables import copy_rows, empty_table
from slcp_warp.kernels.gradients.adjoint import make_control_kernel
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.policies.tracking import TRACKING
from slcp_warp.kernels.specialisation import Specialisation

from ..inputs.errors import ArgumentError
from ..options import OptionError
from .refused import Refused


def active_tape() -> wp.Tape | None:
    """The tape that is recording, if any."""
    return getattr(wp._src.context.runtime, "tape", None)  # Warp 1.19 has no public way to ask


def wants_gradient(*arrays: wp.array | None) -> bool:
    """Whether a tape is recording and one of these requires a gradient."""
    return active_tape() is not None and any(a is not None and a.requires_grad for a in arrays)


def record(backward: Callable[[], None], inputs: Sequence[wp.array], *outputs: wp.array) -> None:
    """Put a backward pass on the tape that is recording."""
    tape = active_tape()
    if tape is not None:
        tape.record_func(backward, arrays=[a for a in (*inputs, *outputs) if a.requires_grad])


def derivatives_exist(method: Method) -> None:
    """An OptionError where a step has no derivatives at all."""
    if method.end_gap:
        raise OptionError("Options.gap is 'end', which has no derivatives; use gap='start'")


class Differentiable(Protocol):
    """Kernels whose rollouts have an adjoint."""

    spec: Specialisation

    def roll_out(
        self,
        table: wp.array,
        x0: wp.array,
        us: wp.array,
        external: wp.array,
        states: wp.array,
        status: wp.array,
    ) -> None:
        """Fill states (B, N+1, nx) and status (B,) of open-loop rollouts under us (B, N, nu)."""

    def pull_back(self, run: "Recorded", states_grad: wp.array, found: "Found") -> None:
        """Add the gradients of every world's own."""


@dataclass(frozen=True)
class Found:
    """Where an adjoint adds the gradients of every world's own: arrays of no worlds where none is wanted.

    Attributes:
        x0: (B, nx).
        us: (B, N, nu), by a policy's (B, N', nu).
        xs: (B, >= N', nx), gain: (B, N', nu, nx), of a tracking policy.
        table: (B, P).
    """

    x0: wp.array
    us: wp.array
    xs: wp.array
    gain: wp.array
    table: wp.array


@dataclass(frozen=True)
class Recorded:
    """What the backward pass of a rollout needs: the kernels, the arrays that went in and came out.

    Attributes:
        us: controls as they were applied.
        policy: the struct of the tracking policy that made them, if one did.
        controls: those that the caller got, if any: a loss may contain them.
        blocked: other outputs by name, of which no loss may depend.
    """

    kernels: Differentiable
    table: wp.array
    x0: wp.array
    us: wp.array
    external: wp.array
    states: wp.array
    status: wp.array
    policy: Any = None
    controls: wp.array | None = None
    blocked: tuple[tuple[str, wp.array], ...] = ()

    @property
    def inputs(self) -> list[wp.array]:
        """The arrays that may require a gradient."""
        if self.policy is None:
            return [self.x0, self.us, self.table]
        return [self.x0, self.policy.us, self.policy.xs, self.policy.gain, self.table]

    @property
    def wanted(self) -> bool:
        """Whether a tape records and an input requires a gradient.

        Raises:
            OptionError: gradients are wanted that the options do not have.
        """
        wanted = wants_gradient(*self.inputs)
        if wanted:
            derivatives_exist(self.kernels.spec.method)
        return wanted


def record_rollout(run: Recorded) -> None:
    """Record the backward pass of a rollout if a tape is active and an input requires a gradient."""
    if not run.wanted:
        return
    outputs = [run.states] if run.controls is None else [run.states, run.controls]
    refused = _refused(run)
    for array in outputs:
        array.requires_grad = True

    def backward() -> None:
        refused.spoil(run.states.grad[:, -1])
        adjoint(run, run.states.grad)
        for array in outputs:
            array.grad.zero_()

    record(backward, run.inputs, *outputs, *refused.arrays)


def _refused(run: Recorded) -> Refused:
    """The outputs of which no loss may depend."""
    tape = active_tape()
    assert tape is not None
    return Refused(tape, dict(run.blocked), run.x0.device)


def record_step(run: Recorded) -> None:
    """Record the backward pass of one step, a rollout of length one: here x0, us and states of `run` are
    (B, nx), (B, nu) and (B, nx).
    """
    if not run.wanted:
        return
    x, u, after = run.x0, run.us, run.states
    after.requires_grad = True
    refused = _refused(run)
    worlds, nx = x.shape
    us = wp.empty(u.shape, dtype=u.dtype, device=u.device)
    copy_rows(u, us)
    states, states_grad = (wp.zeros((worlds, 2, nx), dtype=x.dtype, device=x.device) for _ in range(2))
    copy_rows(x, states[:, 0])
    copy_rows(after, states[:, 1])
    us = us.reshape((worlds, 1, u.shape[1]))
    us.requires_grad = u.requires_grad
    longer = replace(run, us=us, states=states)

    def backward() -> None:
        copy_rows(after.grad, states_grad[:, 1])
        refused.spoil(states_grad[:, 1])
        adjoint(longer, states_grad)
        if u.requires_grad:
            add_rows(us.grad[:, 0], u.grad)
            us.grad.zero_()
        after.grad.zero_()

    record(backward, run.inputs, after, *refused.arrays)


def refuse(name: str, why: str, *arrays: wp.array | None) -> None:
    """A gradient that does not exist is wanted: an error instead of a silent zero."""
    if wants_gradient(*arrays):
        raise ArgumentError(f"{name} requires a gradient on the wp.Tape that records, but {why}")


def differentiable_policy(policy: PolicyKernel, struct: Any, x0: wp.array, table: wp.array) -> bool:
    """Whether a rollout under a policy is to be recorded.

    Raises:
        ValueError: a gradient is wanted through a policy that has none; better than a silent zero.
    """
    arrays = (struct.us, struct.xs, struct.gain) if policy == TRACKING else ()
    if not wants_gradient(x0, table, *arrays):
        return False
    if policy != TRACKING:
        raise ArgumentError(
            f"a gradient is wanted through a rollout under a {policy.in_words!r} policy; only open-loop "
            "rollouts and those under a ddp.TrackingPolicy are recorded on a tape"
        )
    return True


def adjoint(run: Recorded, states_grad: wp.array) -> None:
    """Add the gradients by x0, controls or policy, and parameters to theirs, where they are wanted."""
    x0, us, table, policy = run.x0, run.us, run.table, run.policy
    dtype, device, worlds = run.kernels.spec.dtype, x0.device, x0.shape[0]

    def part(like: wp.array | None) -> wp.array:
        """A gradient of every world's own, to be summed if the worlds share what it is by."""
        if like is None or not like.requires_grad:
            return wp.zeros((0,) * (1 if like is None else like.ndim), dtype=dtype, device=device)
        return wp.zeros((worlds, *like.shape[1:]), dtype=dtype, device=device)

    x_grad = x0.grad if x0.requires_grad else wp.zeros((0, 0), dtype=dtype, device=device)
    shape = (worlds if table.requires_grad else 0, table.shape[1])
    by_table = empty_table(shape, dtype, device)
    sums = []
    if policy is None:
        by_us = us.grad if us.requires_grad else wp.zeros((0, 0, 0), dtype=dtype, device=device)
        by_xs = wp.zeros((0, 0, 0), dtype=dtype, device=device)
        by_gain = wp.zeros((0, 0, 0, 0), dtype=dtype, device=device)
    else:
        by_us, by_xs, by_gain = part(policy.us), part(policy.xs), part(policy.gain)
        sums = [(by_us, policy.us), (by_xs, policy.xs), (by_gain, policy.gain)]
    if run.controls is not None:
        _by_controls(run, states_grad, by_us, by_xs, by_gain)
    run.kernels.pull_back(run, states_grad, Found(x_grad, by_us, by_xs, by_gain, by_table))
    for each, target in [*sums, (by_table, table)]:
        if target.requires_grad:
            add_rows(*(a if a.ndim == 2 else a.reshape((a.shape[0], -1)) for a in (each, target.grad)))


def _by_controls(
    run: Recorded, states_grad: wp.array, by_us: wp.array, by_xs: wp.array, by_gain: wp.array
) -> None:
    """Carry the gradient by recorded controls to the states and to what made the controls."""
    assert run.controls is not None
    grad, (structure, dtype, _) = run.controls.grad, run.kernels.spec
    worlds, steps, nu = grad.shape
    if run.policy is not None:
        kernel = make_control_kernel(run.x0.shape[1], structure.nu, dtype)
        inputs = [run.policy, run.us, run.states, grad, states_grad, by_us, by_xs, by_gain]
        launch(kernel, worlds, inputs, run.x0.device, grain=max(1, 4096 // steps))
    elif run.us.requires_grad:
        add_rows(*(array.reshape((worlds, steps * nu)) for array in (grad, by_us)))
