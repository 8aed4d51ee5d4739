"""Rounds of multipliers, in which the limits of states come to hold."""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.control.costs import make_price_kernel
from slcp_warp.kernels.control.state_limits import make_limit_kernels
from slcp_warp.kernels.device.launch import Prepared

from ..results.excess import excess
from ..results.status import Status
from .gaps import start_again

LITTLE = 0.1  # of what is paid for violations: a pass that gains no more has next to nothing to gain
MOST = 0.5  # of the passes that were left when a round began: it gets no more of them
ENDED = (Status.CONVERGED, Status.SMALL_IMPROVEMENT, Status.FLAT, Status.MAX_ITERATIONS)


class Rounds:
    """Rounds of a workspace whose problem has state limits; each of its problems has its own.

    A round need not find its minimum, which can take more passes than there are. While the limits do not hold
    it is cut short where it had an even share of all passes and one gained no more than `LITTLE`, and at the
    latest when it had `MOST` of those that were left. Where the limits hold none is cut short.

    Args:
        work: the `Workspace`, with its arrays.
    """

    def __init__(self, work: Any) -> None:
        self.work = work
        nx, nu, dtype = work.problem.nx, work.problem.nu, work.dtype
        policy, limits, state = work._policy, work._limits, work._state
        add, update = make_limit_kernels(nx, dtype)
        self.add_penalties = self._launch(add, policy, limits, state.fresh, work._derivatives)
        self._update = self._launch(update, policy, limits, state.searching, dtype(work.options.limit_factor))
        self._price: Any = wp.zeros(work.batch, dtype=wp.float64, device=work.device)
        price = make_price_kernel(work._functions, nx, nu, dtype)
        self._run_price = self._launch(price, policy.xs, policy.us, work._weights, self._price)
        self._made, self._began = np.zeros((2, work.batch), dtype=np.int64)

    def _launch(self, kernel: Any, *inputs: Any) -> Prepared:
        return Prepared(kernel, self.work.batch, list(inputs), self.work.device, grain=16)

    def start(self) -> None:
        """The first round: no multipliers, and the first weight."""
        self.work._limits.multiplier.zero_()
        self.work._limits.weight.fill_(self.work.options.limit_weight)
        self._made[:], self._began[:] = 0, 0

    def beyond(self) -> np.ndarray:
        """As of `Workspace.beyond_limits`."""
        relative = self._excess()[1]
        return np.asarray(relative.max((1, 2), initial=0.0))

    def _excess(self) -> tuple[np.ndarray, np.ndarray]:
        return excess(self.work.xs.numpy(), self.work.problem.state_limit_rows())

    def _unheld(self) -> np.ndarray:
        """(B,) which problems are beyond their limits by more than the tolerance and not left behind."""
        return (self.beyond() > self.work.options.limit_tolerance) & ~self.work._behind

    def due(self, limit: int) -> np.ndarray:
        """(B,) which problems that have ended are to have another round; all may make so many passes."""
        more = self._may_begin(limit) & (self.work._state.active.numpy() == 0)
        return more & self._unheld() if more.any() else more

    def cut_short(self, gained: np.ndarray, limit: int) -> None:
        """The next round of problems that go on beyond their limits and whose round was long enough.

        Args:
            gained: (B,) by the last pass.
            limit: passes that all may make.
        """
        more = self._may_begin(limit) & (self.work._state.active.numpy() == 1)
        made = self.work.passes.numpy() - self._began
        shared = more & (made * (self.work.options.limit_rounds + 1) >= limit)
        most = more & (made >= MOST * (limit - self._began))
        if shared.any() or most.any():
            paid = 0.5 * self.work._limits.weight.numpy() * (self._excess()[0] ** 2).sum((1, 2))
            self.next((most | shared & (gained <= LITTLE * paid)) & self._unheld())

    def _may_begin(self, limit: int) -> np.ndarray:
        """(B,) which problems have rounds and passes left."""
        left = self._made < self.work.options.limit_rounds
        return np.asarray(left & (self.work.passes.numpy() < limit))

    def next(self, which: np.ndarray) -> None:
        """New multipliers and weights of these problems (B,); passes go on from where they are."""
        if not which.any():
            return
        self._made[which] += 1
        self._began[which] = self.work.passes.numpy()[which]
        self.work._state.searching.assign(which.astype(np.int32))
        self._update()
        start_again(self.work, which)  # the same trajectory, and its cost with the new multipliers

    def judge(self) -> None:
        """STATE_LIMITS for what ended beyond its limits, unless they are soft."""
        if self.work.options.limit_rounds:
            code = self.work.status.numpy()
            unheld = self._unheld() & np.isin(code, ENDED)
            self.work.status.assign(np.where(unheld, Status.STATE_LIMITS, code).astype(np.int32))

    def own_cost(self) -> np.ndarray:
        """(B,) the cost without penalties."""
        self._run_price()
        return np.asarray(self._price.numpy())
