"""Study "scaling", the peers: steps a second of the finger against the number of worlds in a call.

The workload is that of scaling.py: random legal states, h = .05, random torques, STEPS steps a call,
copies from and to NumPy included, kernels compiled before. MuJoCo C runs with one and with all threads. The
torques of MJX and mujoco_warp are held over a call.
"""

import functools
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp.kernels.device import launch

from ..peers.mjx import MJX
from ..peers.mujoco import MuJoCo
from ..peers.mujoco_model import Peer as Model
from ..peers.mujoco_warp import MuJoCoWarp, Worlds
from ..peers.peer import installed
from ..shared.rows import Rows, Say, repeated, report, timed, timed_once
from ..shared.timing import Case
from ..shared.workload import Workload, make_workload

STEPS = 10  # a call
BATCHES = (1, 10, 100, 1000, 10_000)
COMPILED = (1, 100)  # of MJX, which compiles for every size
ON_GPU = (1, 10, 100, 1000, 10_000, 100_000)
REPEATS = 3
SLOW = 0.5  # seconds from which a call is timed once
Array = np.ndarray
Calls = Iterator[tuple[str, int, int | None, Callable[[], Any]]]  # curve, batch, threads, call


def mujoco_calls(work: Workload) -> Calls:
    """MuJoCo C on one thread and on all."""
    scene = slcp.scenes.flicking_finger()
    for threads in sorted({1, launch.thread_count()}):
        model = Model(scene, threads)
        name = f"MuJoCo, {threads} thread{'s' * (threads > 1)}"
        for batch in BATCHES:
            part = Workload(work.x0[:batch], work.controls[:batch])
            yield name, batch, threads, functools.partial(model.rollout, part)


def mujoco_warp_calls(peer: MuJoCoWarp, work: Workload) -> Calls:
    """mujoco_warp on its device."""
    scene = slcp.scenes.flicking_finger()
    model = Model(scene).model
    for batch in BATCHES if peer.device.is_cpu else ON_GPU:
        worlds = Worlds(peer.module, model, batch, peer.device)
        index = np.arange(batch) % len(work.x0)
        x, u = work.x0[index], work.controls[index, 0]

        def call(worlds: Worlds = worlds, x: Array = x, u: Array = u) -> Array:
            worlds.set(x, u)
            for _ in range(STEPS):
                worlds.step()
            return worlds.states()

        yield f"mujoco_warp, {peer.device}", batch, 1 if peer.device.is_cpu else None, call


def mjx_calls(peer: MJX, work: Workload) -> Calls:
    """MJX on JAX's device, all threads."""
    scene = slcp.scenes.flicking_finger()
    for batch in COMPILED:
        call = peer.stepper(scene, scene.step_size, work.x0[:batch], work.controls[:batch, 0], STEPS)
        yield f"MJX, {peer.jax.default_backend()}", batch, None, call


def rows(say: Say) -> Rows:
    """A row for every peer that is installed and number of worlds."""
    work = make_workload(slcp.scenes.flicking_finger(), max(BATCHES), STEPS, 0)
    programs: tuple[tuple[Callable[[], Any], Callable[[Any], Calls]], ...] = (
        (MuJoCo, lambda _: mujoco_calls(work)),
        (MuJoCoWarp, lambda peer: mujoco_warp_calls(peer, work)),
        (MJX, lambda peer: mjx_calls(peer, work)),
    )
    out: Rows = []
    for make, calls in programs:
        for peer in installed((make,), say):
            out += [row(peer, *call) for call in calls(peer)]
    return report(say, out, "curve", "batch", "rate")


def row(peer: Any, curve: str, batch: int, threads: int | None, call: Callable[[], Any]) -> dict[str, Any]:
    """The row of one number of worlds; one thread by CPU time, more by wall time, as ours."""
    call()
    begin = time.perf_counter()
    call()
    slow = time.perf_counter() - begin > SLOW
    run, times = (call, 1) if slow else repeated(call)
    device = str(getattr(peer, "device", "cpu"))
    facts = {
        "study": "scaling", "problem": "finger, steps", "program": peer.name, "version": peer.version,
        "curve": curve, "knob": "batch", "value": batch, "batch": batch, "threads": threads or "",
        "device": device, "cost_of": "step", "h": 0.05,
    }  # fmt: skip
    case = Case(curve, run, batch * STEPS * times, facts=facts)
    found = timed_once(case, threads) if slow else timed([case], REPEATS, threads)[0]
    return found | {"rate": 1.0 / found["seconds"]}
