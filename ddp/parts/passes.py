"""The launches of one pass: backward, rollouts with the first step size or with all, the choice."""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.inputs.checks import attribute
from slcp_warp.kernels.control.backward.riccati import make_backward_kernel
from slcp_warp.kernels.control.backward.riccati_lanes import make_lanes_kernel
from slcp_warp.kernels.control.backward.riccati_steps import LANES, room_of
from slcp_warp.kernels.control.line_search import make_choice_kernels
from slcp_warp.kernels.device.launch import Prepared

from .rollouts import OwnRollouts, StepRollouts


def lanes_of(device: wp.Device) -> int:
    """Lanes of a warp that make a problem's backward pass together; 0 on a CPU, where a thread makes it."""
    return 0 if device.is_cpu else LANES


class Passes:
    """Passes over a workspace's arrays, about the trajectory of one policy struct.

    Args:
        work: the `Workspace`, with its arrays.
        policy: its own, or the one with gaps.
        staged: whether the first step size is rolled out before the others; None: on a CPU.
    """

    def __init__(self, work: Any, policy: Any, staged: bool | None = None) -> None:
        self.work, self.policy = work, policy
        several = len(work.options.step_sizes) > 1 and bool(np.isfinite(work.options.full_step_ratio))
        handed = attribute(work.dynamics, "handed")
        self._handed = None if handed is None else handed()
        staged = work.device.is_cpu if staged is None else staged
        self.staged = several and staged and self._handed is None
        self._prepare_backward()
        self._prepare_rollouts()
        self._prepare_choice()

    def _launch(self, kernel: Any, dim: int, inputs: list[Any], grain: int = 1, offset: int = 0) -> Prepared:
        return Prepared(kernel, dim, inputs, self.work.device, grain=grain, offset=offset)

    def _prepare_backward(self) -> None:
        work, problem = self.work, self.work.problem
        limited = problem.control_limits is not None
        sizes = problem.nx, problem.nu, int(work.dynamics.nw)
        inputs, lanes = [work._derivatives, self.policy, work._state], lanes_of(work.device)
        if lanes:
            kernel = make_lanes_kernel(*sizes, work.options.method, limited, work.dtype, lanes)
            shape = work.batch, room_of(*sizes)["width"]
            inputs.append(wp.empty(shape, dtype=work.dtype, device=work.device))
        else:
            kernel = make_backward_kernel(*sizes, work.options.method, limited, work.dtype)
        inputs.append(work.gradient_tolerance)
        items = work.batch * max(1, lanes)
        self._run_backward = self._launch(kernel, items, [*inputs, 0])
        self._run_last_backward = self._launch(kernel, items, [*inputs, 1])

    def _prepare_rollouts(self) -> None:
        """In stages those with the first step size and those with the others; else all in one launch."""
        work = self.work
        B, sizes = work.batch, len(work.options.step_sizes)
        make = OwnRollouts if hasattr(work.dynamics, "prepare_candidates") else StepRollouts
        self.rollouts = make(work, self.policy, self._handed)
        mask, searching = work._state.active, work._state.searching
        tried = 1 if self.staged else sizes
        self._run_tried = self.rollouts.run(B * tried, work._candidates, mask)
        if self.staged:
            self._run_others = self.rollouts.run(B * (sizes - 1), work._candidates, searching, offset=B)
        self._shoot = self.rollouts.shoot() if self.policy.gaps.shape[0] else None

    def _prepare_choice(self) -> None:
        work, options = self.work, self.work.options
        start, screen, accept = make_choice_kernels(work.problem.nx, work.problem.nu, work.dtype)
        arrays, state = [self.policy, work._candidates, work._state], work._state
        self._run_start = self._launch(start, work.batch, [*arrays, 0], grain=64)
        self._run_again = self._launch(start, work.batch, [*arrays, 1], grain=64)
        ratio = float(options.full_step_ratio)
        self._run_screen = self._launch(screen, work.batch, [work._candidates, state, ratio], grain=64)
        bounds = [ratio, options.min_reduction_ratio, options.improvement_tolerance, work.gradient_tolerance]
        self._run_accept = self._launch(accept, work.batch, [*arrays, *bounds], grain=64)

    def shoot(self) -> None:
        """Cost and gaps of the states and controls that the policy holds, as the first candidate's."""
        assert self._shoot is not None
        self._shoot()

    def start(self, again: bool = False) -> None:
        """Make the first candidate the trajectory; ``again``: of the problems that are searched for alone,
        whose passes, trace and regularisation go on.
        """
        (self._run_again if again else self._run_start)()

    def backward(self, last: bool = False) -> None:
        """As of `Workspace.backward`."""
        (self._run_last_backward if last else self._run_backward)()

    def search(self) -> None:
        """As of `Workspace.search`."""
        self._run_tried()
        if self.staged:
            self._run_screen()
            if self.work._state.searching.numpy().any():
                self._run_others()
        self._run_accept()
