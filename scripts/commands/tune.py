"""`slcp tune`: numbers of a policy, or of a design, that do best over disturbed worlds."""

from pathlib import Path
from typing import Annotated, Any

import typer

import slcp_warp as slcp
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.policies.saved import content_of

from ..support.options import Device, Seed
from ..support.policies import function_of, policy_of_task
from ..support.rules import HARD_RULE, HardRule, with_rules
from ..support.screen import console, one_line_errors, prepared, progress_bar, timed, wrote
from ..support.tasks import TaskName


@one_line_errors
@with_rules
def tune_command(
    task: TaskName,
    policy: Annotated[
        str | None,
        typer.Option(help="With --number file.py:function of the numbers; else a policy as of `slcp sweep`."),
    ] = None,
    number: Annotated[
        list[str] | None, typer.Option(help="name=low:high, an argument of the policy's function.")
    ] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option(help="name=low:high of the task, a factor or shift; name==low:high: its own values."),
    ] = None,
    minimise: Annotated[str | None, typer.Option(help="A measure or a number; default: success.")] = None,
    maximise: Annotated[str | None, typer.Option(help="The same.")] = None,
    success: Annotated[
        float | None, typer.Option(help="Share of worlds that has to succeed, with one of these.")
    ] = None,
    log: Annotated[list[str] | None, typer.Option(help="A number whose logarithm is looked for.")] = None,
    worlds: Annotated[int, typer.Option(help="Of every candidate, the same for all.")] = 256,
    rounds: Annotated[int, typer.Option(help="At most.")] = 40,
    candidates: Annotated[int | None, typer.Option(help="Of a round; default by how many numbers.")] = None,
    resolution: Annotated[float, typer.Option(help="Share of the ranges at which it ends.")] = 0.01,
    test_worlds: Annotated[int, typer.Option(help="Other worlds that judge what was found.")] = 1024,
    rules: HardRule = HARD_RULE,
    seed: Seed = 0,
    device: Device = None,
    dtype: Annotated[str, typer.Option(help="float32 or float64.")] = "float32",
    out: Annotated[Path, typer.Option(help="Table of all candidates, .csv.")] = Path("tuned.csv"),
    save: Annotated[
        Path | None, typer.Option(help="The policy that was found, .npz, if it is made of numbers.")
    ] = None,
) -> None:
    """Find numbers of a policy or a design that do best over a task's disturbed worlds."""
    path, kept = prepared(out, ".csv"), None if save is None else prepared(save, ".npz")
    chosen = slcp.load_task(task)
    numbers = dict(_range("--number", each) for each in number or [])
    parameters = dict(_range("--parameter", each) for each in parameter or [])
    case = rules.of(chosen.options)
    given = function_of(policy, list(numbers)) if numbers else policy_of_task(policy, chosen)
    if kept is not None:
        _check_saved(given, numbers)
    with timed("search"), progress_bar("worlds") as progress:
        found = slcp.tune(
            chosen, given, numbers, parameters=parameters, minimise=minimise, maximise=maximise,
            success=success, log=log, worlds=worlds, rounds=rounds, candidates=candidates,
            resolution=resolution, test_worlds=test_worlds, seed=seed, case=case, dtype=dtype, device=device,
            progress=progress,
        )  # fmt: skip
    found.save(path)
    console.print(str(found), markup=False, highlight=False)
    wrote(path)
    if kept is not None:
        slcp.policies.save_policy(found.policy, kept)
        wrote(kept)


def _check_saved(given: Any, numbers: dict[str, tuple[float, float]]) -> None:
    """Raise an error for a policy that could not be written once it is found."""
    middle = {name: 0.5 * (low + high) for name, (low, high) in numbers.items()}
    try:
        content_of(given(**middle) if numbers else given)
    except ArgumentError as error:
        raise ValueError(f"--save: {error}; the numbers that are found stand in the table of --out") from None


def _range(option: str, text: str) -> tuple[str, tuple[float, float]]:
    """A name with its range, of "name=low:high"."""
    name, _, values = text.partition("=")
    if values.startswith("="):
        name, values = f"{name}=", values[1:]
    try:
        low, high = map(float, values.split(":"))
    except ValueError:
        raise ValueError(f"{option} is {text!r:.60}; name=low:high is needed") from None
    return name, (low, high)
