"""Robustness sweeps: thousands of perturbed worlds under a policy, smoothed and hard, with statistics."""

import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ..description.scene import Scene
from ..inputs import checks
from ..inputs.errors import ArgumentError
from ..options import Options
from ..simulator import Simulator
from ..stepping.strategy import current_name
from ..tasks.task import Task
from .launch import Case
from .report import SweepReport
from .spec import SweepSpec
from .summary import summary_of, table_of
from .task_report import sweep_task
from .worlds import Worlds


def sweep(
    scene: Scene | Task | str,
    policy: Any,
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
    progress: Callable[[int, int], None] | None = None,
    out: str | os.PathLike[str] | None = None,
    executor: Any = None,
) -> Any:
    """Run many perturbed worlds, in chunks of bounded memory: of a task, or of a scene as a spec says.

    Of a task every policy meets the same disturbed worlds, and from every start an undisturbed one; a
    `Report` of the task's measures comes back. Of a scene the spec says everything, a `SweepReport` comes
    back.

    Args:
        scene: a task, or its name or file (`load_task`); or a mechanism.
        policy: as for `Simulator.rollout`; for a task also several by name, and files of policies
            (`policies.load_policy`).
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

    A keyboard interrupt ends the sweep with what is finished (`complete` False).

    Raises:
        StrategyError: more rows than the kernels for these options take.
        FileError: `out` holds another sweep (the message says what differs), or cannot be written.
    """
    strategy = current_name(strategy)
    if isinstance(scene, Task | str):
        if spec is not None:
            raise ArgumentError(f"spec is {checks.shown(spec)}; a task has its own disturbances and measures")
        if out is not None and isinstance(worlds, Worlds):
            raise ArgumentError("worlds are given; with out they are drawn: a number of them is needed")
        return sweep_task(
            scene, policy, worlds=worlds, seed=seed, cases=cases, step_sizes=step_sizes, dtype=dtype,
            device=device, strategy=strategy, chunk=chunk, progress=progress, out=out, executor=executor,
        )  # fmt: skip
    if out is not None or executor is not None:
        raise ArgumentError("out and executor are of tasks; a sweep of a scene stays in memory")
    return _sweep_scene(scene, policy, spec, scaling, integrator, dtype, device, strategy, chunk, progress)


def _sweep_scene(
    scene: Scene,
    policy: Any,
    spec: Any,
    scaling: str,
    integrator: str,
    dtype: str,
    device: Any,
    strategy: str,
    chunk: int | None,
    progress: Callable[[int, int], None] | None,
) -> SweepReport:
    """The product of the spec's residuals and step sizes."""
    checks.instance("scene", scene, Scene, "a slcp_warp.Scene or a slcp_warp.Task")
    checks.instance("spec", spec, SweepSpec, "a slcp_warp.SweepSpec")
    chunk = None if chunk is None else checks.whole("chunk", chunk)
    checks.function("progress", progress, 2, optional=True)

    def cases() -> Iterator[tuple[str, Case]]:
        for residual in spec.residuals:
            options = Options(residual=residual, scaling=scaling, integrator=integrator)
            sim = Simulator(scene, options, device=device, dtype=dtype, strategy=strategy)
            for step_size in spec.step_sizes:
                yield residual, Case(sim, policy, spec, step_size, chunk)

    report = SweepReport([], {}, [], _plain(spec))
    tables: list[dict[str, np.ndarray]] = []
    done, total = 0, spec.worlds * len(spec.residuals) * len(spec.step_sizes)
    for residual, case in cases():
        try:
            for count in case.run():
                done += count
                if progress is not None:
                    progress(done, total)
        except KeyboardInterrupt:
            report.complete = False
        if found := case.finished():
            table, samples = table_of(residual, case.step_size, found, spec)
            report.cases.append(summary_of(residual, case.step_size, table, spec, case.seconds))
            report.samples.append(samples)
            tables.append(table)
        if not report.complete:
            break
    report.table = {name: np.concatenate([t[name] for t in tables]) for name in tables[0]} if tables else {}
    return report


def _plain(spec: SweepSpec) -> dict[str, Any]:
    values = asdict(spec)
    values["start"] = None if spec.start is None else list(np.shape(spec.start))
    return json.loads(json.dumps(values, default=lambda a: np.asarray(a).tolist()))
