"""`slcp bench contacts`: what a step with many contacts costs, beside MuJoCo's and another version's."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from ...support.tables import write_csv
from ..cost.pair import PairError
from ..peers.mujoco_model import import_mujoco
from .cost import LAWS, Plan, bench_contacts
from .table import compared, print_compared, print_rows
from .worlds import ALL, MOTIONS, world

QUICK = ("stack:3", "stack:10", "stack:30")
SEEN = 400  # tumbling worlds that are judged
DTYPES = ("float64", "float32")


def _chosen(
    option: str, given: list[str] | None, offered: Iterable[str], else_: Iterable[str]
) -> tuple[str, ...]:
    for value in given or ():
        if value not in offered:
            raise ValueError(f"{option} is {value!r}; choose from {', '.join(offered)}")
    return tuple(given or else_)


def contacts_command(
    scene: Annotated[
        list[str] | None,
        typer.Option(
            help="Only stack:N, heap:N, discs:N, gas:N, beam:N, walker or hopper; may be given again."
        ),
    ] = None,
    law: Annotated[
        list[str] | None, typer.Option(help=f"Only {', '.join(LAWS)}; may be given again.")
    ] = None,
    motion: Annotated[list[str] | None, typer.Option(help=f"Only {' or '.join(MOTIONS)}.")] = None,
    dtype: Annotated[list[str] | None, typer.Option(help="Only float64 or float32.")] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Three rounds in float64, of three stacks if no scene is named.")
    ] = False,
    worlds: Annotated[int | None, typer.Option(min=1, help="Worlds of a call; by size if not given.")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Rounds; medians over them are reported.")] = 7,
    seed: Annotated[int, typer.Option(help="Seed of the velocities.")] = 0,
    strategy: Annotated[str, typer.Option(help="auto, specialised or generic kernels.")] = "auto",
    other: Annotated[str, typer.Option(help="Python interpreter of an environment to measure beside.")] = "",
    csv: Annotated[Path | None, typer.Option(help="Also write the results here, a row per case.")] = None,
    compare: Annotated[
        tuple[Path, Path] | None, typer.Option(help="Measure nothing: an old and a new --csv side by side.")
    ] = None,
) -> None:
    """A step of stacks, heaps, beams and legged robots, at rest and tumbling, beside MuJoCo's."""
    if compare is not None:
        print_compared(compared(*compare))
        return
    import_mujoco()
    plan = Plan(
        motions=_chosen("--motion", motion, MOTIONS, MOTIONS),
        laws=_chosen("--law", law, LAWS, LAWS),
        dtypes=_chosen("--dtype", dtype, DTYPES, DTYPES[:1] if quick else DTYPES),
        worlds=worlds, seen=1 if quick else SEEN, repeats=min(3, repeats) if quick else repeats, seed=seed,
        strategy=_chosen("--strategy", [strategy], ("auto", "specialised", "generic"), ())[0], other=other,
    )  # fmt: skip
    names = scene or (QUICK if quick else ALL)
    rows: list[dict[str, Any]] = []

    def done(new: list[dict[str, Any]]) -> None:
        print_rows(new)
        rows.extend(new)
        if csv is not None:
            write_csv(csv, rows)

    try:
        bench_contacts([world(name) for name in names], plan, typer.echo, done)
    except PairError as error:
        typer.echo(f"slcp: {error}", err=True)
        raise typer.Exit(1) from None
    if csv is not None:
        typer.echo(f"wrote {csv}")
