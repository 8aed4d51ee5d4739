"""`slcp compile`: compile a scene's kernels ahead, so that whatever uses them starts at once."""

import contextlib
import time
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.kernels.device.cache import compiling_for
from slcp_warp.kernels.device.progress import Loaded

from ..stages.ahead import OF_TASKS, WHAT, compile_ahead
from ..support.options import Device
from ..support.rules import NO_RULE, OneRule, with_rules
from ..support.screen import console, one_line_errors
from ..support.simulators import make_simulator, named_scene
from ..support.tasks import found_task, task_simulator


def chosen(text: str) -> list[str]:
    """The names of --what; ValueError for one that there is not."""
    names = list(dict.fromkeys(name.strip() for name in text.split(",")))
    known = dict.fromkeys((*WHAT, *OF_TASKS))
    if [name for name in names if name not in known]:
        raise ValueError(f"--what is {text!r}; choose from {','.join(known)}")
    return names


@one_line_errors
@with_rules
def compile_command(
    scene: Annotated[
        str, typer.Argument(help="A name or file of a task (`slcp tasks`) or of a scene (`slcp scenes`).")
    ],
    what: Annotated[
        str, typer.Option(help=f"What is compiled, names with commas: {', '.join((*WHAT, *OF_TASKS))}.")
    ] = "step,rollout",
    rules: OneRule = NO_RULE,
    device: Device = None,
    dtype: Annotated[
        str | None, typer.Option(help="float64 or float32; default: float64, and float32 for sweeps.")
    ] = None,
    arch: Annotated[
        int | None,
        typer.Option(help="A GPU's kernels, also for a kind that need not be here: 90 for sm_90."),
    ] = None,
) -> None:
    """Compile the kernels of a task or a scene into the cache, ahead of what needs them.

    Kernels are found again by whatever has the same mechanism and options, whatever its numbers; those of a
    sweep are the hard problem's, too. What the scene or the options do not have is left out and said; the
    exit status is 1 then.
    """
    start = time.perf_counter()
    task = found_task(scene)
    names = chosen(what)
    mechanism = named_scene(scene, "SCENE") if task is None else task.scene

    def make(precision: str) -> slcp.Simulator:
        if task is not None:
            return task_simulator(task, rules, device, precision)
        return make_simulator(mechanism, rules, device, precision)

    with contextlib.nullcontext() if arch is None else compiling_for(arch):
        ahead = compile_ahead(make, names, task, dtype)
    kernels = ahead.kernels
    if not kernels and ahead.impossible:  # nothing of what was asked for
        raise ValueError("; ".join(f"{name}: {why}" for name, why in ahead.impossible.items()))
    console.print(_summary(mechanism.name, kernels))
    made = sum(kernel.compiled for kernel in kernels)
    found = len(kernels) - made
    typer.echo(f"{made} compiled, {found} found in the cache: {time.perf_counter() - start:.1f} s")
    for name, why in ahead.impossible.items():
        typer.echo(f"slcp: nothing compiled for {name}: {why}", err=True)
    if ahead.impossible:
        raise typer.Exit(1)


def _summary(scene: str, kernels: list[Loaded]) -> Table:
    table = Table(title=f"kernels of {scene}", box=SIMPLE_HEAD)
    table.add_column("kernel")
    table.add_column("for")
    table.add_column("seconds", justify="right")
    table.add_column("")
    for kernel in kernels:
        state = "compiled" if kernel.compiled else "found"
        table.add_row(kernel.kernel, kernel.device, f"{kernel.seconds:.1f}", state)
    return table
