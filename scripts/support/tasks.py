"""A command's task, and simulators of it with the command's options."""

from pathlib import Path
from typing import Annotated, Any

import typer

import slcp_warp as slcp
from slcp_warp.tasks.files import says_task

from .rules import NO_RULE, OneRule
from .simulators import simulator_of

DEFAULT = next(iter(slcp.tasks.NAMED))
HELP = "A name of `slcp tasks`, a .toml or .json file, or file.py:name"
TaskName = Annotated[str, typer.Argument(metavar="TASK", help=HELP + ".")]
OptionalTask = Annotated[
    str | None, typer.Argument(metavar="TASK", help=HELP + "; without one it is about --scene.")
]


def task_simulator(
    task: slcp.Task, rules: OneRule = NO_RULE, device: str | None = None, dtype: str = "float64"
) -> slcp.Simulator:
    """A simulator of a task, with the options of a command."""
    return simulator_of(task.scene, rules.of(task.options), device, dtype)


def tell_timing(task: slcp.Task, delayed: bool = False) -> None:
    """Say what plans of a task know nothing of: its hold and a drawn delay, and any delay unless they are
    `delayed` as the task has it.
    """
    words, d = {"delay": "delays controls by", "hold": "holds controls for"}, task.disturbances
    known = ("delay",) if delayed and not isinstance(d.delay, slcp.Uniform) else ()
    spans = [
        f"{word} {_span(getattr(d, name))} s"
        for name, word in words.items()
        if getattr(d, name) and name not in known
    ]
    if spans:
        typer.echo(f"slcp: the task {' and '.join(spans)}; plans are made without", err=True)


def _span(given: Any) -> str:
    return f"{given.low:g} to {given.high:g}" if isinstance(given, slcp.Uniform) else f"{given:g}"


def found_task(name: str) -> slcp.Task | None:
    """The task of a name or a file; None: it is no task's, but a scene's, perhaps."""
    path = Path(name)
    is_file = path.suffix in (".toml", ".json") and path.is_file() and says_task(path)
    return slcp.load_task(name) if is_file or name in slcp.tasks.NAMED or ".py:" in name else None
