"""A scene's kernels, ahead of what needs them: each kind of use once, at its smallest."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.kernels.device.progress import Loaded, recorded


def _controls(sim: slcp.Simulator) -> np.ndarray:
    return np.zeros((1, 1, sim.nu))


def _policies(sim: slcp.Simulator) -> dict[str, Any]:
    """A plan and a library of one entry."""
    gain = np.zeros((1, sim.nu, sim.nx))
    plan = SimpleNamespace(us=_controls(sim)[0], xs=np.tile(sim.scene.x0, (2, 1)), K=gain)
    one = np.zeros(1)
    entries = ddp.Library(
        x=sim.scene.x0[None], u=_controls(sim)[0], K=gain, cost=one, gain=one, age=one, chain=one, plan=one,
        period=sim.scene.state_period, header={"scene": sim.scene.name, "digest": scene_digest(sim.scene)},
    )  # fmt: skip
    return {"plan": ddp.TrackingPolicy(plan), "library": ddp.NearestPolicy(entries)}


def _sweep(sim: slcp.Simulator) -> None:
    """The sweep of a plan and of a library."""
    h = float(np.ravel(sim.params["step_size"])[0])
    spec = slcp.SweepSpec(
        worlds=1, duration=2 * h, window=h, sample_every=h, residuals=(sim.options.residual,), step_sizes=(h,)
    )
    scaling, integrator, dtype = sim.options.scaling, sim.options.integrator, sim.dtype.__name__
    for policy in _policies(sim).values():
        slcp.sweep(
            sim.scene, policy, spec, scaling=scaling, integrator=integrator, dtype=dtype, device=sim.device
        )


WHAT: dict[str, Callable[[slcp.Simulator], Any]] = {
    "step": lambda sim: sim.step(sim.scene.x0),
    "rollout": lambda sim: sim.rollout(sim.scene.x0[None], _controls(sim)),
    "gap": lambda sim: sim.rollout(sim.scene.x0[None], _controls(sim), record="gap"),
    "linearize": lambda sim: sim.linearize(sim.scene.x0),
    "second": lambda sim: sim.linearize(sim.scene.x0, second=True),
    "gradient": lambda sim: slcp.vjp(sim, sim.scene.x0[None], _controls(sim), np.ones((1, 2, sim.nx))),
    "sweep": _sweep,
}


def _plan_task(task: slcp.Task, sim: slcp.Simulator) -> None:
    ddp.plan(task, 1, sim=sim, options=ddp.Options(max_iterations=1))


def _sweep_task(task: slcp.Task, sim: slcp.Simulator) -> None:
    half = task.steps * task.scene.step_size / 2.0
    slcp.sweep(
        task, _policies(sim), worlds=1, cases=sim.options, step_sizes=(half,),
        dtype=sim.dtype.__name__, device=sim.device,
    )  # fmt: skip


OF_TASKS: dict[str, Callable[[slcp.Task, slcp.Simulator], Any]] = {"plan": _plan_task, "sweep": _sweep_task}


def compile_ahead(sim: slcp.Simulator, what: list[str], task: slcp.Task | None = None) -> list[Loaded]:
    """The kernels that some of `WHAT`, or of a task some of `OF_TASKS`, need, compiled or found."""
    with recorded() as kernels:
        for name in what:
            if task is not None and name in OF_TASKS:
                OF_TASKS[name](task, sim)
            else:
                WHAT[name](sim)
    return kernels
