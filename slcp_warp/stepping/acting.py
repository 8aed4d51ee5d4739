"""Policies asked from step to step, each with what it remembers."""

from typing import Any, Protocol

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.policies.ask import make_ask_kernel

from ..inputs.arrays import ArrayError
from ..inputs.checks import attribute
from ..inputs.errors import ArgumentError
from .arguments import policy_arrays
from .host import Asked, acts_on_host, senses_of


class Acting(Protocol):
    """A policy at work in some worlds."""

    def controls(self, x: np.ndarray, step: int, time: float) -> np.ndarray:
        """(B, nu) for states (B, nx); the first question, and step 0, begin anew."""


class Nothing:
    """No control."""

    def __init__(self, nu: int) -> None:
        self.nu = nu

    def controls(self, x: np.ndarray, step: int, time: float) -> np.ndarray:
        """Zeros."""
        return np.zeros((len(x), self.nu))


class InKernel:
    """A policy in a kernel: its arrays, and its memory, are kept between two steps."""

    def __init__(self, policy: Any, sim: Any, numbers: np.ndarray) -> None:
        rows, need = attribute(policy, "worlds") or 1, int(numbers.max(initial=0)) + 1
        if 1 < rows < need:
            raise ArrayError(f"policy holds {rows} trajectories; one for all, or {need} or more, is needed")
        self.sim, (kernel, self.struct) = sim, policy_arrays(policy, sim, max(rows, need))
        self.kernel, worlds = make_ask_kernel(kernel, sim.nx, sim.nu, sim.dtype), len(numbers)
        self.memory = sim.empty(worlds, kernel.functions(sim.nx, sim.nu, sim.dtype).memory)
        self.us = sim.empty(worlds, max(sim.nu, 1))
        self.status: Any = wp.zeros(worlds, dtype=wp.int32, device=sim.device)
        self._fresh = True
        self.numbers: Any = wp.array(numbers, dtype=wp.int32, device=sim.device)

    def controls(self, x: np.ndarray, step: int, time: float) -> np.ndarray:
        """Asks the kernel."""
        state: Any = wp.array(x, dtype=self.sim.dtype, device=self.sim.device)
        fresh, self._fresh = int(self._fresh or step == 0), False
        inputs = [step, fresh, self.struct, self.numbers, state, self.status, self.memory, self.us]
        launch(self.kernel, len(x), inputs, self.sim.device)
        return np.asarray(self.us.numpy()[:, : self.sim.nu], float)


class OnHost:
    """A policy that acts on the host, asked once a period and held in between, whatever the steps' size."""

    def __init__(self, policy: Any, sim: Any, numbers: np.ndarray, step_size: float) -> None:
        if senses_of(policy):
            raise ArgumentError(
                f"policy is a {type(policy).__name__} with senses, behind another one, which has states for "
                "it and nothing to feel; a policy without senses is needed"
            )
        self.asked = Asked(policy, sim, numbers, np.array([step_size]))
        self.held = np.zeros((len(numbers), sim.nu))
        self.periods = -1  # that had begun when it was asked last

    def controls(self, x: np.ndarray, step: int, time: float) -> np.ndarray:
        """Asks the policy, or gives what it said last."""
        begun = step // self.asked.every
        if begun != self.periods:
            self.held, self.periods = self.asked.controls(step, x), begun
        return self.held


def acting(policy: Any, sim: Any, numbers: np.ndarray, step_size: float | None = None) -> Acting:
    """A policy at work in the worlds of these numbers (B,), asked at steps of a size [s], None: the scene's;
    policy None: no control.
    """
    if policy is None or not sim.nu:
        return Nothing(sim.nu)
    if not acts_on_host(policy):
        return InKernel(policy, sim, numbers)
    return OnHost(policy, sim, numbers, sim.scene.step_size if step_size is None else step_size)
