"""A policy as a task's undisturbed worlds have it, in rollouts, which know no task."""

import copy
from collections import deque
from typing import Any

import numpy as np

from ...inputs.checks import attribute
from ...inputs.limits import bounded, limit_rows
from ...policies.around import Around, controls_before
from ...stepping.arguments import at_step_size
from ...stepping.host import acts_on_host, steps_between, told
from ...tasks.task import Task
from .between import OfHost, observed, steps_of


def nominal(policy: Any, task: Task, step_size: float) -> Any:
    """A policy behind what belongs to a task and is not drawn: observation, delay, hold, control limits.

    Args:
        policy: as of a rollout.
        task: that it acts in.
        step_size: of the rollout [s].

    Raises:
        ArgumentError: a delay or a hold of less than half a step.
    """
    own = task.disturbances.fixed()
    delay, hold = steps_of(own, step_size)
    lower, upper = limit_rows(task.control_limits, task.scene.nu)
    limits = (lower[0], upper[0]) if bounded(lower, upper) else None
    policy = observed(at_step_size(policy, step_size), task)
    kept = limits is None or _keeps(policy, limits)
    if delay == 0 and hold == 1 and kept:
        return policy
    if acts_on_host(policy):
        return HostAround(policy, limits, delay, hold, step_size, own.before)
    if delay or hold > 1:
        return Around(policy, limits, delay, hold, before=own.before)
    return within(policy, limits)


def _keeps(policy: Any, limits: Any) -> bool:
    """Whether a policy's own limits lie within these (nu,)."""
    own = _own(policy)
    return own is not None and all(np.array_equal(side, np.clip(side, *limits)) for side in own)


def _own(policy: Any) -> tuple[np.ndarray, np.ndarray] | None:
    """Limits (B, nu) that a policy keeps by itself, as an array each."""
    own = attribute(policy, "limits")
    there = isinstance(own, tuple) and all(isinstance(side, np.ndarray) and side.ndim == 2 for side in own)
    return own if there else None


def within(policy: Any, limits: Any) -> Any:
    """A policy of kernels within limits (nu,); one that can be given them keeps its kernel."""
    own = _own(policy)
    if own is None or isinstance(getattr(type(policy), "limits", None), property):
        return Around(policy, limits)
    out = copy.copy(policy)
    out.limits = tuple(np.clip(side, *limits) for side in own)
    return out


class HostAround(OfHost):
    """`policies.Around` for a policy that acts on the host, in rollouts: a hold, a delay and limits."""

    def __init__(
        self, policy: Any, limits: Any, delay: int, hold: int, step_size: float, before: Any = None
    ) -> None:
        super().__init__(policy)
        own = steps_between(policy, step_size)
        self._every = hold if hold % own == 0 else own  # what is said in between reaches no world
        self._limits, self._delay, self._hold, self._before = limits, delay, hold, before
        self._h, self.period = step_size, step_size
        if self.senses:
            self._feels, self.feel = policy.feel, self._keep
        self._felt: dict[str, np.ndarray] = {}
        self._inner_begin = getattr(self, "begin", None)
        self.begin = self._begin

    def _begin(self, sim: Any, worlds: np.ndarray) -> None:
        if self._inner_begin is not None:
            self._inner_begin(sim, worlds)
        nothing = np.zeros((len(worlds), sim.nu))
        before = nothing + controls_before("Disturbances.before", self._before, sim.nu)
        self._way = deque([before] * self._delay)
        self._said = self._held = nothing

    def _keep(self, shown: dict[str, np.ndarray]) -> None:
        """What is felt, until the policy is asked."""
        self._felt = shown

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> Any:
        """Controls of the states x (B, nx)."""
        k = round(time / self._h)
        if k % self._every == 0:
            if self.senses:
                self._feels(self._felt)
            self._said = told(self._policy, x, time, worlds, self._held.shape[1])  # a copy: it may be reused
        if k % self._hold == 0:
            self._held = self._said
        self._way.append(self._held)
        u = self._way.popleft()
        return u if self._limits is None else np.clip(u, *self._limits)
