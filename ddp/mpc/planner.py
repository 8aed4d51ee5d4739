"""The plans of one block of worlds: starts tried, the best improved, kept for the next cycle."""

from dataclasses import dataclass, field, replace

import numpy as np

from ..options import Options
from ..problem import Problem
from ..workspace import Workspace
from .starts import Policy, Situation, Start, policies_of


@dataclass
class Made:
    """What a cycle came to.

    Attributes:
        failures: worlds whose last plan goes on.
        chosen: worlds by the name of the start that was best.
    """

    failures: int = 0
    chosen: dict[str, int] = field(default_factory=dict)


class Planner:
    """Workspaces of a block of worlds, and its plan.

    Attributes:
        problem: of the plans now; their horizon may differ from cycle to cycle.
        worlds: how many.
        acting: the newest plans; their gains are those of `prepare` once it ran.
        policy: the plans that the next cycle shifts; None before the first.
    """

    def __init__(
        self, problem: Problem, options: Options, passes: int, worlds: int, starts: int, improved: int
    ) -> None:
        self.passes, self.worlds, self.starts, self.improved = passes, worlds, starts, improved
        self.options = replace(options, start="rollout")
        self._make(problem)
        self.forget()

    def _make(self, problem: Problem) -> None:
        """The workspaces of a problem."""
        self.problem, worlds = problem, self.worlds
        trial = replace(self.options, method="gauss-newton", step_sizes=(1.0,), max_iterations=0)
        self.trial = Workspace(problem, worlds * self.starts, trial)  # it only rolls out
        self.work = Workspace(problem, worlds * self.improved, self.options)

    def _take(self, problem: Problem) -> None:
        """Another problem; where only numbers of its cost differ, in the same workspaces."""
        if not self.problem.differs_by_weights(problem):
            self._make(problem)
            return
        self.problem = problem
        for work in (self.trial, self.work):
            work.set_cost(problem)

    def forget(self) -> None:
        """Begin anew."""
        self.acting: Policy | None = None
        self.policy: Policy | None = None
        self._open = False

    def plan(self, situation: Situation, starts: dict[str, Start]) -> Made:
        """New plans from the states of the situation, of its problem, into `acting`."""
        if situation.problem is not self.problem:
            self._take(situation.problem)
        B, x, work = self.worlds, situation.x, self.work
        found = {name: policies_of(name, make(situation), situation) for name, make in starts.items()}
        nothing = Policy.open_loop(x, np.zeros((B, self.problem.horizon, self.problem.nu)))
        usable = np.array([np.zeros(B, bool) if p is None else p.finite for p in found.values()])
        tried = Policy.join(
            [nothing if p is None else _either(own, p, nothing) for own, p in zip(usable, found.values())]
        )
        self._roll_out(self.trial, np.tile(x, (self.starts, 1)), tried)
        cost = self.trial.cost.numpy().reshape(self.starts, B).astype(np.float64)
        cost[~usable | ~np.isfinite(cost)] = np.inf
        order = cost.argsort(axis=0, kind="stable")[: self.improved]  # (improved, B): the best first
        own = np.arange(B)
        self._roll_out(work, np.tile(x, (self.improved, 1)), tried.select((order * B + own).ravel()))
        for _ in range(self.passes):
            work.differentiate()
            work.backward()
            if not work.active():
                break
            work.search()
        after = work.cost.numpy().reshape(self.improved, B).astype(np.float64)
        after = np.where(np.isfinite(after) & np.isfinite(cost[order, own]), after, np.inf)
        self._best = after.argmin(axis=0) * B + own
        self._good, self._open = np.isfinite(after.min(axis=0)), True
        names, picked = list(found), order[after.argmin(axis=0), own][self._good]
        counts = np.bincount(picked, minlength=self.starts).tolist()
        us, xs, K = (self._chosen(name) for name in ("us", "xs", "K"))
        fresh = Policy(us, xs, K, np.zeros_like(us))
        last = nothing if situation.last is None else situation.last
        self.acting = _either(self._good, fresh, last)
        return Made(int((~self._good).sum()), dict(zip(names, counts, strict=True)))

    def _chosen(self, name: str) -> np.ndarray:
        """An array of the workspace, of the plans that were chosen."""
        return np.asarray(getattr(self.work, name).numpy()[self._best], np.float64)

    def prepare(self) -> None:
        """The backward pass about the newest plans: their gains, and the step of real-time iteration."""
        if not self._open or self.acting is None:
            return
        self._open = False
        self.work.differentiate()
        self.work.backward(last=True)
        K, k = self._chosen("K"), self._chosen("k")
        own = np.isfinite(K).all((1, 2, 3)) & np.isfinite(k).all((1, 2)) & self._good
        self.acting.K = np.where(own[:, None, None, None], K, self.acting.K)
        ahead = own[:, None, None] & (self.passes == 0)
        self.policy = replace(self.acting, k=np.where(ahead, k, 0.0))

    @staticmethod
    def _roll_out(work: Workspace, x: np.ndarray, p: Policy) -> None:
        work.start(x, p.us, p.xs, p.K, p.k)


def _either(own: np.ndarray, first: Policy, second: Policy) -> Policy:
    """Policies of the first where it says so, else of the second."""
    if own.all():
        return first
    parts = []
    for name in ("us", "xs", "K", "k"):
        a = getattr(first, name)
        parts.append(np.where(own.reshape(-1, *[1] * (a.ndim - 1)), a, getattr(second, name)))
    return Policy(*parts)
