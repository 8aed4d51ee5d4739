"""`slcp falsify`: the smallest disturbance that makes a policy fail, as a scenario that runs again."""

from pathlib import Path
from typing import Annotated

import typer

import slcp_warp as slcp

from ..support.options import Device, Seed
from ..support.policies import TaskPolicy, policy_of_task
from ..support.rules import HARD_RULE, HardRule, with_rules
from ..support.screen import checked_folder, console, one_line_errors, timed, waiting, wrote
from ..support.tasks import TaskName


@one_line_errors
@with_rules
def falsify_command(
    task: TaskName,
    policy: TaskPolicy = None,
    out: Annotated[Path, typer.Option(help="Folder for scenario, run, table, chart.")] = Path("falsified"),
    by: Annotated[str, typer.Option(help="kick, push, start, parameters or all.")] = "kick",
    time: Annotated[
        float | None, typer.Option(help="Of the kick or push [s]; default: the task's, or 0.")
    ] = None,
    body: Annotated[
        str | None, typer.Option(help="That is pushed; default: the task's, or the scene's last.")
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Of the push [s]; default: the task's, or 0.1.")
    ] = None,
    at: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="The point that is pushed, in the body's frame [m]; default: the task's, or its end."
        ),
    ] = None,
    most: Annotated[
        float | None, typer.Option(help="Largest size [standard deviations]; default: 32, then 256.")
    ] = None,
    worlds: Annotated[int, typer.Option(help="Worlds that are tried at once.")] = 4096,
    gradients: Annotated[
        bool, typer.Option("--gradients", help="Use derivatives through contact, too.")
    ] = False,
    rules: HardRule = HARD_RULE,
    seed: Seed = 0,
    device: Device = None,
    dtype: Annotated[str, typer.Option(help="float32 or float64.")] = "float32",
) -> None:
    """Find the smallest disturbance under which a policy fails, and save it."""
    from ..charts.falsify import falsify_chart  # it loads matplotlib

    out, chosen = checked_folder(out), slcp.load_task(task)
    followed = policy_of_task(policy, chosen)
    options = rules.of(chosen.options)
    with timed("search"), waiting("worlds") as shown:
        found = slcp.falsify(
            chosen, followed, by, time=time, body=body, duration=duration, at=at, most=most,
            worlds=worlds, gradients=gradients, case=options, seed=seed, dtype=dtype, device=device,
            progress=lambda count: shown(f"{count:,} worlds"),
        )  # fmt: skip
    console.print(str(found), highlight=False, soft_wrap=True)
    out.mkdir(parents=True, exist_ok=True)
    written = [found.save(out / "falsification.csv")]
    if found.found:
        written.append(found.replay(followed, options).save(out / "run.npz"))
    if found.scenario is not None:
        written.append(out / "scenario.json")
        slcp.save_task(found.scenario, written[-1])
    written.append(falsify_chart(out / "falsification.csv", out / "falsification.png"))
    for path in written:
        wrote(Path(path))
