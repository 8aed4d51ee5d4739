"""`slcp map`: how often a policy succeeds over a grid of two numbers."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import slcp_warp as slcp

from ..support.options import Device, Seed
from ..support.policies import TaskPolicy, function_of, policies_of_task
from ..support.rules import HARD_RULE, HardRule, with_rules
from ..support.screen import console, one_line_errors, prepared, progress_bar, timed, wrote
from ..support.tasks import TaskName

MOST = 1024  # values of an axis


@one_line_errors
@with_rules
def map_command(
    task: TaskName,
    x: Annotated[
        str,
        typer.Option(
            help="name=low:high:count, of a parameter, a state or kicks; name==... for its own values."
        ),
    ],
    y: Annotated[str, typer.Option(help="The same of another.")],
    policy: TaskPolicy = None,
    number: Annotated[
        list[str] | None,
        typer.Option(help="A name of x or y that is an argument of --policy file.py:function."),
    ] = None,
    worlds: Annotated[int, typer.Option(help="Disturbed worlds of every cell, the same in all.")] = 256,
    rules: HardRule = HARD_RULE,
    seed: Seed = 0,
    device: Device = None,
    dtype: Annotated[str, typer.Option(help="float32 or float64.")] = "float32",
    out: Annotated[Path, typer.Option(help="Table to write, .csv; `slcp chart` draws it.")] = Path("map.csv"),
) -> None:
    """Map where a policy holds: its share of successes over factors, shifts, or its own numbers."""
    path = prepared(out, ".csv")
    chosen, axes = slcp.load_task(task), (_axis("--x", x), _axis("--y", y))
    case = rules.of(chosen.options)
    given = function_of(policy, number) if number else policies_of_task(policy, chosen)
    with timed("map"), progress_bar("worlds") as progress:
        found = slcp.robustness_map(
            chosen, given, *axes, numbers=number or (), worlds=worlds, seed=seed,
            case=case, dtype=dtype, device=device, progress=progress,
        )  # fmt: skip
    found.save(path)
    console.print(str(found), markup=False, highlight=False)
    wrote(path)


def _axis(option: str, text: str) -> tuple[str, np.ndarray]:
    """A name with evenly spaced values, of "name=low:high:count"."""
    name, _, values = text.partition("=")
    if values.startswith("="):
        name, values = f"{name}=", values[1:]
    try:
        low, high, count = values.split(":")
        if not 1 <= int(count) <= MOST:
            raise ValueError
        return name, np.linspace(float(low), float(high), int(count))
    except ValueError:
        raise ValueError(
            f"{option} is {text!r:.60}; name=low:high:count is needed, with at most {MOST} values"
        ) from None
