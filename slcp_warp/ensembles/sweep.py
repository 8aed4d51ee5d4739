"""Robustness sweeps: thousands of perturbed worlds under a policy, smoothed and hard, with statistics."""

import json
import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any, overload

import numpy as np

from ..description.scene import Scene
from ..inputs import checks
from ..inputs.errors import ArgumentError
from ..measures import contact_share, lowest_gap
from ..options import Options
from ..parameters import Parameters
from ..stepping.strategy import current_name
from ..tasks.disturbances import Disturbances, LogNormal
from ..tasks.task import Task
from .chunks import ARMS, Chunks, Part
from .outcome import Report
from .report import SweepReport
from .spec import SweepSpec
from .statistics.source import NOTED
from .summary import spin_measures, summary_of, table_of
from .task_report import Progress, sweep_task
from .tasks import TaskSweep
from .worlds import Worlds
from .worlds.draws import Draws

OLD = "slcp.sweep(scene, policy, spec) will go: give a slcp.Task, whose measures and success are its own"


@overload
def sweep(
    scene: Task | str,
    policy: Any = None,
    spec: None = None,
    *,
    worlds: int | Worlds = 4096,
    seed: int = 0,
    cases: Any = None,
    step_sizes: Sequence[float] | None = None,
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    chunk: int | None = None,
    progress: Progress | None = None,
    out: str | os.PathLike[str] | None = None,
    executor: Any = None,
    record: Sequence[str | int] = (),
    record_every: float = 0.5,
) -> Report: ...


@overload
def sweep(
    scene: Scene,
    policy: Any,
    spec: SweepSpec,
    *,
    scaling: str = "inertia",
    integrator: str = "euler",
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    chunk: int | None = None,
    progress: Progress | None = None,
) -> SweepReport: ...


def sweep(
    scene: Scene | Task | str,
    policy: Any = None,
    spec: SweepSpec | None = None,
    *,
    worlds: int | Worlds = 4096,
    seed: int = 0,
    cases: Any = None,
    step_sizes: Sequence[float] | None = None,
    scaling: str = "inertia",
    integrator: str = "euler",
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    chunk: int | None = None,
    progress: Progress | None = None,
    out: str | os.PathLike[str] | None = None,
    executor: Any = None,
    record: Sequence[str | int] = (),
    record_every: float = 0.5,
) -> Report | SweepReport:
    """Run many perturbed worlds, in chunks of bounded memory: of a task, or of a scene as a spec says.

    Of a task every policy meets the same disturbed worlds, and from every start an undisturbed one; a
    `Report` of the task's measures comes back. Of a scene the spec says everything, a `SweepReport` comes
    back: the way of before there were tasks, with a DeprecationWarning.

    Args:
        scene: a task, or its name or file (`load_task`); or a mechanism.
        policy: as for `Simulator.rollout`; for a task also several by name, and files of policies
            (`policies.load_policy`); None: none, of a scene without controls.
        spec: of a scene: what is varied and measured.
        worlds: of a task: disturbed worlds of a case and a policy; or `Worlds`, given ones.
        seed: of a task: of all that is drawn; a world's numbers follow from it and the world's index.
        cases: of a task: options of the steps, one, several, or by name; None: the task's, and the hard
            problem.
        step_sizes: of a task [s]; None: the scene's.
        scaling, integrator: of a scene: of `Options`, for all cases.
        dtype, device: of the simulators.
        chunk: worlds per launch, default by memory; results do not depend on it.
        strategy: as of a `Simulator`; with "generic", and "auto" where that takes it, a step is a launch.
        progress: called with (worlds done, worlds in all).
        out: of a task: a folder for its table, a file for every chunk. The same call again goes on where it
            was, after a kill too; memory does not grow with the worlds. None: the table stays in memory.
        executor: of a task with `out`: runs chunks in other processes, see `runs.executors`.
        record: of a task: states whose way from the start is kept over time, by name or place, in columns
            "recorded_NAME_TIME" of the table.
        record_every: time between two records [s]; one comes before the kick of its time.

    A keyboard interrupt ends the sweep with what is finished (`complete` False).

    Raises:
        StrategyError: more rows than the kernels for these options take.
        FileError: `out` holds another sweep (the message says what differs), or cannot be written.
    """
    strategy = current_name(strategy)
    if isinstance(scene, Task | str):
        if spec is not None:
            raise ArgumentError(
                f"scene is {checks.shown(scene)} and spec is {checks.shown(spec)}; a task has its own"
                " disturbances and measures, also one by name: a spec is of a slcp_warp.Scene"
            )
        return sweep_task(
            scene, policy, worlds=worlds, seed=seed, cases=cases, step_sizes=step_sizes, dtype=dtype,
            device=device, strategy=strategy, chunk=chunk, progress=progress, out=out, executor=executor,
            record=record, record_every=record_every,
        )  # fmt: skip
    recorded = not isinstance(record, list | tuple) or bool(record)
    if out is not None or executor is not None or recorded:
        raise ArgumentError("out, executor and record are of tasks; a sweep of a scene stays in memory")
    if isinstance(scene, Scene):
        warnings.warn(OLD, DeprecationWarning, stacklevel=2)
    return sweep_scene(
        scene, policy, spec, scaling=scaling, integrator=integrator, dtype=dtype, device=device,
        strategy=strategy, chunk=chunk, progress=progress,
    )  # fmt: skip


