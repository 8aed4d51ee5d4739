"""Rollouts that keep every k-th state only and recompute the others on the way back (checkpointing).

N steps need N/k + k states at a time instead of N, and one more forward pass in the backward one. With k near
the square root of N both parts are smallest.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import warp as wp

from slcp_warp.kernels.device.tables import copy_rows

from .tape import Differentiable, Recorded, adjoint, record


@dataclass(frozen=True)
class Segments:
    """The parts of an open-loop rollout between two kept states.

    Attributes:
        kernels, table, us, external: see `Recorded`.
        bounds: steps at which states are kept, 0 and N among them.
        states: (B, longest segment + 1, nx), room for one segment.
    """

    kernels: Differentiable
    table: wp.array
    us: wp.array
    external: wp.array
    bounds: Sequence[int]
    states: wp.array

    def controls(self, i: int) -> wp.array:
        """Controls of segment i, (B, L, nu), with their gradient."""
        if self.us.shape[2] == 0:  # Warp has no slices of arrays without entries
            steps = self.bounds[i + 1] - self.bounds[i]
            return wp.zeros((self.us.shape[0], steps, 0), dtype=self.us.dtype, device=self.us.device)
        return self.us[:, self.bounds[i] : self.bounds[i + 1]]

    def run(self, i: int, start: wp.array, status: wp.array) -> wp.array:
        """Roll segment i out from start (B, nx); its states (B, L+1, nx), in the room there is."""
        if start.shape[0] == 0:
            return self.states
        states = self.states[:, : self.bounds[i + 1] - self.bounds[i] + 1]
        self.kernels.roll_out(self.table, start, self.controls(i), self.external, states, status)
        return states


def checkpointed(
    kernels: Differentiable,
    table: wp.array,
    x0: wp.array,
    us: wp.array,
    external: wp.array,
    status: wp.array,
    every: int,
) -> wp.array:
    """Roll out and keep the states of steps 0, every, 2 every, ..., N: (B, S+1, nx).

    Recorded on an active tape if an input requires a gradient, as an ordinary rollout is.
    """
    worlds, steps, nx = us.shape[0], us.shape[1], x0.shape[1]
    bounds = [*range(0, steps, every), steps]
    longest = min(every, steps)

    def empty(*shape: int, requires_grad: bool = False) -> wp.array:
        return wp.zeros(shape, dtype=x0.dtype, device=x0.device, requires_grad=requires_grad)

    segments = Segments(kernels, table, us, external, bounds, empty(worlds, longest + 1, nx))
    kept = empty(worlds, len(bounds), nx)
    if worlds == 0:
        return kept
    copy_rows(x0, kept[:, 0])
    for i in range(len(bounds) - 1):
        states = segments.run(i, kept[:, i], status)
        copy_rows(states[:, bounds[i + 1] - bounds[i]], kept[:, i + 1])
    run = Recorded(kernels, table, x0, us, external, kept, status)
    if run.wanted:
        kept.requires_grad = True
        record(lambda: pull_back(run, segments), run.inputs, kept)
    return kept


def pull_back(run: Recorded, segments: Segments) -> None:
    """Segment by segment from the last: recompute its states, then the adjoint of its steps."""
    kept, bounds, device = run.states, segments.bounds, run.x0.device
    worlds, last = kept.shape[0], len(bounds) - 1
    status = wp.zeros(worlds, dtype=wp.int32, device=device)
    start = wp.zeros(run.x0.shape, dtype=kept.dtype, device=device, requires_grad=True)
    slopes = wp.zeros(segments.states.shape, dtype=kept.dtype, device=device)
    copy_rows(kept.grad[:, last], start.grad)
    for i in reversed(range(last)):
        steps = bounds[i + 1] - bounds[i]
        slopes.zero_()
        copy_rows(start.grad, slopes[:, steps])
        copy_rows(kept.grad[:, i], slopes[:, 0])
        start.grad.zero_()
        status.zero_()
        states = segments.run(i, kept[:, i], status)
        first = run.x0 if i == 0 else start
        part = replace(run, x0=first, us=segments.controls(i), states=states)
        adjoint(part, slopes[:, : steps + 1])
    kept.grad.zero_()
