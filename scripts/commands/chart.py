"""`slcp chart`: every picture, from saved files only."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from slcp_warp.runs.manifest import NAME as MANIFEST

from ..support.checkout import need_checkout
from ..support.screen import checked_folder, one_line_errors, wrote

if TYPE_CHECKING:
    from ..charts.files import Order


@one_line_errors
def chart_command(
    files: Annotated[list[Path], typer.Argument(help="Files of the other commands, or folders of them.")],
    out: Annotated[Path, typer.Option(help="Folder for the pictures.")] = Path("figures"),
    world: Annotated[int, typer.Option(help="World of a trajectory to draw.")] = 0,
) -> None:
    """Draw pictures from saved files: contact surface, library, limit cycle, animation, trace, robustness."""
    from ..charts.files import chart_files, files_in, worlds_of  # it loads matplotlib

    out, others = checked_folder(out), {"results": _results}
    chosen: list[Path] = []
    for path in files:
        if path.is_dir() and not (path / MANIFEST).is_file():
            inside, none = files_in(path, others)
            for file in none:
                typer.echo(f"{file} is left out: no picture is made of such a table")
            if not inside:
                raise ValueError(f"{path} holds no .npz file and no .csv that a picture is made of")
            chosen += inside
        else:
            chosen.append(path)
    for picture in chart_files(chosen, out, world, others):
        wrote(picture)
    for path in chosen:
        if (count := worlds_of(path)) > 1:
            typer.echo(f"{path} has {count} worlds; world {world} is drawn, another by --world")


def _results(order: "Order") -> list[Path]:
    """The charts of `slcp bench charts`, drawn by the benchmarks."""
    need_checkout("the charts of `slcp bench charts`")
    from ..benchmarks.accuracy.command import draw_file  # not in the wheel

    return draw_file(order.path, order.out)
