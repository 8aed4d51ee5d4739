"""`slcp bench kernels`: registers, compile and step time of both strategies over the size of a scene.

Also what a step costs as rows come within reach.

Scenes are chains of nv revolute links that lie on the ground with nc rows of contact (frictional pairs of two
rows, and one frictionless pair if nc is odd), so that M is full and every row acts: the worst case of a size.
"""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from rich.console import Console
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.kernels.contact.problem import COLD
from slcp_warp.kernels.device.cache import load
from slcp_warp.kernels.generic import step as generic_step
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP
from slcp_warp.kernels.step import rollout

from ..shared.machine import machine
from ..shared.ours import cpu_threads
from ..shared.scenes import beam_on_supports, chain_on_ground
from ..shared.workload import make_workload
from .cubin import sm90_resources

Rows = list[dict[str, Any]]
SIZES = ((1, 1), (3, 0), (3, 4), (3, 8), (6, 6), (6, 12), (10, 10), (10, 20), (10, 30))


def step_time(sim: slcp.Simulator, worlds: int, steps: int, repeats: int) -> tuple[float, float]:
    """CPU seconds of a step from the scene's own state, in rollouts on one thread, and the unsolved share."""
    rng = np.random.default_rng(0)
    kind = wp.dtype_to_numpy(sim.dtype)
    x = (sim.scene.x0 + 1e-4 * rng.standard_normal((worlds, sim.nx))).astype(kind)
    controls = np.zeros((worlds, steps, sim.nu), kind)
    best, unsolved = np.inf, 0.0
    with cpu_threads(1):
        for _ in range(repeats):
            begin = time.process_time()
            done = sim.rollout(x, controls)
            best = min(best, time.process_time() - begin)
            unsolved = float((done.status != slcp.Status.SOLVED).mean())
    return best / (worlds * steps), unsolved


def rollout_kernel(sim: slcp.Simulator) -> wp.Kernel:
    """The kernel of an open-loop rollout without recorded gaps."""
    if sim.strategy == "generic":
        residual = generic_step.residual_of(sim.options.method, sim.nr)
        return generic_step.make_rollout_kernel(sim.dtype, residual)
    return rollout.make_rollout_kernel(sim.spec, OPEN_LOOP, False)


def bench_sizes(
    sizes: tuple[tuple[int, int], ...] = SIZES,
    dtypes: tuple[str, ...] = ("float32",),
    worlds: int = 64,
    steps: int = 50,
    repeats: int = 3,
    gpu_code: bool = True,
) -> Rows:
    """Both strategies over sizes (nv, nc); a kernel that serves several is compiled for sm_90 once."""
    out: Rows = []
    compiled: dict[wp.Kernel, dict[str, Any]] = {}
    for dtype in dtypes:
        for nv, nc in sizes:
            for strategy in ("specialised", "generic"):
                sim = slcp.Simulator(chain_on_ground(nv, nc), device="cpu", dtype=dtype, strategy=strategy)
                row: dict[str, Any] = {
                    "benchmark": "kernels",
                    "strategy": strategy,
                    "dtype": dtype,
                    "nv": nv,
                    "nc": nc,
                }
                kernel = rollout_kernel(sim)
                begin = time.process_time()
                load(kernel, sim.device)
                row["compile_seconds"] = time.process_time() - begin
                row["seconds"], row["unsolved"] = step_time(sim, worlds, steps, repeats)
                if gpu_code and kernel not in compiled:
                    begin = time.process_time()
                    with tempfile.TemporaryDirectory() as folder:
                        compiled[kernel] = dict(sm90_resources(kernel, Path(folder)))
                    compiled[kernel]["compile_sm90_seconds"] = time.process_time() - begin
                row |= compiled.get(kernel, {})
                out.append(row | machine())
                print_row(row)
    return out


def bench_reach(supports: int = 8, worlds: int = 500, repeats: int = 5, dtype: str = "float32") -> Rows:
    """A step as rows come within reach: the finger free, at its limits, touching; a beam on its supports."""
    out: Rows = []
    for strategy in ("specialised", "generic"):
        finger = slcp.scenes.flicking_finger()
        sim = slcp.Simulator(finger, device="cpu", dtype=dtype, strategy=strategy)
        for name, x in finger_states(sim, worlds, seed=0).items():
            out.append(reach_row(sim, f"finger, {name}", x, repeats))
        for near in range(0, supports + 1, 2):
            scene = beam_on_supports(supports, near)
            sim = slcp.Simulator(scene, device="cpu", dtype=dtype, strategy=strategy)
            x = np.tile(scene.x0, (worlds, 1))
            out.append(reach_row(sim, f"beam, {near} of {supports} supports near", x, repeats))
    return out


def finger_states(sim: slcp.Simulator, worlds: int, seed: int) -> dict[str, np.ndarray]:
    """States (worlds, nx) in which no row acts, limits only, or the contact."""
    x = make_workload(sim.scene, 40 * worlds, 1, seed).x0.astype(wp.dtype_to_numpy(sim.dtype))
    acting = sim.step(x).multiplier[:, : sim.nr] < 0.5 * COLD
    contact = np.array([row.kind == "contact" for row in sim.scene.structure.rows])
    touching, limited = acting[:, contact].any(axis=1), acting[:, ~contact].any(axis=1)
    kinds = {"free": ~touching & ~limited, "limits": ~touching & limited, "touching": touching}
    return {name: x[np.resize(np.flatnonzero(chosen), worlds)] for name, chosen in kinds.items()}


def reach_row(sim: slcp.Simulator, case: str, x: np.ndarray, repeats: int) -> dict[str, Any]:
    """One step of every state on one thread: its time and the mean number of rows in the system."""
    x = x.astype(wp.dtype_to_numpy(sim.dtype))
    controls = np.zeros((len(x), 1, sim.nu), x.dtype)
    acting = float((sim.step(x).multiplier[:, : sim.nr] < 0.5 * COLD).sum(axis=1).mean())
    seconds = np.inf
    with cpu_threads(1):
        for _ in range(repeats + 1):
            begin = time.process_time()
            sim.rollout(x, controls)
            seconds = min(seconds, (time.process_time() - begin) / len(x))
    row = {"benchmark": "reach", "case": case, "strategy": sim.strategy, "nv": sim.scene.nv, "nc": sim.nr,
           "acting": acting, "seconds": seconds}  # fmt: skip
    print_row(row)
    return row | machine()


def print_row(row: dict[str, Any]) -> None:
    """One line as soon as it is measured."""
    shown = {k: v for k, v in row.items() if k not in ("benchmark",)}
    text = "  ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in shown.items())
    Console().print(text, highlight=False, soft_wrap=True)


def print_sizes(rows: Rows) -> None:
    """The table of sizes."""
    table = Table("nv, nc", "strategy", "dtype", "us a step", "compile, s", "sm_90 registers", "local bytes",
                  "code, kB", "sm_90 compile, s", title="kernels by size: CPU time, one thread")  # fmt: skip
    for r in rows:
        cells = [f"{r['nv']}, {r['nc']}", r["strategy"], r["dtype"], f"{1e6 * r['seconds']:.2f}",
                 f"{r['compile_seconds']:.1f}"]  # fmt: skip
        if "registers" in r:
            cells += [str(r["registers"]), str(r["frame"]), f"{r['code'] / 1000:.0f}",
                      f"{r['compile_sm90_seconds']:.1f}"]  # fmt: skip
        table.add_row(*cells)
    Console().print(table)
