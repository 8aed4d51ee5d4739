"""World steps a second over worlds and over threads of a block, and what of a call is Python's."""

import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp
from slcp_warp.kernels.device import cache

from ..record import Found
from ..setting import SINGLE, Setting
from ..timing import seconds
from ..uses import threads_of_a_block

PATIENCE = 45.0  # seconds after which no larger batch is begun
DIFFERENT = 4096  # worlds that differ; larger batches repeat them
METHODS = ("smoothed", "hard")


def arrays(setting: Setting, sim: slcp.Simulator, worlds: int) -> tuple[Any, Any]:
    """Starts and controls of rollouts on the device."""
    work = setting.workload(min(worlds, DIFFERENT), setting.sizes.steps)
    kind: Any = {"dtype": sim.dtype, "device": setting.device}
    every = np.arange(worlds) % len(work.x0)
    return wp.array(work.x0[every], **kind), wp.array(work.controls[every], **kind)


def run(setting: Setting, found: Found) -> None:
    """Open-loop rollouts from random legal states, arrays on the device, recorded states included."""
    setting.keep_memory()
    begin = time.monotonic()
    for worlds in setting.sizes.worlds:
        for method, dtype in _kinds(setting):
            if time.monotonic() - begin > PATIENCE:
                found.note(f"no time for {worlds} worlds, {method}, {dtype}")
                continue
            sim = setting.finger(dtype, method)
            x, us = arrays(setting, sim, worlds)
            middle, least = seconds(setting, partial(sim.rollout, x, us))
            count = worlds * setting.sizes.steps
            found.row(f"{method}, {dtype}, {worlds} worlds", method=method, dtype=dtype, worlds=worlds,
                      rate=count / middle, best_rate=count / least, seconds=middle)  # fmt: skip


def _kinds(setting: Setting) -> Iterator[tuple[str, str]]:
    for dtype in reversed(setting.sizes.dtypes):
        for method in METHODS if dtype == SINGLE else METHODS[:1]:
            yield method, dtype


def blocks(setting: Setting, found: Found) -> None:
    """Rollouts with other threads of a block than the package's own, at a few batches."""
    setting.keep_memory()
    sim = setting.finger(SINGLE)
    own = cache.BLOCK
    for block in setting.sizes.blocks:
        for worlds in setting.sizes.worlds[::-4]:
            case = f"blocks of {block}, {worlds} worlds"
            x, us = arrays(setting, sim, worlds)
            try:
                with threads_of_a_block(setting.device, block):
                    middle, least = seconds(setting, partial(sim.rollout, x, us))
            except Exception as error:
                found.row(case, error=f"{type(error).__name__}: {error}")
                continue
            count = worlds * us.shape[1]
            found.row(case, block=block, own=block == own, worlds=worlds, rate=count / middle,
                      best_rate=count / least)  # fmt: skip


def host(setting: Setting, found: Found) -> None:
    """A step and a rollout of one world and of many: called with NumPy arrays, Warp's, and as a graph."""
    setting.keep_memory()
    dtype = setting.sizes.dtypes[-1]
    sim = setting.finger(dtype)
    for worlds in (1, min(4096, setting.sizes.worlds[-1])):
        x, us = arrays(setting, sim, worlds)
        u: Any = wp.clone(us[:, 0])
        given = [a.numpy().copy() for a in (x, u, us)]
        calls: dict[str, tuple[Any, Any]] = {
            "a step": (partial(sim.step, x, u), partial(sim.step, given[0], given[1])),
            "a rollout": (partial(sim.rollout, x, us), partial(sim.rollout, given[0], given[2])),
        }
        for name, (on_device, from_numpy) in calls.items():
            direct, copied = (seconds(setting, call)[0] for call in (on_device, from_numpy))
            with wp.ScopedCapture(device=setting.device) as capture:
                kept = on_device()
            replayed = seconds(setting, partial(wp.capture_launch, capture.graph))[0]
            del kept
            found.row(f"{name} of {worlds} worlds", numpy_us=1e6 * copied, warp_us=1e6 * direct,
                      graph_us=1e6 * replayed, host_share=max(0.0, 1.0 - replayed / direct))  # fmt: skip
