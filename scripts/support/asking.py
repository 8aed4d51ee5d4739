"""How long policies on the host take, said before an hour has passed."""

import time as clock
from collections.abc import Callable
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp.ensembles.tasks import cases_by_name
from slcp_warp.inputs.checks import number
from slcp_warp.inputs.times import nearest_steps
from slcp_warp.stepping.host import acts_on_host

from .screen import span

Say = Callable[[str], None]


class Watched:
    """A policy on the host whose answers are timed; in everything else the policy itself."""

    def __init__(self, policy: Any, name: str, steps: int, say: Say) -> None:
        """Args:
        steps: of all its worlds together, as many as it will be asked for.
        say: is told how long it takes, and how long all that is left.
        """
        self._policy, self._name, self._left, self._say = policy, name, steps, say
        self._seconds, self._asked = 0.0, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._policy, name)

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> Any:
        """What the policy gives."""
        began, first = clock.perf_counter(), not self._asked
        found = self._policy.act(x, time, worlds)
        seconds, self._left = clock.perf_counter() - began, max(0, self._left - len(x))
        self._asked += len(x)
        if first:  # it compiles
            self._first = len(x)
        else:
            self._seconds += seconds
            each = self._seconds / (self._asked - self._first)
            rest = span(each * self._left)
            self._say(f"{self._name} takes {1e3 * each:.3g} ms a step and world, {rest} to go")
        return found


def watched(policies: Any, steps: int, say: Say) -> Any:
    """Policies by name, those on the host timed; `steps` that each of them is asked for."""
    if not policies:
        return policies
    host = {name for name, policy in policies.items() if acts_on_host(policy)}
    return {
        name: Watched(policy, name, steps, say) if name in host else policy
        for name, policy in policies.items()
    }


def steps_of_sweep(task: slcp.Task, worlds: Any, cases: Any, step_sizes: Any) -> int:
    """Steps of all worlds, disturbed and not, of one policy in a sweep."""
    assert task.duration is not None
    sizes = [number("step_sizes", h, 0.0, above=True) for h in step_sizes or (task.scene.step_size,)]
    steps = sum(nearest_steps("Task.duration", task.duration, h, "step_sizes") for h in sizes)
    return worlds_of_sweep(task, worlds, cases, None) * steps


def worlds_of_sweep(task: slcp.Task, worlds: Any, cases: Any, step_sizes: Any) -> int:
    """Worlds, disturbed and not, of one policy in a sweep."""
    count = len(worlds) if isinstance(worlds, slcp.Worlds) else int(worlds)
    return (count + len(task.start)) * len(cases_by_name(task, cases)) * len(step_sizes or (None,))
