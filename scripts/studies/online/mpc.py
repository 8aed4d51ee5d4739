"""`slcp paper mpc`: what a cycle of model predictive control costs, and what it is worth, on the finger."""

import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import warp as wp

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ensembles.statistics import mean_interval, share_interval

from ...support.options import Seed
from ...support.screen import console, one_line_errors, show_rows
from ...support.tables import write_csv

SPINNING = 0.5  # rad/s
KICK = 2.0  # standard deviation of the start's velocities [rad/s]
OWN = ("shift", "library")
BASE: dict[str, Any] = {"passes": 2, "starts": OWN, "improved": 2}
POINTS: dict[str, dict[str, Any]] = {  # name -> what differs from BASE
    "2 passes": {},
    "real-time iteration": {"passes": 0, "starts": ("shift", "keep", "library"), "improved": 1},
    "1 pass": {"passes": 1},
    "5 passes": {"passes": 5},
    "10 passes": {"passes": 10},
    "10 passes every 4th step": {"passes": 10, "replan": 4},
    "2 passes every 2nd step": {"replan": 2},
    "2 passes, a step late": {"replan": 2, "delay": 1},
    "shift alone": {"starts": ("shift",), "improved": 1},
    "shift and zero": {"starts": ("shift", "zero")},
    "best start only": {"improved": 1},
    "with noise": {"starts": (*OWN, "noise"), "improved": 3},
    "with noise, sigma 0.2": {"starts": (*OWN, "noise"), "improved": 3, "sigma": 0.2},
    "sigma 0.05": {"sigma": 0.05},
    "Gauss-Newton": {"options": ddp.Options(method="gauss-newton")},
    "horizon 25": {"horizon": 25},
    "horizon 50": {"horizon": 50},
    "horizon 100": {"horizon": 100},
    "float32": {"dtype": "float32"},
    "64 samples": {"passes": 0, "starts": (ddp.Sampling(samples=64, iterations=1),), "improved": 1},
    "256 samples": {"passes": 0, "starts": (ddp.Sampling(samples=256, iterations=1),), "improved": 1},
    "64 samples, 2 passes": {"starts": ("shift", ddp.Sampling(samples=64, iterations=1))},
    "30 % more mass": {"mass": 1.3},
}


Rates = dict[str, np.ndarray]  # by policy: of every world
BESIDE = "library"


def planner(point: dict[str, Any], library: ddp.Library) -> ddp.MPC:
    """The policy of a point."""
    given = BASE | point
    task = slcp.tasks.flicking_finger()
    sim = task.simulator(dtype=given.pop("dtype", "float64"))
    problem = ddp.Problem(sim, task.cost, given.pop("horizon", task.horizon))
    if "mass" in given:
        factor = given.pop("mass")
        own = problem.params
        problem = problem.with_params(mass=factor * own["mass"], inertia=factor * own["inertia"])
    return ddp.MPC(problem, library if "library" in given["starts"] else None, **given)


def ratio_interval(a: np.ndarray, b: np.ndarray) -> tuple[float, float, float]:
    """Mean of a over mean of b in the same worlds, with its 95 % interval (of a linearised ratio)."""
    both = np.isfinite(a) & np.isfinite(b)
    ratio = float(a[both].mean() / b[both].mean())
    off = np.array(mean_interval(a[both] - ratio * b[both])) / float(b[both].mean())
    low, high = sorted(float(ratio + each) for each in off[1:])
    return ratio, low, high


def row(
    name: str, policy: Any, task: slcp.Task, worlds: int, seconds: float, seed: int, rates: Rates
) -> dict[str, Any]:
    """Rate of the ellipse on the hard system in kicked worlds, and CPU time a world and step.

    The worlds' rates are added to `rates`, which has the library's, or gets them first.
    """
    plant = task.simulator(slcp.Options("hard", "none"))
    x0 = np.repeat(task.start[:1], worlds, axis=0)
    x0[:, 3:] += KICK * np.random.default_rng(seed).standard_normal((worlds, 3))
    plant.rollout(x0[:1], policy=policy, steps=2)  # compiles
    steps = round(seconds / task.scene.step_size)
    began = time.process_time()
    run = plant.rollout(x0, policy=policy, steps=steps)
    cost = (time.process_time() - began) / steps / worlds
    rate = np.where(run.status == 0, (run.states[:, -1, 2] - x0[:, 2]) / seconds, np.nan)
    rates[name] = rate
    mean, share = mean_interval(rate), share_interval(int((rate > SPINNING).sum()), worlds)
    more = ratio_interval(rate, rates[BESIDE])
    found = {"policy": name, "ms a step": 1e3 * cost, "rate": mean[0], "low": mean[1], "high": mean[2]}
    found |= {"times the library": more[0], "times low": more[1], "times high": more[2]}
    found |= {"above 0.5 rad/s": share[0], "share low": share[1], "share high": share[2]}
    late = np.quantile(policy.seconds, 0.99) * 1e3 if worlds == 1 and hasattr(policy, "seconds") else np.nan
    return found | {"cycle ms, 99 %": late, "failures": getattr(policy, "failures", 0), "worlds": worlds}


@one_line_errors
def mpc_command(
    library: Annotated[Path, typer.Option(help="File of `slcp library flicking_finger`.")],
    worlds: Annotated[int, typer.Option(min=1, help="Kicked worlds of a point.")] = 256,
    seconds: Annotated[float, typer.Option(min=0.1, help="Simulated time of a world [s].")] = 10.0,
    only: Annotated[list[str] | None, typer.Option(help="Points by name (repeatable); all.")] = None,
    seed: Seed = 0,
    csv: Annotated[Path | None, typer.Option(help="Also write the table here.")] = None,
    chart: Annotated[Path | None, typer.Option(help="Draw rate against time a cycle (.png).")] = None,
) -> None:
    """Model predictive control of the finger on hard contact: rate against time a cycle."""
    entries, task = ddp.Library.load(library), slcp.tasks.flicking_finger()
    entries.check_scene(task.scene)
    unknown = set(only or ()) - set(POINTS)
    if unknown:
        raise ValueError(f"--only names {sorted(unknown)}; there are {', '.join(POINTS)}")
    rates: Rates = {}
    rows = [row(BESIDE, entries.policy(), task, worlds, seconds, seed, rates)]
    for name in only or POINTS:
        rows.append(row(name, planner(POINTS[name], entries), task, worlds, seconds, seed, rates))
        console.print(f"[dim]{name}: {rows[-1]['rate']:.3f} rad/s, {rows[-1]['ms a step']:.2f} ms[/dim]")
    show_rows(f"{worlds} kicked worlds, {seconds:g} s, hard contact; {wp.get_device('cpu')}", rows)
    if csv is not None:
        write_csv(csv, rows)
    if chart is not None:
        from .mpc_chart import mpc_chart

        typer.echo(f"wrote {mpc_chart(chart, rows)}")
