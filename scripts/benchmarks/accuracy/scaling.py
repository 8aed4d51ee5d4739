"""Study "scaling": steps a second against batch, degrees of freedom and contacts; passes of DDP; worlds.

Beside every measured point stands what the counted operations and bytes would take at the machine's peaks
(roofline.py). Calls from Python with NumPy arrays, copies included, STEPS steps a call; kernels are
compiled before. A GPU joins where one is present.
"""

import functools
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.kernels.device import launch
from slcp_warp.kernels.residual.smoothing import CUT

from ..mechanics.scene import distance
from ..shared.ours import PAPER
from ..shared.rows import Rows, Say, repeated, report, timed, timed_once
from ..shared.scenes import chain_on_ground
from ..shared.timing import Case
from ..shared.workload import make_workload
from .roofline import Work, pass_work, peak, step_work
from .sweep import controller, kicked, run_sweep

STEPS = 10  # a call
BATCHES = (1, 10, 100, 1000, 10_000, 100_000, 1_000_000)
LEVERS = np.array([3.2, 1.6, 0.7])  # [m] by which the finger's speeds bound an approach
SAMPLE = 2000  # states at which the pair's distance is looked at
LARGE = 100_000  # from here on a call is long enough to be timed alone, beyond to be timed once
CHAINS = {  # by strategy: degrees of freedom at ROWS rows, and rows at LINKS degrees of freedom
    "specialised": ((1, 2, 3, 5), (0, 2, 4, 8)),
    "generic": ((1, 2, 3, 5, 8, 16, 30), (0, 2, 4, 8, 14, 30, 60)),
}
ROWS, LINKS = 4, 3
PROBLEMS = (1, 4, 16, 64, 256)
WORLDS = (64, 1024, 16_384)
PASSES = 10
HORIZON = 75


def devices() -> list[str]:
    """Every device that Warp sees."""
    return [device.alias for device in wp.get_devices()]


def thread_counts(device: str) -> list[int | None]:
    """One and all threads of a CPU; a GPU has no choice."""
    if not wp.get_device(device).is_cpu:
        return [None]
    return [1, launch.thread_count()] if launch.thread_count() > 1 else [1]


def point(
    case: str, knob: str, value: float, work: Work, device: str, threads: int | None, **facts: Any
) -> dict[str, Any]:
    """The columns of a case before it is timed."""
    counted = peak(device).roofline(work, threads or 1)
    return {
        "study": "scaling", "problem": case, "program": "slcp-warp", "knob": knob, "value": value,
        "device": device, "threads": threads or "", **counted, **facts,
    }  # fmt: skip


def with_fraction(rows: Rows) -> Rows:
    """Rows with the rate and the fraction of the roofline that was reached."""
    for row in rows:
        row["rate"] = 1.0 / row["seconds"]
        row["fraction"] = row["roofline_seconds"] / row["seconds"]
    return rows


def acting(sim: slcp.Simulator, x: np.ndarray, u: np.ndarray) -> tuple[float, float]:
    """Mean rows in the Newton system of a step, and share of solved worlds.

    The worlds start from x (B, nx) under u (B, N, nu). Smoothed impulses are positive, those of rows left out
    are zero.
    """
    done = sim.rollout(x, u, record=("impulse",))
    return float((done.impulse > 0.0).sum(axis=2).mean()), float((done.status == slcp.Status.SOLVED).mean())


