"""Robustness sweeps of tasks: several policies in the same worlds, judged by the task's measures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..inputs import checks
from ..inputs.checks import shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..measures.reductions import Measure
from ..options import Options, Status
from ..simulator import Simulator
from ..tasks.disturbances import Disturbances
from ..tasks.task import Task
from .draws import Draws
from .launch import Case
from .outcome import Report
from .spec import SweepSpec

ARMS = ("disturbed", "undisturbed")
Progress = Callable[[int, int], None]


def sweep_task(
    task: Task,
    policies: Any,
    *,
    worlds: int = 4096,
    seed: int = 0,
    cases: Any = None,
    step_sizes: Sequence[float] | None = None,
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    chunk: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Run a task in many disturbed worlds, the same under every policy, and from every start undisturbed.

    Args:
        task: what is run, disturbed and measured.
        policies: a policy, or policies by name.
        worlds: disturbed ones, a case and a policy.
        seed: of all that is drawn; a world's numbers follow from it and the world's index.
        cases: options of the steps, one, several, or by name; None: the task's, and the hard problem.
        step_sizes: [s]; None: the scene's.
        dtype, device, strategy: as of a `Simulator`.
        chunk: worlds a launch; results do not depend on it.
        progress: called with (worlds done, worlds in all).

    A world that was not solved has NaN for its measures, and is no success. A keyboard interrupt ends the
    sweep with what is finished (`complete` False).
    """
    named, options = policies_by_name(policies), cases_by_name(task, cases)
    worlds, seed = checks.whole("worlds", worlds), checks.whole("seed", seed, 0)
    chunk = None if chunk is None else checks.whole("chunk", chunk)
    checks.function("progress", progress, 2, optional=True)
    sizes = _step_sizes(task, step_sizes)
    judged: list[Measure] = list(task.measures.values())
    judged += [] if task.success is None else task.success.parts()
    report = Report(task, [])
    total = (worlds + len(task.start)) * len(named) * len(options) * len(sizes)
    done = 0
    for label, choice in options.items():
        sim = Simulator(task.scene, choice, device=device, dtype=dtype, strategy=strategy)
        for size in sizes:
            for name, policy in named.items():
                for arm, disturbances, count in (
                    (ARMS[0], task.disturbances, worlds),
                    (ARMS[1], Disturbances(), len(task.start)),
                ):
                    case = _case(sim, task, policy, disturbances, count, seed, size, chunk, judged)
                    try:
                        for part in case.run():
                            done += part
                            if progress is not None:
                                progress(done, total)
                    except KeyboardInterrupt:
                        report.complete = False
                    if found := case.finished():
                        report.add(name, label, size, arm, _columns(task, judged, found))
                    if not report.complete:
                        return report
    return report


def _step_sizes(task: Task, given: Any) -> tuple[float, ...]:
    if given is None:
        return (task.scene.step_size,)
    if not isinstance(given, list | tuple | np.ndarray) or not len(given):
        raise ArgumentError(f"step_sizes is {shown(given)}; at least one, in a tuple, is needed")
    assert task.duration is not None
    longest = task.duration
    return tuple(checks.number("step_sizes", h, 0.0, longest, above=True) for h in given)


def _case(
    sim: Simulator,
    task: Task,
    policy: Any,
    disturbances: Disturbances,
    worlds: int,
    seed: int,
    step_size: float,
    chunk: int | None,
    judged: list[Measure],
) -> Case:
    assert task.duration is not None
    d = disturbances
    spec = SweepSpec(
        worlds=worlds, duration=task.duration, step_sizes=(step_size,), start=task.start, seed=seed,
        parameter_sd=dict(d.parameters), torque_sd=d.torque, kick_times=d.kick_times, kick_sd=d.kick,
        sample_every=task.duration, judged=False,
    )  # fmt: skip
    draws = Draws(sim, spec, step_size, d.deviation(task.scene), in_order=not d.any())
    return Case(sim, policy, spec, step_size, chunk, judged, draws, task.control_limits)


def _columns(task: Task, judged: list[Measure], found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What was drawn, measures, success and status of a case's worlds."""
    values = found["measures"]
    own = {measure: values[:, j] for j, measure in enumerate(judged)}
    solved = found["status"] == Status.SOLVED
    success = solved if task.success is None else task.success.holds(own) & solved
    columns = {name: array for name, array in found.items() if name.startswith("drawn_")}
    columns |= {name: np.where(solved, values[:, j], np.nan) for j, name in enumerate(task.measures)}
    return {"world": np.arange(len(solved)), **columns, "success": success, "status": found["status"]}


def policies_by_name(policies: Any) -> dict[str, Any]:
    """Policies by name; one alone is named "policy"."""
    if isinstance(policies, Mapping):
        if not policies or not all(isinstance(name, str) and name for name in policies):
            raise ArgumentError(f"policies is {shown(policies)}; at least one, by name, is needed")
        return dict(policies)
    return {"policy": policies}


def cases_by_name(task: Task, cases: Any) -> dict[str, Options]:
    """Options by name: what differs from the task's, or their residual."""
    if cases is None:
        hard = replace(task.options, residual="hard", noise="row", deviation=None)
        cases = [task.options] if task.options.hard else [task.options, hard]
    if isinstance(cases, Mapping):
        found = dict(cases)
    else:
        given = [cases] if isinstance(cases, Options) else cases
        if not isinstance(given, list | tuple) or not all(isinstance(each, Options) for each in given):
            raise ArgumentTypeError(f"cases is {shown(cases)}; slcp_warp.Options, one or several, are needed")
        found = {}
        for each in given:
            label = each.residual + ("" if each.friction == "anitescu" else f", {each.friction}")
            label += "" if each.gap == "start" else f", gap {each.gap}"
            label += "" if each.integrator == "euler" else f", {each.integrator}"
            found[label if label not in found else f"{label} {len(found) + 1}"] = each
    if not found or not all(isinstance(each, Options) for each in found.values()):
        raise ArgumentTypeError(f"cases is {shown(cases)}; slcp_warp.Options by name are needed")
    return found
