"""`slcp tasks`: the named tasks, and what each is about."""

from pathlib import Path
from typing import Annotated

import typer

import slcp_warp as slcp

from ..support.screen import one_line_errors, prepared, wrote


@one_line_errors
def tasks_command(
    out: Annotated[Path | None, typer.Option(help="A picture of all of them to write, .png.")] = None,
) -> None:
    """List the named tasks: what is to be done, and how large each is; with --out draw them on one sheet."""
    path = None if out is None else prepared(out, ".png")
    for name, make in slcp.tasks.NAMED.items():
        task = make()
        about = (make.__doc__ or "").strip().splitlines()[0]
        size = f"nv {task.scene.nv}, nu {task.scene.nu}, rows {task.scene.structure.nr}"
        typer.echo(f"{name}: {size}; {task.horizon} steps of {task.scene.step_size:g} s. {about}")
        typer.echo(f"    measures {', '.join(task.measures)}")
    if path is not None:
        from ..charts.task_sheet import sheet  # it loads matplotlib

        wrote(sheet([make() for make in slcp.tasks.NAMED.values()], path))
