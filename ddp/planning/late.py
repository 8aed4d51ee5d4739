"""Plans of controls that act some steps after they are sent: what cannot be changed any more, and the rest.

Before the first control that is sent `Problem.before` acts (zero by itself), so that the first steps follow
from the start alone. What comes after them is a problem like any other, from the state that they lead to.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slcp_warp import Task
from slcp_warp.costs import NO_COST
from slcp_warp.ensembles.worlds.between import steps_of
from slcp_warp.inputs.checks import array
from slcp_warp.inputs.errors import ArgumentError

from ..multistart import Multistart
from ..options import Options
from ..problem import Problem
from ..results.result import DELAY, Result
from ..workspace import Workspace

ONLY_ROLLED = Options(max_iterations=0, start="rollout", method="gauss-newton", step_sizes=(1.0,))


@dataclass(frozen=True)
class Late:
    """A problem of N steps whose controls act so many steps after they are sent.

    Attributes:
        whole: all of it.
        delay: steps; 0: all of it is planned, as it is.
        rest: what is left to plan, its last N - delay steps.
    """

    whole: Problem
    delay: int
    rest: Problem

    @classmethod
    def of(cls, problem: Problem, delay: int) -> "Late":
        """Of a problem.

        Raises:
            ArgumentError: no control acts before the horizon's end.
        """
        if delay >= problem.horizon:
            raise ArgumentError(
                f"controls act {delay} steps after they are sent; plans of more steps than {problem.horizon} "
                "are needed"
            )
        if not delay:
            return cls(problem, 0, problem)
        rest = replace(problem, cost=problem.cost.from_step(delay), horizon=problem.horizon - delay)
        return cls(problem, delay, rest)

    def begin(self, x0: np.ndarray) -> np.ndarray:
        """The state that x0 (nx,) or (B, nx) has come to when the first control acts."""
        if not self.delay:
            return x0
        cost = NO_COST if self.whole.cost.nodes else self.whole.cost
        before = replace(self.whole, horizon=self.delay, cost=cost)
        batch = len(np.atleast_2d(x0))
        work = Workspace(before, batch, ONLY_ROLLED)
        work.start(x0, np.tile(self.whole.rest_control(), (batch, self.delay, 1)))
        if not np.isfinite(work.cost.numpy()).all():
            raise ArgumentError("x0 leads nowhere: a step before the first control acts fails")
        return work.xs.numpy()[:, -1].astype(np.float64).reshape(np.shape(x0))

    def controls(self, us: Any) -> np.ndarray:
        """Controls (S, N, nu) to start from, of the rest.

        Raises:
            ArgumentError: another shape, or a control before the first can act.
        """
        found = array("starts", us, ("S", self.whole.horizon, self.whole.nu))
        first = found[:, : self.delay]
        if (first.any(-1) & (first != self.whole.rest_control()).any(-1)).any():
            raise ArgumentError(
                f"starts has controls in its first {self.delay} steps, before the first that is sent acts; "
                "zeros are needed there, or what acts before"
            )
        return found[:, self.delay :]

    def extend(self, result: Result, x0: np.ndarray) -> Result:
        """A result of the rest, of one problem or many, from x0 on."""
        if not self.delay:
            return result
        if not result.batched:
            return self.extend(result.as_batch(), x0).select(0)
        B, d = len(result.us), self.delay
        states = np.repeat(result.xs[:, :1], d, axis=1)  # of gains that are zero
        rest = self.whole.rest_control()[:, None]
        us, K, k = (_before(a, d, b) for a, b in ((result.us, rest), (result.K, 0.0), (result.k, 0.0)))
        work = Workspace(self.whole, B, ONLY_ROLLED)
        work.start(x0, us, np.concatenate([states, result.xs], axis=1), K)
        cost = work.own_cost()
        trace = replace(result.trace, cost=result.trace.cost + (cost - result.cost)[:, None])
        return replace(
            result, xs=work.xs.numpy().copy(), us=work.us.numpy().copy(), K=K, k=k, cost=cost, trace=trace,
            Vx=_before(result.Vx, d, np.nan), Vxx=_before(result.Vxx, d, np.nan),
            simulated=self.whole.simulated(), header=result.header | {DELAY: d},
        )  # fmt: skip

    def extended(self, many: Multistart, x0: np.ndarray) -> Multistart:
        """All plans of a search for the best, and the best, from x0 on."""
        if not self.delay:
            return many
        return replace(many, best=self.extend(many.best, x0), all=self.extend(many.all, x0))


def delay_of(task: Task, problem: Problem) -> int:
    """Steps of a problem after which a task's controls act, where that is not drawn."""
    return steps_of(task.disturbances.fixed(), float(np.ravel(problem.params["step_size"])[0]))[0]


def _before(values: np.ndarray, steps: int, value: Any) -> np.ndarray:
    """(B, steps + N, ...) with a value in the first steps."""
    shape = (values.shape[0], steps, *values.shape[2:])
    return np.concatenate([np.broadcast_to(value, shape).astype(values.dtype), values], axis=1)
