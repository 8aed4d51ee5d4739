"""`slcp compile`: compile a scene's kernels ahead, so that whatever uses them starts at once."""

import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Annotated, Any

import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.kernels.device.progress import Loaded, recorded

from .support.common import (
    Device,
    Dtype,
    Friction,
    Integrator,
    Residual,
    Scaling,
    console,
    make_simulator,
    named_scene,
    one_line_errors,
)


def _controls(sim: slcp.Simulator) -> np.ndarray:
    return np.zeros((1, 1, sim.nu))


def _sweep(sim: slcp.Simulator) -> None:
    """The sweep of a plan and of a library."""
    gain = np.zeros((1, sim.nu, sim.nx))
    plan = SimpleNamespace(us=_controls(sim)[0], xs=np.tile(sim.scene.x0, (2, 1)), K=gain)
    one = np.zeros(1)
    entries = ddp.Library(
        x=sim.scene.x0[None], u=_controls(sim)[0], K=gain, cost=one, gain=one, age=one, chain=one, plan=one,
        period=sim.scene.state_period, header={"scene": sim.scene.name, "digest": scene_digest(sim.scene)},
    )  # fmt: skip
    h = float(np.ravel(sim.params["step_size"])[0])
    spec = slcp.SweepSpec(
        worlds=1, duration=2 * h, window=h, sample_every=h, residuals=(sim.options.residual,), step_sizes=(h,)
    )
    scaling, integrator, dtype = sim.options.scaling, sim.options.integrator, sim.dtype.__name__
    for policy in (ddp.TrackingPolicy(plan), ddp.NearestPolicy(entries)):
        slcp.sweep(
            sim.scene, policy, spec, scaling=scaling, integrator=integrator, dtype=dtype, device=sim.device
        )


WHAT: dict[str, Callable[[slcp.Simulator], Any]] = {  # each runs once, at its smallest
    "step": lambda sim: sim.step(sim.scene.x0),
    "rollout": lambda sim: sim.rollout(sim.scene.x0[None], _controls(sim)),
    "gap": lambda sim: sim.rollout(sim.scene.x0[None], _controls(sim), record="gap"),
    "linearize": lambda sim: sim.linearize(sim.scene.x0),
    "second": lambda sim: sim.linearize(sim.scene.x0, second=True),
    "gradient": lambda sim: slcp.vjp(sim, sim.scene.x0[None], _controls(sim), np.ones((1, 2, sim.nx))),
    "sweep": _sweep,
}


def compile_ahead(sim: slcp.Simulator, what: list[str]) -> list[Loaded]:
    """The kernels that some of `WHAT` need, compiled or found in the cache."""
    with recorded() as kernels:
        for name in what:
            WHAT[name](sim)
    return kernels


def chosen(text: str, sim: slcp.Simulator) -> list[str]:
    """The names of --what; ValueError for one that there is not, or that the options do not have."""
    names = list(dict.fromkeys(name.strip() for name in text.split(",")))
    wrong = [name for name in names if name not in WHAT]
    if wrong:
        raise ValueError(f"--what is {text!r}; choose from {','.join(WHAT)}")
    if "sweep" in names and sim.options.friction != "anitescu":
        raise ValueError(f"--what is {text!r}; sweeps have Anitescu's friction, not --friction coulomb")
    return names


@one_line_errors
def compile_command(
    scene: Annotated[str, typer.Argument(help="A name of `slcp scenes`, or a .toml, .json or .xml file.")],
    what: Annotated[
        str, typer.Option(help=f"What is compiled, names with commas: {', '.join(WHAT)}.")
    ] = "step,rollout",
    residual: Residual = "smoothed",
    scaling: Scaling = None,
    friction: Friction = "anitescu",
    integrator: Integrator = "euler",
    device: Device = None,
    dtype: Dtype = "float64",
) -> None:
    """Compile a scene's kernels into the cache, ahead of what needs them.

    Kernels are found again by whatever has the same mechanism and options, whatever its numbers.
    """
    start = time.perf_counter()
    sim = make_simulator(named_scene(scene, "SCENE"), residual, scaling, device, dtype, integrator, friction)
    kernels = compile_ahead(sim, chosen(what, sim))
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
