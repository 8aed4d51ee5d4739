"""Policies as the commands name them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.planning import delay_of
from slcp_warp.storage.python import python_name

from .records import load_plan, load_policy, read_kind
from .tasks import tell_timing

ZERO, MPC = "zero", "mpc"
MISSING = "--policy is missing: a file of `slcp library` or `slcp optimise`, file.py:name, or zero"
STARTS = ("shift", "plan", "zero", "noise")
POLICY = f"{ZERO}, a file of `slcp library`, `optimise` or `save_policy`, {MPC}, {MPC}:FILE, or file.py:name"

TaskPolicy = Annotated[str | None, typer.Option(help=f"{POLICY}; none of a task without controls.")]


def named_policy(given: str | Path, scene: slcp.Scene, task: slcp.Task | None) -> tuple[Any, dict[str, Any]]:
    """A policy, and header entries about it.

    Args:
        given: "zero"; a file; "mpc" or "mpc:FILE" of a plan or library, which plans the task while it runs
            (`planning_policy`); "file.py:name" of a policy, or of a function that makes one.
        scene: what is controlled.
        task: of it, where there is one; "mpc" needs it.
    """
    text = str(given)
    if text == ZERO:
        nothing = np.zeros((scene.nu, 2 * scene.nv))
        return slcp.policies.Linear(nothing, scene.x0, np.zeros(scene.nu)), {"policy": ZERO}
    if text == MPC or text.startswith(f"{MPC}:"):
        if task is None:
            raise ValueError(f"{text}: scene {scene.name!r} is no task; there is nothing to plan for")
        path = Path(text.partition(":")[2]) if ":" in text else None
        tell_timing(task, delayed=True)
        return planning_policy(task, path), {"policy": MPC}
    if of_python(text):
        return slcp.policies.load_policy(text), {"policy": policy_name(text)}
    policy, facts = load_policy(Path(text), scene)
    _tell_early(text, policy, task)
    if facts["policy"] == "tracking":
        tell_gains(text, ddp.Result.load(text))
    return policy, facts


def tell_gains(name: str, plan: ddp.Result) -> None:
    """Say where a plan's gains are none to rely on."""
    status = ddp.Status(int(plan.status))
    if status == ddp.Status.DYNAMICS_FAILED:
        typer.echo(f"slcp: {name} ended {status.name}: {status.explanation}; it has no gains", err=True)
    elif not plan.positive_definite:
        typer.echo(
            f"slcp: {name} ended {status.name} where Q_uu is not positive definite: no minimum, whose gains "
            "may amplify what they should correct; go on from it (slcp optimise --from), with --method "
            "gauss-newton, too, and look at a sweep",
            err=True,
        )


def _tell_early(name: str, policy: Any, task: slcp.Task | None) -> None:
    """Say where a plan is of another delay than its controls have here."""
    if isinstance(policy, ddp.TrackingPolicy) and policy.step_size is not None:
        planned = policy.early * policy.step_size
        delay = 0.0 if task is None else task.disturbances.fixed().delay
        here = delay if isinstance(delay, float) else 0.0
        if abs(planned - here) > 0.5 * policy.step_size:
            typer.echo(
                f"slcp: the controls of {name} are planned to act {planned:g} s after they are sent; here "
                f"they act {here:g} s after",
                err=True,
            )


def policies_of_task(given: Sequence[str | Path] | str | None, task: slcp.Task) -> dict[str, Any] | None:
    """Policies by name; None where none is given and the task's scene has no controls."""
    if not given and task.scene.nu:
        raise ValueError(MISSING)
    return named_policies([given] if isinstance(given, str) else given, task.scene, task) if given else None


def policy_of_task(given: str | None, task: slcp.Task) -> Any:
    """The same of a single one."""
    found = policies_of_task(given, task)
    return None if found is None else next(iter(found.values()))


def named_policies(
    given: Sequence[str | Path], scene: slcp.Scene, task: slcp.Task | None = None
) -> dict[str, Any]:
    """Policies by what they are called in tables; see `named_policy`."""
    named: dict[str, str | Path] = {}
    for each in given:
        name = policy_name(each)
        if name in named:
            raise ValueError(
                f"--policy: {named[name]} and {each} are both {name!r} in tables; rename a file or a function"
            )
        named[name] = each
    return {name: named_policy(each, scene, task)[0] for name, each in named.items()}


def policy_name(given: str | Path) -> str:
    """What a policy is called in tables."""
    text = str(given)
    if text == MPC or text.startswith(f"{MPC}:"):
        return MPC
    return text.rpartition(":")[2] if of_python(text) else Path(text).stem


def of_python(given: str | Path) -> bool:
    """Whether it is `file.py:name`."""
    return str(given).rpartition(":")[0].endswith(".py")


def function_of(given: str | None, names: Sequence[str]) -> Any:
    """The function of "file.py:name" that makes a policy from numbers of these names."""
    if given is None or not of_python(given):
        raise ValueError(
            f"--policy is {given}; file.py:name of a function of {', '.join(names)} is needed with --number"
        )
    file, _, name = str(given).rpartition(":")
    found, _ = python_name(Path(file), name)
    if not callable(found):
        raise ValueError(f"--policy: {file} has no function {name!r}")
    return found


def planning_policy(task: slcp.Task, path: Path | None) -> ddp.MPC:
    """Model predictive control of a task with its own options as the model, 2 passes a step.

    Plans are tried from the shifted plan and from what the file holds: a library's controls, or a plan made
    ahead, zero and noise; without a file the task is planned first: where a run is as long as a plan for its
    disturbed worlds (`ddp.plan_in_worlds`), whose model is then the planner's, else as `slcp optimise` does.
    Where a run is as long as a plan, plans end with it. A task's delay that is a number is the planner's.

    Args:
        path: of a library or a plan of the task's scene.
    """
    problem = ddp.problem_of(task)
    if path is None and ends_with_plan(task) and task.success is not None:
        found = ddp.plan_in_worlds(task)
        if not found.success[found.index]:
            typer.echo(
                f"slcp: the plan that mpc made succeeds in none of {found.worlds} worlds: plan first, with "
                "more --starts (slcp optimise), and give --policy mpc:plan.npz",
                err=True,
            )
        return planned_policy(task, found.problem, found.best)
    how: dict[str, Any] = {"improved": 2, "lag": delay_of(task, problem)}
    how["end"] = task.steps if ends_with_plan(task) else None
    if path is not None and read_kind(path) == "library":
        entries = ddp.Library.load(path)
        entries.check_scene(task.scene)
        return ddp.MPC(problem, entries, **how)
    plan = ddp.plan(task).best if path is None else ddp.Result.of(load_plan(path, task.scene))
    tell_gains("its plan" if path is None else str(path), plan)
    return ddp.MPC(problem, starts=STARTS, plan=plan, **how)


def ends_with_plan(task: slcp.Task) -> bool:
    """Whether a task's runs are as long as its plans."""
    return bool(task.steps == task.horizon)


def planned_policy(task: slcp.Task, problem: ddp.Problem, plan: ddp.Result, **more: Any) -> ddp.MPC:
    """Model predictive control with a model and a plan of it, up to the plan's end."""
    how: dict[str, Any] = {"starts": STARTS, "improved": 2, "lag": delay_of(task, problem)} | more
    return ddp.MPC(problem, plan=plan, end=problem.horizon, **how)
