"""`slcp compile`: compile a scene's kernels ahead, so that whatever uses them starts at once."""

import time
from dataclasses import replace
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.kernels.device.progress import Loaded

from ..stages.ahead import OF_TASKS, WHAT, compile_ahead
from ..support.options import Device, Dtype, Friction, Scaling, TaskIntegrator, TaskResidual
from ..support.screen import console, one_line_errors
from ..support.simulators import make_simulator, named_scene
from ..support.tasks import found_task, task_simulator


def chosen(text: str, sim: slcp.Simulator, task: slcp.Task | None = None) -> list[str]:
    """The names of --what; ValueError for one that there is not, or that the options do not have."""
    names = list(dict.fromkeys(name.strip() for name in text.split(",")))
    known = dict.fromkeys((*WHAT, *OF_TASKS))
    if [name for name in names if name not in known]:
        raise ValueError(f"--what is {text!r}; choose from {','.join(known)}")
    if task is None and "plan" in names:
        raise ValueError(f"--what is {text!r}; only a task is planned")
    if "sweep" in names and sim.options.friction != "anitescu":
        raise ValueError(f"--what is {text!r}; sweeps have Anitescu's friction, not --friction coulomb")
    return names


@one_line_errors
def compile_command(
    scene: Annotated[
        str, typer.Argument(help="A name or file of a task (`slcp tasks`) or of a scene (`slcp scenes`).")
    ],
    what: Annotated[
        str,
        typer.Option(help=f"What is compiled, names with commas: {', '.join(WHAT)}; of a task plan, too."),
    ] = "step,rollout",
    residual: TaskResidual = None,
    scaling: Scaling = None,
    friction: Friction = "anitescu",
    integrator: TaskIntegrator = None,
    device: Device = None,
    dtype: Dtype = "float64",
) -> None:
    """Compile the kernels of a task or a scene into the cache, ahead of what needs them.

    Kernels are found again by whatever has the same mechanism and options, whatever its numbers.
    """
    start = time.perf_counter()
    task = found_task(scene)
    if task is not None and friction != task.options.friction:
        task = task.replace(options=replace(task.options, friction=friction))
    if task is not None:
        sim = task_simulator(task, residual, scaling, device, dtype, integrator)
    else:
        mechanism, kind, rule = named_scene(scene, "SCENE"), residual or "smoothed", integrator or "euler"
        sim = make_simulator(mechanism, kind, scaling, device, dtype, rule, friction)
    kernels = compile_ahead(sim, chosen(what, sim, task), task)
    console.print(_summary(sim, kernels))
    made = sum(kernel.compiled for kernel in kernels)
    found = len(kernels) - made
    typer.echo(f"{made} compiled, {found} found in the cache: {time.perf_counter() - start:.1f} s")


def _summary(sim: slcp.Simulator, kernels: list[Loaded]) -> Table:
    table = Table(title=f"kernels of {sim.scene.name} for {sim.device.alias}", box=SIMPLE_HEAD)
    table.add_column("kernel")
    table.add_column("seconds", justify="right")
    table.add_column("")
    for kernel in kernels:
        state = "compiled" if kernel.compiled else "found"
        table.add_row(kernel.kernel, f"{kernel.seconds:.1f}", state)
    return table
