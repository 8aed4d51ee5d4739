"""`slcp bench kernels --scenes`: both strategies on the named scenes, by which "auto" chooses."""

import tempfile
import time
from typing import Any

import numpy as np
import warp as wp
from rich.console import Console
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.kernels.device.cache import load
from slcp_warp.scenes.registry import NAMED
from slcp_warp.stepping.strategy import STRATEGIES, StrategyError, structure_facts

from ..cost.kernels import rollout_kernel
from ..shared.machine import machine
from ..shared.ours import cpu_threads
from .cost import LAWS

SIZES = {  # scenes that come in sizes, beside their own
    "stack": ({"count": 2}, {"count": 5}),
    "tumbling_boxes": ({"count": 2},),
    "beam": ({"count": 4},),
}
STEPS = 75
SPEED = 0.3  # of the second motion, N(0, SPEED)
Rows = list[dict[str, Any]]


def cases(names: list[str]) -> dict[str, slcp.Scene]:
    """The scenes by name, and with it what sets their size; all without names."""
    found = {}
    for name in names or list(NAMED):
        found[name] = NAMED[name]()
        for given in SIZES.get(name, ()):
            found[f"{name} {', '.join(f'{value}' for value in given.values())}"] = NAMED[name](**given)
    return found


def step_us(sim: slcp.Simulator, speed: float, worlds: int, repeats: int) -> float:
    """CPU us of a step on one thread of worlds that are solved, from the scene's state with N(0, speed)
    added to velocities.
    """
    x = np.tile(np.asarray(sim.scene.x0, float), (worlds, 1))
    x[:, sim.scene.nv :] += speed * np.random.default_rng(3).standard_normal((worlds, sim.scene.nv))
    kind = wp.dtype_to_numpy(sim.dtype)
    x, controls = x.astype(kind), np.zeros((worlds, STEPS, sim.nu), kind)
    best = np.inf
    with cpu_threads(1):
        made = sim.rollout(x, controls).status == slcp.Status.SOLVED
        if not made.any():
            return np.nan
        for _ in range(repeats):
            begin = time.process_time()
            sim.rollout(x[made], controls[made])
            best = min(best, time.process_time() - begin)
    return float(1e6 * best / (made.sum() * STEPS))


def one_case(scene: slcp.Scene, law: str, dtype: str, worlds: int, repeats: int) -> dict[str, Any]:
    """What both strategies take for a scene under a law, and which one "auto" chooses."""
    options = slcp.Options(**LAWS[law])
    row: dict[str, Any] = structure_facts(scene.structure)
    for strategy in STRATEGIES:
        try:
            sim = slcp.Simulator(scene, options, device="cpu", dtype=dtype, strategy=strategy)
        except StrategyError as error:
            row[strategy] = str(error)
            continue
        if strategy == "auto":
            row["auto"] = sim.strategy
            continue
        begin = time.process_time()
        load(rollout_kernel(sim), sim.device)
        row[f"{strategy}_compile"] = time.process_time() - begin
        row[f"{strategy}_rest"] = step_us(sim, 0.0, worlds, repeats)
        row[f"{strategy}_moving"] = step_us(sim, SPEED, worlds, repeats)
    return row


def bench_strategies(names: list[str], dtype: str = "float64", worlds: int = 20, repeats: int = 3) -> Rows:
    """A row a scene and law: us a step at rest and moving, seconds to compile a rollout where no cache is."""
    out: Rows = []
    kept = wp.config.kernel_cache_dir
    with tempfile.TemporaryDirectory() as folder:
        wp.config.kernel_cache_dir = folder
        try:
            for name, scene in cases(names).items():
                for law in LAWS:
                    row: dict[str, Any] = {"benchmark": "strategies", "scene": name, "law": law}
                    out.append(row | one_case(scene, law, dtype, worlds, repeats) | machine())
                    print_strategies(out[-1:])
        finally:
            wp.config.kernel_cache_dir = kept
    return out


def print_strategies(rows: Rows) -> None:
    """The table of scenes, specialised and generic kernels beside each other."""
    table = Table("scene", "nv", "rows", "trees", "law", "at rest, us", "moving, us", "compile, s", "auto")
    for row in rows:
        both = []
        for what in ("rest", "moving", "compile"):
            pair = (row.get(f"{strategy}_{what}", np.nan) for strategy in ("specialised", "generic"))
            both.append(" / ".join(f"{value:.3g}" for value in pair))
        facts = [str(row[key]) for key in ("nv", "rows", "trees")]
        table.add_row(row["scene"], *facts, row["law"], *both, row.get("auto", ""))
    Console().print(table)
