"""The quickstart's report.md: the numbers, the pictures, and where things are."""

import os
import platform
from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.storage.files import write_text

from ..stages.sweep import case_name, percent, plus_minus
from ..support.records import Record

AIM = 0.9  # share of worlds that must spin faster than the threshold
CAPTIONS = {
    "surface.png": "The contact surface d(q) = 0 in configuration space (the paper's Fig. 2).",
    "library.png": "Where the library's controllers were planned (Fig. 3).",
    "cycle_cycle.png": "The controlled hard system at h = .03, coloured by contact impulse (Fig. 4).",
    "cycle_frames.png": "Frames of its last half turn (Fig. 5).",
    "cycle.gif": "The same system in real time.",
    "plan.png": "DDP from the canonical start.",
    "sweep.png": "The sweep from the limit cycle with kicked velocities.",
    "disturbed.png": "The same with perturbed parameters, torque noise and a second kick half way.",
    "size.png": "The rate against the size of the library.",
}


def write_report(
    path: Path,
    plan: Record,
    library: ddp.Library,
    sweeps: list[slcp.SweepReport],
    pictures: list[Path],
    times: dict[str, float],
) -> Path:
    """Write the report; pictures are linked relative to it."""
    parts = [
        "# slcp-warp: the flicking finger, from one start to a robustness report",
        "",
        _machine(sweeps[0]),
    ]
    parts += ["", "## Trajectory", "", *_plan_lines(plan)]
    parts += ["", "## Library", "", *_library_lines(library)]
    parts += [
        "",
        "## Robustness",
        "",
        *_sweep_lines(sweeps[0], "Started on the limit cycle, velocities kicked"),
    ]
    parts += ["", *_sweep_lines(sweeps[1], "Also with perturbed parameters, torque noise and a second kick")]
    parts += ["", "## Pictures", ""]
    for picture in pictures:
        caption = CAPTIONS.get(picture.name, picture.name)
        parts += [f"![{caption}]({picture.relative_to(path.parent).as_posix()})", "", caption, ""]
    parts += [
        "## Where things are",
        "",
        *_files(path.parent),
        "",
        "## Time",
        "",
        "| stage | seconds |",
        "|---|---:|",
    ]
    parts += [f"| {name} | {seconds:.1f} |" for name, seconds in times.items()]
    parts += ["", "Stages include the compilation of their kernels where these were not cached."]
    write_text(path, "\n".join(parts) + "\n")
    return path


def _machine(report: slcp.SweepReport) -> str:
    where = f"{report.spec['device']}, {os.cpu_count()} cores, {platform.machine()}"
    return f"slcp-warp {slcp.__version__} on {where}; seed {report.spec['seed']}."


def _plan_lines(plan: Record) -> list[str]:
    tried = len(plan["batch_cost"]) if "batch_cost" in plan.arrays else 1
    settled = int((plan["batch_status"] == ddp.Status.CONVERGED).sum()) if tried > 1 else 1
    reductions = plan["trace_reduction"][np.isfinite(plan["trace_reduction"])]
    tail = ", ".join(f"{value:.1e}" for value in reductions[-4:])
    meaning = ddp.Status(int(plan["status"])).explanation
    return [
        f"The best of {tried} starts and schedules from the canonical start ({settled} converged): cost "
        f"**{float(plan['cost']):.3f}** after {int(plan['iterations'])} passes; largest |Q_u| "
        f"{float(plan['gradient']):.1e}, Q_uu {'' if plan['min_pivot'] > 0 else 'not '}positive definite "
        f"({meaning}). Last improvements: {tail}."
    ]  # fmt: skip


def _library_lines(library: ddp.Library) -> list[str]:
    first = library.age == 0
    low, middle, high = np.quantile(library.gain[first], (0.1, 0.5, 0.9))
    return [
        f"{len(library)} local controllers from {int(first.sum())} plans (sigma = "
        f"{library.header['sigma']:g}, h = {library.header['step_size']:g}); a plan saves "
        f"{middle:.0f} against zero torque (median; 10 % below {low:.0f}, 10 % above {high:.0f})."
    ]


def _sweep_lines(report: slcp.SweepReport, title: str) -> list[str]:
    spec, threshold = report.spec, f"{report.spec['threshold']:g}"
    good = all(case["share_above"][0] >= AIM for case in report.cases)
    rows = [
        f"{title}: {report.cases[0]['worlds']} worlds per case, {spec['duration']:g} s, intervals of 95 %.",
        "",
        f"| case | mean rate [rad/s] | > {threshold} [%] | second half [%] | spinning again [%] | failed |",
        "|---|---|---|---|---|---:|",
    ]
    rows += [_sweep_row(case) for case in report.cases]
    verdict = "reached" if good else "**not reached**"
    return [
        *rows,
        "",
        f"At least {AIM:.0%} of the worlds above {threshold} rad/s in every case: {verdict}.",
    ]


def _sweep_row(case: dict[str, Any]) -> str:
    shares = " | ".join(percent(case[k]) for k in ("share_above", "share_spinning", "share_recovered"))
    failed = case["worlds"] - case["statuses"]["SOLVED"]
    return f"| {case_name(case)} | {plus_minus(case['mean_rate'])} | {shares} | {failed} |"


def _files(folder: Path) -> list[str]:
    meanings = {
        "plan.npz": "the trajectory with its gains and trace",
        "library.npz": "the library; `slcp simulate --policy` and `slcp sweep --policy` take it",
        "starts.npz": "smoothed worlds on the limit cycle, from which the sweeps draw their starts",
        "cycle.npz": "a controlled hard world, the one of median turn of 64",
        "surface.npz": "signed distances on a grid",
        "sweep.csv": "a row per world; sweep.npz also holds the angles over time",
        "disturbed.csv": "the same for the second sweep",
        "size.csv": "robustness by number of plans",
    }
    data = folder / "data"
    return [f"- `data/{name}`: {text}" for name, text in meanings.items() if (data / name).exists()]
