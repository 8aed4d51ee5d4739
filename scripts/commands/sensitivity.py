"""`slcp sensitivity`: which drawn numbers decide how a policy does."""

from pathlib import Path
from typing import Annotated

import typer

import slcp_warp as slcp
from slcp_warp.ensembles.questions.sensitivity import factors_of

from ..stages.task_sweep import tell_incomplete
from ..support.options import Device, Seed, refuse
from ..support.policies import POLICY, policies_of_task
from ..support.rules import HARD_RULE, RULES, HardRule, with_rules
from ..support.screen import console, one_line_errors, prepared, progress_bar, timed, wrote

OF_TASKS = {"samples", "worlds", "seed", "device", "dtype", *RULES}  # options that a report has no use for


@one_line_errors
@with_rules
def sensitivity_command(
    context: typer.Context,
    subject: Annotated[
        str,
        typer.Argument(
            metavar="TASK|REPORT", help="A task with --policy; or a report of `slcp sweep TASK`, of its rows."
        ),
    ],
    policy: Annotated[
        str | None, typer.Option(help=f"Of a task: {POLICY}. Of a report: its name; default: the first.")
    ] = None,
    measure: Annotated[str, typer.Option(help="success, or a measure.")] = "success",
    samples: Annotated[
        int, typer.Option(help="Of a task: n; n (d + 2) worlds run for d drawn numbers.")
    ] = 1024,
    worlds: Annotated[
        int | None, typer.Option(help="Of a task: so many in all, at most, in place of --samples.")
    ] = None,
    rules: HardRule = HARD_RULE,
    seed: Seed = 0,
    device: Device = None,
    dtype: Annotated[str, typer.Option(help="float32 or float64.")] = "float32",
    out: Annotated[Path, typer.Option(help="Table to write, .csv; `slcp chart` draws it.")] = Path(
        "sensitivity.csv"
    ),
) -> None:
    """Say which drawn numbers matter: shares of a measure's variance (Sobol indices).

    Of a task worlds are run for it; of a report the rows that are there give the indices of first order.
    """
    path = prepared(out, ".csv")
    if Path(subject).is_dir() or Path(subject).suffix in (".csv", ".npz", ".parquet"):
        refuse(context, OF_TASKS, "of a task; this is of a report")
        report = tell_incomplete(slcp.load_report(Path(subject)), subject)
        found = report.sensitivity(measure, policy)
    else:
        task = slcp.load_task(subject)
        if worlds is not None:
            refuse(context, {"samples"}, "and --worlds, too; one of them")
            samples = samples_within(worlds, task)
        case = rules.of(task.options)
        with timed("sensitivity"), progress_bar("worlds") as progress:
            found = slcp.sensitivity(
                task, policies_of_task(policy, task), measure=measure, samples=samples, seed=seed,
                case=case, dtype=dtype, device=device, progress=progress,
            )  # fmt: skip
    found.save(path)
    console.print(str(found), markup=False, highlight=False)
    wrote(path)


def samples_within(worlds: int, task: slcp.Task) -> int:
    """Samples n for which n (d + 2) worlds, of d drawn numbers, are at most so many."""
    each = len(factors_of(task)) + 2
    if worlds < 2 * each:
        raise ValueError(f"--worlds is {worlds}; of {each - 2} drawn numbers {2 * each} or more are needed")
    return worlds // each
