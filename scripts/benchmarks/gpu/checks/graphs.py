"""Captured in a graph: steps, rollouts, a rollout's gradient, steps on a tape; the bits of the launches."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from ..record import Found
from ..setting import Setting

WORLDS, STEPS = 300, 20
Call = Callable[[], list[Any]]


class Arrays:
    """Starts and controls on the device, and gradients of the sum of all states by them."""

    def __init__(self, setting: Setting, dtype: str) -> None:
        self.sim, self.work = setting.finger(dtype), setting.workload(2 * WORLDS, STEPS)
        kind: Any = {"dtype": self.sim.dtype, "device": setting.device}
        self.x0: Any = wp.array(self.work.x0[:WORLDS], requires_grad=True, **kind)
        self.us: Any = wp.array(self.work.controls[:WORLDS], requires_grad=True, **kind)
        self.one: Any = wp.array(self.work.controls[:WORLDS, 0], requires_grad=True, **kind)
        self.ones: Any = wp.full((WORLDS, STEPS + 1, self.sim.nx), 1.0, **kind)
        self.after: Any = wp.full((WORLDS, self.sim.nx), 1.0, **kind)

    def start(self, second: bool) -> None:
        """Put in the first or the second starts."""
        self.x0.assign(self.work.x0[WORLDS:] if second else self.work.x0[:WORLDS])

    def step(self) -> list[Any]:
        """One step."""
        return [self.sim.step(self.x0, self.one).state]

    def rollout(self) -> list[Any]:
        """All steps in one launch."""
        return [self.sim.rollout(self.x0, self.us).states]

    def gradient(self) -> list[Any]:
        """A rollout and its backward pass."""
        self.x0.grad.zero_()
        self.us.grad.zero_()
        with wp.Tape() as tape:
            states = self.sim.rollout(self.x0, self.us).states
        tape.backward(grads={states: self.ones})
        return [states, self.x0.grad, self.us.grad]

    def taped_steps(self) -> list[Any]:
        """Three steps on a tape and their backward passes."""
        self.x0.grad.zero_()
        self.one.grad.zero_()
        state = self.x0
        with wp.Tape() as tape:
            for _ in range(3):
                state = self.sim.step(state, self.one).state
        tape.backward(grads={state: self.after})
        return [state, self.x0.grad, self.one.grad]


def run(setting: Setting, found: Found) -> None:
    """Every kind of call, launched and replayed from two starts."""
    for dtype in setting.sizes.dtypes:
        arrays = Arrays(setting, dtype)
        for call in (arrays.step, arrays.rollout, arrays.gradient, arrays.taped_steps):
            name = f"{call.__name__.replace('_', ' ')}, {dtype}"
            try:
                same, moved = replayed(setting, arrays, call)
            except Exception as error:
                found.check(f"{name}: captured", False, error=f"{type(error).__name__}: {error}")
                continue
            found.check(f"{name}: a replay has the bits of the launches", same)
            found.check(f"{name}: and follows its arrays", moved)


def replayed(setting: Setting, arrays: Arrays, call: Call) -> tuple[bool, bool]:
    """Whether replays from two starts have the bits of launches, and differ from each other."""
    plain = []
    for second in (False, True):
        arrays.start(second)
        plain.append([a.numpy().copy() for a in call()])
    with wp.ScopedCapture(device=setting.device) as capture:
        outputs = call()
    same = True
    for second, want in zip((False, True), plain):
        arrays.start(second)
        wp.capture_launch(capture.graph)
        got = [a.numpy() for a in outputs]
        same &= all(np.array_equal(a, b, equal_nan=True) for a, b in zip(got, want))
    return same, not np.array_equal(plain[0][0], plain[1][0])