def finger_work(sim: slcp.Simulator, x: np.ndarray, u: np.ndarray) -> Work:
    """A step of the finger on the way from x (B, nx) under u (B, N, nu), by its rows and its near pairs."""
    kind = wp.dtype_to_numpy(sim.dtype)
    x, u = x.astype(kind), u.astype(kind)
    rows_in, _ = acting(sim, x, u)
    way = sim.rollout(x, u).states[:, :-1].reshape(-1, sim.nx).astype(float)
    way = way[:: max(1, len(way) // SAMPLE)]
    speed = np.abs(way[:, 3:]) @ LEVERS
    reach = speed + CUT["logistic", wp.float32] * sim.scene.sigma
    near = float((distance(sim.scene, way[:, :3]) <= sim.scene.step_size * reach).mean())
    return step_work(3, rows_in, 2, ellipses=1, near=near, size=np.dtype(kind).itemsize)


def planned_work(sim: slcp.Simulator) -> Work:
    """A step of the finger along its plan."""
    return finger_work(sim, sim.scene.x0[None], controller().us)


def against_batch(batches: tuple[int, ...], repeats: int, dtype: str = "float32") -> Rows:
    """The finger from random legal states under random torques."""
    scene = slcp.scenes.flicking_finger()
    some = make_workload(scene, min(max(batches), 10_000), STEPS, 0)
    rows = []
    for device in devices():
        sim = slcp.Simulator(scene, PAPER, device=device, dtype=dtype)
        kind = wp.dtype_to_numpy(sim.dtype)
        work = finger_work(sim, some.x0[:1000], some.controls[:1000])
        for threads in thread_counts(device):
            for batch in batches:
                index = np.arange(batch) % len(some.x0)
                x, u = some.x0[index].astype(kind), some.controls[index].astype(kind)
                call = functools.partial(sim.rollout, x, u, sim.params)
                run, times = repeated(call) if batch < LARGE else (call, 1)
                name = f"finger, {dtype}, {device}" + (
                    f", {threads} thread{'s' * (threads > 1)}" if threads else ""
                )
                facts = point("finger, steps", "batch", batch, work, device, threads, dtype=dtype, curve=name,
                              batch=batch, cost_of="step", residual=PAPER.residual, h=scene.step_size,
                              sigma=scene.sigma)  # fmt: skip
                case = Case(name, run, batch * STEPS * times, facts=facts)
                rows += timed([case], repeats, threads) if batch <= LARGE else [timed_once(case, threads)]
    return with_fraction(rows)


def against_size(sizes: dict[str, list[tuple[int, int]]], knob: str, repeats: int, worlds: int = 200) -> Rows:
    """Chains on the ground under rows of contact, one thread: (nv, rows) by strategy."""
    cases = []
    for strategy, chosen in sizes.items():
        for nv, rows in chosen:
            sim = slcp.Simulator(chain_on_ground(nv, rows), device="cpu", dtype="float32", strategy=strategy)
            rng = np.random.default_rng(0)
            x = (sim.scene.x0 + 1e-4 * rng.standard_normal((worlds, sim.nx))).astype(np.float32)
            u = np.zeros((worlds, STEPS, sim.nu), np.float32)
            rows_in, solved = acting(sim, x, u)
            work = step_work(nv, rows_in, pairs=-(-rows // 2))
            facts = point(f"chain, steps by {knob}", knob, nv if knob == "nv" else rows, work, "cpu", 1,
                          dtype="float32", curve=strategy, strategy=strategy, batch=worlds, nv=nv,
                          nr=rows, cost_of="step", residual="rem-logistic", h=sim.scene.step_size,
                          sigma=sim.scene.sigma,
                          solved_share=solved)  # fmt: skip
            run = functools.partial(sim.rollout, x, u)
            cases.append(Case(f"{strategy} {nv} {rows}", run, worlds * STEPS, facts=facts))
    return with_fraction(timed(cases, repeats))


def passes(problems: tuple[int, ...], repeats: int, dtype: str = "float32") -> Rows:
    """Passes of second-order DDP on the finger from u = 0, all threads."""
    rows = []
    for device in devices():
        sim = slcp.Simulator(slcp.scenes.flicking_finger(), PAPER, device=device, dtype=dtype)
        problem = ddp.Problem(sim, slcp.tasks.flicking_finger().cost, horizon=HORIZON, params=sim.params)
        options = ddp.Options(max_iterations=PASSES, gradient_tolerance=0.0)
        size = 4 if dtype == "float32" else 8
        work = pass_work(3, 2, HORIZON, len(options.step_sizes), planned_work(sim), 6, size)
        threads = launch.thread_count() if wp.get_device(device).is_cpu else None
        rng = np.random.default_rng(0)
        for count in problems:
            space = ddp.Workspace(problem, count, options)
            us = 0.1 * rng.standard_normal((count, HORIZON, 2))
            run = functools.partial(space.run, sim.scene.x0, us)
            done = run()
            facts = point("finger, passes", "problems", count, work, device, threads, dtype=dtype,
                          curve=f"second-order DDP, {dtype}, {device}", batch=count, cost_of="pass",
                          h=sim.scene.step_size, sigma=sim.scene.sigma)  # fmt: skip
            case = Case(str(count), run, done * count, facts=facts)
            rows += timed([case], repeats, threads) if count <= 16 else [timed_once(case, threads)]
    return with_fraction(rows)


def sweeps(counts: tuple[int, ...], repeats: int, dtype: str = "float32") -> Rows:
    """Kicked worlds of the finger under a small library's controller, all threads."""
    rows = []
    for device in devices():
        threads = launch.thread_count() if wp.get_device(device).is_cpu else None
        step = planned_work(slcp.Simulator(slcp.scenes.flicking_finger(), PAPER, device=device, dtype=dtype))
        for count in counts:
            spec = kicked(count)
            work = step.times(round(spec.duration / spec.step_sizes[0]))
            run = functools.partial(run_sweep, spec, dtype, device)
            facts = point("finger, sweep", "worlds", count, work, device, threads, dtype=dtype,
                          curve=f"sweep, {dtype}, {device}", batch=count, h=spec.step_sizes[0],
                          cost_of=f"world of {spec.duration:g} s")  # fmt: skip
            rows += timed([Case(str(count), run, count, facts=facts)], repeats, threads)
    return with_fraction(rows)


def rows(say: Say) -> Rows:
    """All of the study."""
    shown = ("problem", "curve", "value", "rate", "fraction")
    by_nv = {s: [(nv, ROWS) for nv in sizes] for s, (sizes, _) in CHAINS.items()}
    by_rows = {s: [(LINKS, nr) for nr in sizes] for s, (_, sizes) in CHAINS.items()}
    out = report(say, against_batch(BATCHES, 5), *shown)
    out += report(say, against_size(by_nv, "nv", 3), *shown)
    out += report(say, against_size(by_rows, "nr", 3), *shown)
    out += report(say, passes(PROBLEMS, 5), *shown)
    return out + report(say, sweeps(WORLDS, 3), *shown)