def sweep_scene(
    scene: Scene,
    policy: Any,
    spec: SweepSpec | None,
    *,
    scaling: str = "inertia",
    integrator: str = "euler",
    progress: Progress | None = None,
    **choices: Any,
) -> SweepReport:
    """The paper's sweep: of a scene as a spec says, with the rate of one state and its recovery from kicks.

    Args:
        choices: of a `TaskSweep`: dtype, device, strategy, chunk.
    """
    checks.function("progress", progress, 2, optional=True)
    work = SceneSweep(scene, policy, spec, scaling=scaling, integrator=integrator, **choices)
    return _report_of(work, progress or (lambda done, total: None))


class SceneSweep(TaskSweep):
    """A sweep of a scene as a spec says: of a task with its disturbances, one state recorded."""

    def __init__(
        self, scene: Any, policy: Any, spec: Any, *, scaling: str, integrator: str, **choices: Any
    ) -> None:
        checks.instance("scene", scene, Scene, "a slcp_warp.Scene or a slcp_warp.Task")
        self.spec: SweepSpec = checks.instance("spec", spec, SweepSpec, "a slcp_warp.SweepSpec")
        cases = {
            residual: Options(residual=residual, scaling=scaling, integrator=integrator)
            for residual in spec.residuals
        }
        super().__init__(
            task_of(scene, spec), {"policy": policy}, worlds=spec.worlds, seed=spec.seed, cases=cases,
            step_sizes=spec.step_sizes, record=(spec.observe,), record_every=spec.sample_every, **choices,
        )  # fmt: skip
        self.chunks = Chunks([part for part in self.chunks.parts if part.arm == ARMS[0]])
        sim = next(iter(self.simulators.values()))
        kept = "SweepSpec.duration / sample_every: the samples"
        checks.memory(kept, spec.worlds * self.record.count(spec.duration), 4, sim.device)

    def draws(self, part: Part) -> Draws:
        """As of a task, with other base values; the table has columns for parameters only.

        Raises:
            ArgumentError: parameters of the spec that differ over worlds.
        """
        sim, spec, task = self.simulators[part.case], self.spec, self.task
        params = sim.params.replace(**spec.parameters)
        if params.worlds is not None:
            raise ArgumentError(
                "SweepSpec.parameters must be shared by all worlds; use parameter_sd to vary them"
            )
        draws = Draws(sim, task.disturbances, self.seed, part.step_size, task.start, params.table()[0],
                      spec.sample_every)  # fmt: skip
        draws.told = draws.told[:1]
        return draws


def task_of(scene: Scene, spec: SweepSpec) -> Task:
    """What a spec asks of a scene, as a task.

    Raises:
        ArgumentError: starts that are no states of the scene, or a component that it has not got.
    """
    nx = 2 * scene.nv
    if not 0 <= spec.observe < nx:
        raise ArgumentError(f"SweepSpec.observe is {spec.observe}; a state component 0..{nx - 1} is needed")
    if spec.start is not None and spec.start.shape[1:] != (nx,):
        raise ArgumentError(
            f"SweepSpec.start has shape {spec.start.shape}; finite numbers (M, {nx}) are needed"
        )
    there = {name for name, _, shape in Parameters(scene).layout.columns if np.prod(shape, dtype=int)}
    disturbances = Disturbances(
        position=spec.position_sd,
        velocity=spec.velocity_sd,
        parameters={name: LogNormal(sd) for name, sd in spec.parameter_sd.items() if name in there},
        torque=spec.torque_sd,
        kick_times=spec.kick_times,
        kick=spec.kick_sd if spec.kick_times else 0.0,
    )
    judged = {"contact_share": contact_share(), "lowest_gap": lowest_gap()} | spin_measures(spec)
    own = replace(scene, step_size=float(spec.step_sizes[0]))
    return Task(scene.name, own, duration=spec.duration, start=spec.start,
                disturbances=disturbances, measures=judged)  # fmt: skip


def _report_of(work: SceneSweep, progress: Callable[[int, int], None]) -> SweepReport:
    """All chunks, and a report of what is finished."""
    spec, done = work.spec, 0
    report = SweepReport([], {}, [], _plain(spec))
    pieces: dict[Part, list[dict[str, np.ndarray]]] = {}
    seconds: dict[Part, float] = {}
    try:
        for part, world0, count in map(work.chunks.__getitem__, range(len(work.chunks))):
            began = time.perf_counter()
            found = work.found(part, world0, count)
            seconds[part] = seconds.get(part, 0.0) + time.perf_counter() - began
            found["records"] = found["records"][:, :, 0]
            found = {name: column for name, column in found.items() if name not in NOTED}
            found |= dict(zip(work.task.measures, found.pop("measures").T))
            pieces.setdefault(part, []).append(found)
            done += count
            progress(done, work.chunks.worlds)
    except KeyboardInterrupt:
        report.complete = False
    tables = []
    for part, several in pieces.items():
        found = {name: np.concatenate([each[name] for each in several]) for name in several[0]}
        table = table_of(part.case, part.step_size, found, spec)
        report.cases.append(summary_of(part.case, part.step_size, table, spec, seconds[part]))
        report.samples.append(found["records"])
        tables.append(table)
    report.table = {name: np.concatenate([t[name] for t in tables]) for name in tables[0]} if tables else {}
    return report


def _plain(spec: SweepSpec) -> dict[str, Any]:
    values = asdict(spec)
    values["start"] = None if spec.start is None else list(np.shape(spec.start))
    return json.loads(json.dumps(values, default=lambda a: np.asarray(a).tolist()))
