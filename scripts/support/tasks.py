"""A command's task, and simulators of it with the command's options."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

import slcp_warp as slcp
from slcp_warp.tasks.files import says_task

from .simulators import RESIDUALS

DEFAULT = next(iter(slcp.tasks.NAMED))
HELP = "A name of `slcp tasks`, a .toml or .json file, or file.py:name"
TaskName = Annotated[str, typer.Argument(metavar="TASK", help=HELP + ".")]
OptionalTask = Annotated[
    str | None, typer.Argument(metavar="TASK", help=HELP + "; without one it is about --scene.")
]


def task_simulator(
    task: slcp.Task,
    residual: str | None = None,
    scaling: str | None = None,
    device: str | None = None,
    dtype: str = "float64",
    integrator: str | None = None,
) -> slcp.Simulator:
    """A simulator of a task; None: the task's choice."""
    if residual is not None and residual not in RESIDUALS:
        raise ValueError(f"--residual is {residual!r}; choose one of {list(RESIDUALS)}")
    given: dict[str, Any] = {
        "residual": None if residual is None else RESIDUALS[residual],
        "scaling": scaling,
        "integrator": integrator,
    }
    options = replace(task.options, **{name: value for name, value in given.items() if value is not None})
    try:
        return task.simulator(options, device=device, dtype=dtype)
    except RuntimeError as error:  # Warp's answer to an unknown device
        raise ValueError(f"--device {device!r}: {error}") from error


def found_task(name: str) -> slcp.Task | None:
    """The task of a name or a file; None: it is no task's, but a scene's, perhaps."""
    path = Path(name)
    is_file = path.suffix in (".toml", ".json") and path.is_file() and says_task(path)
    return slcp.load_task(name) if is_file or name in slcp.tasks.NAMED or ".py:" in name else None
