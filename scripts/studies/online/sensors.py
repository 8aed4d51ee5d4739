"""`slcp paper sensors`: velocities that no sensor measures, by differences and by Kalman filters through
contact, and what feedback is worth by them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import warp as wp

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ensembles.statistics import share_interval
from slcp_warp.policies import Belief, Estimated, KalmanFilter

from ...support.options import Seed
from ...support.screen import console, one_line_errors, show_rows
from ...support.simulators import parse_settings
from ...support.tables import write_csv

ENCODER = 0.005  # standard deviation of a measured angle of the finger [rad]
PROCESS = 0.3  # of the finger's models [rad/s in a second]
STEPS, SETTLED = 150, 10  # of a run of the finger; the first that counts
TORQUE = 4.0  # amplitude of sines that move it [N m]
MODELS = {
    "hard": slcp.Options("hard", "none"),
    "smoothed, sigma .05": slcp.Options("rem-logistic"),
    "as soft as it is uncertain": slcp.Options("rem-normal", noise="state"),
}


class Differences(KalmanFilter):
    """Velocities by differences of measured positions, all of which have sensors; a share `held` of the last
    one is kept.
    """

    def __init__(self, model: slcp.Simulator, sensors: dict[str, float], held: float = 0.0) -> None:
        super().__init__(model, sensors, process=1.0)
        self.held = held

    def begin(self, worlds: int) -> Belief:
        """Nothing is measured: positions are NaN."""
        belief = super().begin(worlds)
        belief.mean[:] = np.where(np.arange(self.model.nx) < self.model.nx // 2, np.nan, 0.0)
        return belief

    def predict(self, belief: Belief, u: Any, seconds: float | None = None) -> Belief:
        """Nothing is predicted; how long it took is remembered."""
        self.seconds = self.step_size if seconds is None else seconds
        return belief

    def correct(self, belief: Belief, measured: Any) -> Belief:
        """Positions as they are measured."""
        nv = self.model.nx // 2
        q, v = belief.mean[:, :nv], belief.mean[:, nv:]
        begun = np.isfinite(q)
        moved = np.where(begun, measured - q, 0.0) / getattr(self, "seconds", self.step_size)
        mean = np.concatenate([measured, self.held * v + (1.0 - self.held) * moved], axis=1)
        return belief._replace(mean=mean)


def filters(task: slcp.Task) -> Iterator[tuple[str, KalmanFilter]]:
    """What is compared on a task's scene, whose positions are measured."""
    sensors = dict.fromkeys(task.scene.state_names[: task.scene.nv], ENCODER)
    for held in (0.0, 0.3, 0.6):
        yield f"differences, {held:g} held", Differences(slcp.Simulator(task.scene), sensors, held)
    for name, options in MODELS.items():
        model = slcp.Simulator(task.scene, options)
        yield f"filter, {name}", KalmanFilter(model, sensors, PROCESS, start=0.01, x0=task.start[0])


def accuracy(worlds: int, seed: int) -> list[dict[str, Any]]:
    """Errors of the finger's estimated velocities on hard contact, in worlds of other masses and friction."""
    task, rng = slcp.tasks.flicking_finger(), np.random.default_rng(seed)
    plant = slcp.Simulator(task.scene, MODELS["hard"])
    times = task.scene.step_size * np.arange(STEPS)[:, None]
    pace, phase = rng.uniform(1.0, 4.0, (2, worlds, 1, 2))
    us = TORQUE * np.sin(pace * times + 2.0 * phase)
    mass, friction = np.exp([[0.1], [0.3]] * rng.standard_normal((2, worlds)))
    own = plant.params
    heavy = {name: mass[:, None] * own[name] for name in ("mass", "inertia")}
    params = own.replace(friction=friction[:, None] * own["friction"], **heavy)
    run = plant.rollout(np.tile(task.start[0], (worlds, 1)), us, params, record="impulse")
    solved = np.asarray(run.status) == 0
    nv, x = task.scene.nv, np.asarray(run.states)[solved]
    measured = x[:, :, :nv] + ENCODER * rng.standard_normal(x[:, :, :nv].shape)
    touching = float((np.abs(run.impulse[solved]).max(axis=2) > 1e-6).mean())
    rows = []
    for name, filter in filters(task):
        belief = filter.estimate(measured, us[solved])
        off = (belief.mean - x)[:, SETTLED:]
        row = {"estimate": name, "touching": touching, "worlds": int(solved.sum())}
        row |= {f"{state} [rad/s]": float(np.sqrt(np.mean(off[..., nv + i] ** 2)))
                for i, state in enumerate(task.scene.state_names[nv:])}  # fmt: skip
        row["off by more than three deviations"] = float("nan")
        if belief.covariance.any():
            sds = np.sqrt(np.diagonal(belief.covariance, axis1=2, axis2=3))[:, SETTLED:, nv:]
            row["off by more than three deviations"] = float((np.abs(off[..., nv:]) > 3.0 * sds).mean())
        rows.append(row)
    return rows


