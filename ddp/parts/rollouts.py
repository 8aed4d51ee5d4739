"""Rollouts of a workspace's candidates: by kernels with a step function, or by those of the dynamics."""

from collections.abc import Callable
from typing import Any

import warp as wp

from slcp_warp.kernels.control.candidate_costs import make_candidate_cost_kernel, make_gap_kernel
from slcp_warp.kernels.control.generic_rollouts import FOLLOW, SHOOT
from slcp_warp.kernels.control.rollouts import make_rollout_kernel, make_shooting_kernel
from slcp_warp.kernels.device.launch import Prepared
from slcp_warp.kernels.device.relay import Relay, Run


class StepRollouts:
    """By kernels that hold the dynamics' step and the cost.

    Args:
        work: the `Workspace`, with its arrays.
        policy: that is rolled out.
        handed: a fast step and the full one behind it, None: one for all.
    """

    def __init__(self, work: Any, policy: Any, handed: Any) -> None:
        problem, functions = work.problem, work._functions
        self.work, self.policy, self.handed = work, policy, handed
        self._step = work.dynamics.step_function(), work.dynamics.initial_carry()
        self._cost = functions.running, functions.final
        self._kept = problem.state_limits is not None
        limited, (step, carry) = problem.control_limits is not None, self._step
        shape = problem.nx, problem.nu, limited, self._kept, work.dtype
        if handed is None:
            self._kernels = [make_rollout_kernel(step, carry, *self._cost, *shape)]
        else:
            self._kernels = [
                make_rollout_kernel(one.advance, carry, *self._cost, *shape, one) for one in handed
            ]

    def run(self, items: int, candidates: Any, mask: Any, offset: int = 0) -> Callable[[], Any]:
        """A prepared rollout of candidates offset, .., of problems with mask 1, with their costs."""
        work = self.work
        shared = [work._limits, work.params, work._weights]
        inputs = [work.batch, work.x0, self.policy, candidates, *shared, mask]
        if self.handed is None:
            none = wp.empty((0, 0), dtype=work.dtype, device=work.device)
            whole = [0, 0, 0, Relay(), none, *inputs]
            return Prepared(self._kernels[0], items, whole, work.device, grain=1, offset=offset)
        carries = wp.empty((items, self.handed[0].width), dtype=work.dtype, device=work.device)
        fast, full = self._kernels
        return Run(fast, full, items, work.problem.horizon, [carries, *inputs], work.device, grain=1)

    def shoot(self) -> Callable[[], Any]:
        """Cost and gaps of the states and controls that the policy holds, as the first candidate's."""
        work, problem = self.work, self.work.problem
        kernel = make_shooting_kernel(
            *self._step, *self._cost, problem.nx, problem.nu, self._kept, work.dtype
        )
        shared = [work._limits, work.params, work._weights]
        inputs = [work.x0, self.policy, work._candidates, *shared, work._state]
        return Prepared(kernel, work.batch, inputs, work.device, grain=1)


class OwnRollouts:
    """By kernels of the dynamics, and costs after them; arguments as of `StepRollouts`."""

    def __init__(self, work: Any, policy: Any, handed: Any) -> None:
        problem, functions = work.problem, work._functions
        self.work, self.policy = work, policy
        kept = problem.state_limits is not None
        self._kernel = make_candidate_cost_kernel(
            functions.running, functions.final, problem.nx, problem.nu, kept, work.dtype
        )

    def run(self, items: int, candidates: Any, mask: Any, offset: int = 0) -> Callable[[], Any]:
        """As of `StepRollouts`."""
        return _in_turn(
            self._roll(items, candidates, mask, offset, FOLLOW), self._price(items, candidates, mask, offset)
        )

    def shoot(self) -> Callable[[], Any]:
        """As of `StepRollouts`."""
        work = self.work
        some = work.batch, work._candidates, work._all, 0
        kernel = make_gap_kernel(work.problem.nx, work.dtype)
        gaps = Prepared(
            kernel, work.batch, [self.policy, work._candidates, work._state], work.device, grain=1
        )
        return _in_turn(self._roll(*some, SHOOT), gaps, self._price(*some))

    def _roll(self, items: int, candidates: Any, mask: Any, offset: int, mode: int) -> Callable[[], Any]:
        work = self.work
        given: Callable[[], Any] = work.dynamics.prepare_candidates(
            work.batch, items, offset, self.policy, candidates, work.params,
            x0=work.x0, active=mask, mode=mode,
        )  # fmt: skip
        return given

    def _price(self, items: int, candidates: Any, mask: Any, offset: int) -> Prepared:
        work = self.work
        inputs = [work.batch, candidates, work._limits, work._weights, mask]
        return Prepared(self._kernel, items, inputs, work.device, grain=16, offset=offset)


def _in_turn(*launches: Callable[[], Any]) -> Callable[[], Any]:
    def run() -> None:
        for launch in launches:
            launch()

    return run
