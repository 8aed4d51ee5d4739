"""`slcp tasks`: the named tasks, and what each is about."""

import typer

import slcp_warp as slcp

from ..support.screen import one_line_errors


@one_line_errors
def tasks_command() -> None:
    """List the named tasks: what is to be done, and how large each is."""
    for name, make in slcp.tasks.NAMED.items():
        task = make()
        about = (make.__doc__ or "").strip().splitlines()[0]
        size = f"nv {task.scene.nv}, nu {task.scene.nu}, rows {task.scene.structure.nr}"
        typer.echo(f"{name}: {size}; {task.horizon} steps of {task.scene.step_size:g} s. {about}")
        typer.echo(f"    measures {', '.join(task.measures)}")
