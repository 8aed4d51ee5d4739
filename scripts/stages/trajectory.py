"""Worlds over time, open loop or under a policy."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.ensembles.worlds.nominal import nominal
from slcp_warp.inputs.checks import memory, whole
from slcp_warp.inputs.limits import limit_rows
from slcp_warp.inputs.times import nearest_steps
from slcp_warp.measures import Measure, first_time
from slcp_warp.results.overlaps import overlaps
from slcp_warp.stepping.host import acts_on_host

from ..support.asking import watched
from ..support.policies import ZERO, named_policy
from ..support.records import device_facts
from ..support.rules import told
from ..support.screen import waiting

RECORD = ("controls", "impulse", "gap")
MOST = 4  # failed worlds that are named
NEAR = 1e-3  # that touches, more or less [m]


def simulate(
    sim: slcp.Simulator,
    params: slcp.Parameters,
    x0: np.ndarray,
    steps: int,
    policy: str | Path = ZERO,
    recorded: tuple[str, ...] = RECORD,
    task: slcp.Task | None = None,
) -> slcp.Trajectory:
    """Roll the worlds x0 (B, nx) out under a policy.

    Args:
        policy: as the commands name one.
        recorded: of RECORD, with "controls" and "impulse".
        task: of the worlds, where there is one: what it has between a policy and its world and is not drawn
            (observation, delay, hold, control limits) acts as in undisturbed worlds of a sweep.
    """
    whole("--steps", steps)
    memory("--steps", len(x0) * steps * (sim.nx + sim.nu), 8, sim.device)
    if not np.isfinite(x0).all():
        raise ValueError(f"--start contains {x0[~np.isfinite(x0)][0]}; it must be finite")
    facts: dict[str, Any] = {"policy": ZERO}
    if str(policy) == ZERO:
        limits = limit_rows(None if task is None else task.control_limits, sim.nu)
        controls = np.clip(np.zeros((len(x0), steps, sim.nu)), *(side[0] for side in limits))
        trajectory = sim.rollout(x0, controls, params, record=recorded)
    else:
        controller, facts = named_policy(policy, sim.scene, task)
        if task is not None:
            controller = nominal(controller, task, float(np.ravel(params["step_size"])[0]))
        with waiting("simulating") if acts_on_host(controller) else nullcontext(print) as tell:
            name = str(facts["policy"])
            timed = watched({name: controller}, len(x0) * steps, tell)[name]
            trajectory = sim.rollout(x0, policy=timed, steps=steps, params=params, record=recorded)
    return replace(trajectory, header=device_facts(sim) | facts)


def summary(run: slcp.Trajectory) -> Table:
    """First and last state of the first world, and the statuses of all."""
    scene, states, status = run.scene, run.states, run.status
    duration = run.step_size * (states.shape[1] - 1)
    counts = ", ".join(
        f"{n} {slcp.Status(s).name.lower()}" for s, n in zip(*np.unique(status, return_counts=True))
    )
    table = Table(
        title=f"{scene.name}, {', '.join(told(run.options))}, {duration:g} s; worlds: {counts}",
        box=SIMPLE_HEAD,
    )
    table.add_column("first world")
    for name in ("q, start", "q, end", "v, start", "v, end"):
        table.add_column(name, justify="right")
    columns = np.concatenate([states[0, [0, -1], : scene.nv], states[0, [0, -1], scene.nv :]])
    for name, numbers in zip(_freedoms(scene), columns.T):
        table.add_row(name, *(f"{value:.4g}" for value in numbers))
    return table


def judged(run: slcp.Trajectory, task: slcp.Task) -> tuple[Table | None, np.ndarray | None]:
    """What a task says of its own run: its measures, means over the worlds, and which worlds succeed (B,).

    None where the run is not as long as the task's, or the task says nothing of the kind.
    """
    assert task.duration is not None
    steps = nearest_steps("Task.duration", task.duration, run.step_size)
    if run.states.shape[1] - 1 != steps:
        return None, None
    solved = run.recorded("status") == slcp.Status.SOLVED
    good = None
    ends = [] if task.failure is None else [first_time(task.failure)]
    if task.success is not None and all(_is_recorded(part) for part in [*task.success.parts(), *ends]):
        good = np.atleast_1d(run.measure(task.success))
        for end in ends:
            good = good & ~np.isfinite(run.measure(end))
    rows = [] if good is None else [("success", f"{int(good.sum())} of {len(good)}")]
    for name, what in task.measures.items():
        if solved.any() and _is_recorded(what):
            values = np.atleast_1d(run.measure(what))[solved]
            finite = np.isfinite(values)
            share = "" if finite.all() or not finite.any() else f" in {finite.sum()} of {len(values)}"
            rows.append((name, f"{values[finite].mean() if finite.any() else values[0]:.4g}{share}"))
    title = "the task's measures" + (", means" if len(solved) > 1 else "")
    table = Table(title=title, box=SIMPLE_HEAD, show_header=False)
    for row in rows:
        table.add_row(*row)
    return (table if rows else None), good


def _is_recorded(measure: Measure) -> bool:
    """Whether a measure is of what a trajectory holds; costs and functions are a sweep's."""
    return all(signal.kind not in ("cost", "function") for signal in measure.signals())


def warnings(run: slcp.Trajectory) -> list[str]:
    """Lines about what overlaps at the start, and about the first worlds that failed: when, and what overlaps
    there.
    """
    gap, states = run.recorded("gap").copy(), run.recorded("states")
    unsolved = np.isnan(gap).any(axis=2)
    at_once = unsolved[:, 0]
    if at_once.any():
        gap[at_once, 0] = run.last_gap(at_once)
    deep = overlaps(run.scene, gap[:, 0])
    lines = [f"the start overlaps: {deep}"] if deep else []
    failures = run.failures()
    for world, status, overlapping in failures[:MOST]:
        step = int(unsolved[world].argmax()) if unsolved[world].any() else None
        when = "" if step is None else f" in step {step + 1} of {states.shape[1] - 1}"
        lines.append(f"world {world} is {status}{when}; what overlaps there: {overlapping}")
    more = int((run.recorded("status") != slcp.Status.SOLVED).sum()) - len(failures[:MOST])
    lines += [f"{more:,} more worlds are not SOLVED"] if more else []
    return lines + _soft(run, bool((gap[:, -1] < NEAR).any()))


def _soft(run: slcp.Trajectory, touching: bool) -> list[str]:
    """A line where what touches at the end creeps, as the noise of contacts is faster than a step's fall."""
    if not touching or run.options is None or run.options.hard:
        return []
    h, sigma = (float(np.max(run.params[name])) for name in ("step_size", "sigma"))
    fall = float(np.hypot(*np.reshape(run.params["gravity"], (-1, 2))[0])) * h
    if not 0.0 < fall < sigma:
        return []
    return [
        f"sigma is {sigma:g} m/s, more than what a step falls, g h = {fall:.3g}: what rests or is held by "
        f"friction creeps; {fall / 5.0:.2g} holds it (--sigma), hard contact is the limit (docs/do/scene.md)"
    ]


def _freedoms(scene: slcp.Scene) -> list[str]:
    """A name for every degree of freedom: its body's, and which one where a joint has several."""
    return [
        escape(body.name) + (f", {part}" if body.joint == "free" else "")
        for body in scene.bodies
        for part in (("x", "y", "angle") if body.joint == "free" else ("",))
    ]