def arms(task: slcp.Task, policy: Any, sensors: dict[str, float], process: float) -> dict[str, Any]:
    """One policy: of all states with noise, of differences, of estimates of now and of when it acts."""
    model = task.simulator()
    return {
        "all states, noisy": policy,
        "differences": Estimated(policy, Differences(model, sensors), limits=task.control_limits),
        "filter": Estimated.of_task(task, policy, sensors, process, foresee=False),
        "filter, delay not known": Estimated.of_task(task, policy, sensors, process, delay=0.0),
        "filter that foresees": Estimated.of_task(task, policy, sensors, process),
    }


def control(
    base: slcp.Task, sensors: dict[str, float], delays: list[float], worlds: int, seed: int, process: float
) -> list[dict[str, Any]]:
    """How often a task succeeds on hard contact, by what is seen and how late it acts."""
    policy, rows = ddp.TrackingPolicy(ddp.plan(base).best, base.scene.state_period), []
    own = base.disturbances.sensor
    noise = dict(own) if isinstance(own, Mapping) else dict.fromkeys(base.scene.state_names, own)
    for delay in delays:
        task = base.replace(disturbances=replace(base.disturbances, sensor=noise | sensors, delay=delay))
        case, all_of = (
            slcp.Options("hard", scaling=task.options.scaling),
            arms(task, policy, sensors, process),
        )
        report = slcp.sweep(task, all_of, worlds=worlds, seed=seed, cases=case)
        for name in all_of:
            successes = int(report.part(name, arm="disturbed")["success"].sum())
            share, low, high = share_interval(successes, worlds)
            rows.append({"delay [s]": delay, "sees": name, "success": share, "low": low, "high": high})
        console.print(f"[dim]delay {delay:g} s: done[/dim]")
    return rows


@one_line_errors
def sensors_command(
    task: Annotated[
        str | None, typer.Argument(help="A task whose plan is followed; else the first table.")
    ] = None,
    sensor: Annotated[list[str] | None, typer.Option(help="state=standard deviation; of all places.")] = None,
    delay: Annotated[
        list[float] | None, typer.Option(help="Of controls [s] (repeatable); default: 0.")
    ] = None,
    worlds: Annotated[int, typer.Option(min=1, help="Disturbed worlds of each row.")] = 1024,
    process: Annotated[float, typer.Option(min=0.0, help="What the task's model does not know.")] = 0.1,
    seed: Seed = 0,
    csv: Annotated[Path | None, typer.Option(help="Also write the second table here.")] = None,
) -> None:
    """Velocities that no sensor measures: how well they are estimated, and what feedback is worth by them."""
    sensors = parse_settings(sensor, "--sensor")
    if task is not None and not sensors:
        raise ValueError("--sensor is missing; one for every place of the task's scene is needed")
    title = f"The finger's velocities from angles with noise of {ENCODER} rad; {wp.get_device('cpu')}"
    show_rows(title, accuracy(min(worlds, 256), seed))
    if task is None:
        return
    rows = control(slcp.load_task(task), sensors, delay or [0.0], worlds, seed, process)
    show_rows(f"{task}, {worlds} disturbed worlds, hard contact: success by what is seen", rows)
    if csv is not None:
        write_csv(csv, rows)
