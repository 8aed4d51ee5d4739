"""Our simulator on the benchmarks' workload: the paper's finger as a user calls it, with NumPy arrays."""

import contextlib
import dataclasses
import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp
from slcp_warp.kernels.device import launch

from .workload import Workload, windows

DTYPES = ("float32", "float64")
PAPER = slcp.Options(residual="rem-logistic", scaling="none", friction="anitescu", integrator="euler")
TOUCH = 0.01  # normal impulse of a touching step [N s]; a link's weight gives .126 N s in a step of .05 s
WINDOW = 10  # steps of a touching window


@contextlib.contextmanager
def cpu_threads(count: int) -> Iterator[None]:
    """Let launches on the CPU use this many threads."""
    before = launch._default_threads
    launch._default_threads = count
    try:
        yield
    finally:
        launch._default_threads = before


class Ours:
    """A simulator of the paper's finger with a workload in its own dtype.

    Attributes:
        sim, params: the simulator and its numbers.
        work: the workload, without the worlds that were not solved.
        failed: their share.
        touching: which steps of its rollout touch, (B, N).
        states: of the rollout, (B, N+1, nx).
    """

    def __init__(self, work: Workload, dtype: str, residual: str = "rem-logistic", **choices: Any) -> None:
        options = dataclasses.replace(PAPER, residual=residual, **choices)
        self.sim = slcp.Simulator(slcp.scenes.flicking_finger(), options, device="cpu", dtype=dtype)
        self.params = self.sim.params
        work = self.cast(work)
        traj = self.sim.rollout(work.x0, work.controls, self.params, record=("impulse",))
        solved = traj.status == slcp.Status.SOLVED
        self.failed = float(1.0 - solved.mean())
        self.work = Workload(work.x0[solved], work.controls[solved])
        rows = self.sim.scene.structure.rows
        contact = [i for i, row in enumerate(rows) if row.kind == "contact"]
        self.touching = traj.impulse[solved][:, :, contact].sum(axis=2) >= TOUCH
        self.states = traj.states[solved]

    @functools.cached_property
    def touching_windows(self) -> Workload:
        """Stretches of the rollout in which every step touches."""
        return self.cast(windows(self.states, self.work.controls, self.touching, WINDOW))

    def cast(self, work: Workload) -> Workload:
        """A workload in the simulator's dtype, contiguous."""
        kind = wp.dtype_to_numpy(self.sim.dtype)
        return Workload(np.ascontiguousarray(work.x0, kind), np.ascontiguousarray(work.controls, kind))

    def rollout(self, work: Workload) -> Any:
        """The rollout of a workload."""
        return self.sim.rollout(work.x0, work.controls, self.params)
