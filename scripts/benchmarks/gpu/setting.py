"""What the check runs on, how much of it, and the simulators that its sections share."""

import functools
import os
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.kernels.device.cache import compiling_for

from ..shared.workload import Workload, make_workload

CPU, FINGER, STACK = "cpu", "flicking_finger", "stack"
METHODS: dict[str, slcp.Options] = {
    "smoothed": slcp.Options(scaling="none"),
    "hard": slcp.Options("hard", scaling="none"),
    "coulomb": slcp.Options("hard", scaling="none", friction="coulomb"),
}
SINGLE, DOUBLE = "float32", "float64"


class NoGpuError(ArgumentError):
    """There is no GPU to check."""


@dataclass(frozen=True)
class Sizes:
    """How much is run.

    Attributes:
        dtypes, methods: precisions, and METHODS of the finger that are compared.
        states: that are stepped, linearised and judged.
        judged: worlds of random numbers that the oracle judges, of each method and precision.
        gradients: worlds whose gradients are compared, over `steps` steps.
        steps: of a timed rollout.
        worlds: batches of timed rollouts.
        blocks: threads of a block that are tried.
        problems: batches of DDP; `horizon` steps, `passes` passes.
        sweep: worlds of a sweep of `duration` [s].
        repeats: of a timing, of which the median counts.
    """

    dtypes: tuple[str, ...] = (DOUBLE, SINGLE)
    methods: tuple[str, ...] = tuple(METHODS)
    states: int = 20_000
    judged: int = 20_000
    gradients: int = 1024
    steps: int = 100
    worlds: tuple[int, ...] = tuple(2**n for n in range(10, 21))
    blocks: tuple[int, ...] = (32, 64, 128)
    problems: tuple[int, ...] = (1, 16, 64, 256, 1024, 4096)
    horizon: int = 75
    passes: int = 10
    sweep: int = 1_000_000
    duration: float = 20.0
    repeats: int = 5


SMALL = Sizes(
    states=60, judged=60, gradients=8, steps=10, worlds=(16, 64), blocks=(), problems=(1, 3),
    passes=3, sweep=20, duration=1.0, repeats=2,
)  # fmt: skip


@dataclass(frozen=True)
class Setting:
    """A device by its name, and sizes.

    Attributes:
        arch: of GPUs for which kernels are compiled, too (90: sm_90).
    """

    device: str
    sizes: Sizes
    seed: int = 0
    arch: int | None = None

    @property
    def gpu(self) -> bool:
        """Whether it is a GPU."""
        return bool(wp.get_device(self.device).is_cuda)

    def finger(self, dtype: str, method: str = "smoothed", device: str | None = None) -> slcp.Simulator:
        """A simulator of the finger, on the device or on another one."""
        return _simulator(FINGER, METHODS[method], device or self.device, dtype)

    def stack(self, dtype: str, device: str | None = None) -> slcp.Simulator:
        """A simulator of three boxes on each other, with generic kernels and hard contact."""
        return _simulator(STACK, slcp.Options("hard"), device or self.device, dtype, "generic")

    def workload(self, worlds: int, steps: int = 1) -> Workload:
        """Random legal states and torques of the finger, exact in single precision."""
        return _workload(worlds, steps, self.seed)

    def near_start(self, count: int) -> np.ndarray:
        """States (count, nx) near the finger's start, where controls are felt; exact in single precision."""
        x0 = slcp.scenes.flicking_finger().x0
        moved = x0 + 0.1 * np.random.default_rng(self.seed).standard_normal((count, len(x0)))
        return np.asarray(moved.astype(np.float32), float)

    def keep_memory(self) -> None:
        """Let a GPU's pool keep half of its memory between calls, which else takes and gives it back."""
        if self.gpu and wp.get_device(self.device).is_mempool_supported:
            wp.set_mempool_release_threshold(self.device, 0.5)

    def wait(self) -> None:
        """Until the device has done what it was given."""
        if self.gpu:
            wp.synchronize_device(self.device)


def chosen(device: str | None, arch: int | None = None) -> Setting:
    """The setting of a device; None: the first GPU. `arch`: see `Setting`.

    Raises:
        NoGpuError: there is none, and no other device was asked for.
        ArgumentError: an unknown device.
        ValueError: a kind of GPU that Warp does not compile for.
    """
    wp.init()
    if arch is not None:
        with compiling_for(arch):
            pass
    if device is None:
        found = [d.alias for d in wp.get_cuda_devices()]
        if not found:
            raise NoGpuError(
                "gpu-check: Warp finds no GPU here; --device cpu runs what a CPU can, at small sizes"
            )
        device = found[0]
    try:
        known = wp.get_device(device)
    except Exception as error:  # Warp's answers to unknown names are of several kinds
        raise ArgumentError(f"--device {device!r}: {error}") from error
    return Setting(known.alias, Sizes() if known.is_cuda else SMALL, arch=arch)


@functools.cache
def _simulator(scene: str, options: slcp.Options, device: str, dtype: str, strategy: str = "auto") -> Any:
    made = slcp.scenes.stack(3) if scene == STACK else slcp.scenes.NAMED[scene]()
    return slcp.Simulator(made, options, device=device, dtype=dtype, strategy=strategy)


@functools.cache
def _workload(worlds: int, steps: int, seed: int) -> Workload:
    work = make_workload(slcp.scenes.flicking_finger(), worlds, steps, seed)
    return Workload(*(a.astype(np.float32).astype(float) for a in (work.x0, work.controls)))


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cast(dtype: str, *arrays: np.ndarray) -> list[np.ndarray]:
    """Arrays of a precision."""
    return [np.ascontiguousarray(a, dtype) for a in arrays]
