"""A policy in many perturbed worlds, on smoothed and hard dynamics."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.ensembles.sweep import sweep_scene
from slcp_warp.storage.printed import percent as percent_of

from ..support.policies import named_policy
from ..support.rules import NO_RULES, Rules
from ..support.simulators import default_scaling, make_simulator


def cycle_states(run: slcp.Trajectory, scene: slcp.Scene, skip: float) -> np.ndarray:
    """States (M, nx) of a trajectory after `skip` seconds, solved worlds only; angles in one period."""
    if scene_digest(run.scene) != scene_digest(scene):
        raise ValueError(f"the start states are of scene {run.scene.name!r}, not {scene.name!r}")
    first = round(skip / run.step_size)
    states = run.states[run.status == slcp.Status.SOLVED][:, first:]
    if not states.size:
        raise ValueError(
            f"no state is left after {skip} s; the trajectory ends earlier, or no world was solved"
        )
    states = states.reshape(-1, states.shape[-1]).astype(float)
    period = scene.state_period
    return np.where(period > 0.0, np.mod(states, np.where(period > 0.0, period, 1.0)), states)


def run_sweep(
    scene: slcp.Scene,
    policy_name: str | Path,
    spec: slcp.SweepSpec,
    rules: Rules = NO_RULES,
    device: str | None = None,
    dtype: str = "float32",
    progress: Callable[[int, int], None] | None = None,
) -> slcp.SweepReport:
    """Sweep a policy by its name or file; the report's `spec` also says which scene and policy they were."""
    method: dict[str, Any] = {"scaling": default_scaling(scene), "integrator": "euler"}
    if others := sorted(set(rules.given) - set(method)):
        raise ValueError(f"--{others[0]} is of a task; a sweep of a scene has {', '.join(method)}")
    method |= rules.given
    policy, facts = named_policy(policy_name, scene, None)
    device = str(make_simulator(scene, device=device, dtype=dtype).device)  # a bad name fails here, clearly
    report = sweep_scene(scene, policy, spec, **method, dtype=dtype, device=device, progress=progress)
    if not report.cases:
        raise KeyboardInterrupt
    report.spec |= {"scene": scene.name, **method, "dtype": dtype, "device": device, **facts}
    return report


def case_name(case: dict[str, Any]) -> str:
    """A case in words: "smoothed, h = 0.05"."""
    kind = "smoothed" if case["residual"] == "rem-logistic" else case["residual"]
    return f"{kind}, h = {case['step_size']:g}"


def percent(values: tuple[float, float, float]) -> str:
    """A share with its interval, in percent: "94.8 [93.3, 96.0]"."""
    share, low, high = map(percent_of, values)
    return f"{share} [{low}, {high}]"


def plus_minus(values: tuple[float, float, float], form: str = ".3f") -> str:
    """A mean with half its interval: "0.760 ± 0.008"."""
    return f"{values[0]:{form}} ± {0.5 * (values[2] - values[1]):{form}}"


def sweep_table(report: slcp.SweepReport) -> Table:
    """The cases with their 95 % confidence intervals."""
    threshold = report.spec["threshold"]
    worlds = sum(case["worlds"] for case in report.cases)
    title = f"{worlds} worlds in {len(report.cases)} cases, 95 % confidence intervals"
    table = Table(title=title, box=SIMPLE_HEAD, padding=0, pad_edge=False, show_edge=False)
    headings = ("case", "mean rate", f"rate > {threshold:g} [%]", "2nd half [%]", "failed")
    for heading in headings:
        width = 18 if heading == "case" else None
        table.add_column(heading, justify="left" if width else "right", no_wrap=True, min_width=width)
    for case in report.cases:
        failed = case["worlds"] - case["statuses"]["SOLVED"]
        table.add_row(
            case_name(case), plus_minus(case["mean_rate"]), percent(case["share_above"]),
            percent(case["share_spinning"]), str(failed),
        )  # fmt: skip
    return table
