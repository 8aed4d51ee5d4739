"""`slcp rare`: the share of worlds in which a policy fails, too small to count."""

from pathlib import Path
from typing import Annotated

import typer

import slcp_warp as slcp

from ..support.options import Device, Seed
from ..support.policies import TaskPolicy, policy_of_task
from ..support.rules import HARD_RULE, HardRule, with_rules
from ..support.screen import console, one_line_errors, prepared, timed, waiting, wrote
from ..support.tasks import TaskName


@one_line_errors
@with_rules
def rare_command(
    task: TaskName,
    policy: TaskPolicy = None,
    out: Annotated[Path, typer.Option(help="Table of the levels on the way, .csv.")] = Path("rare.csv"),
    failing: Annotated[
        Path | None, typer.Option(help="Worlds that failed, .npz, for `slcp sweep --given`.")
    ] = None,
    rules: HardRule = HARD_RULE,
    islands: Annotated[int, typer.Option(help="Independent runs, whose spread gives the interval.")] = 20,
    particles: Annotated[int, typer.Option(help="Worlds a level and an island.")] = 500,
    length: Annotated[int, typer.Option(help="States of a chain.")] = 20,
    smallest: Annotated[float, typer.Option(help="Share below which the search ends.")] = 1e-9,
    seed: Seed = 0,
    device: Device = None,
    dtype: Annotated[str, typer.Option(help="float32 or float64.")] = "float32",
) -> None:
    """Estimate the share of a task's disturbed worlds in which a policy fails, by multilevel splitting."""
    path, chosen = prepared(out, ".csv"), slcp.load_task(task)
    kept = None if failing is None else prepared(failing, ".npz", "--failing")
    followed = policy_of_task(policy, chosen)
    options = rules.of(chosen.options)
    with timed("splitting"), waiting("worlds") as shown:
        found = slcp.failure_share(
            chosen, followed, case=options, islands=islands, particles=particles, length=length,
            smallest=smallest, seed=seed, dtype=dtype, device=device,
            progress=lambda count: shown(f"{count:,} worlds"),
        )  # fmt: skip
    written = [found.save(path)]
    if kept is not None and found.failing is not None:
        written.append(slcp.save_worlds(found.failing, kept))
    console.print(str(found), markup=False, highlight=False, soft_wrap=True)
    for each in written:
        wrote(each)
