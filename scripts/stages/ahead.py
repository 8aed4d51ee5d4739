"""A scene's kernels, ahead of what needs them: each kind of use once, at its smallest."""

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.kernels.device.progress import Loaded, recorded


def _controls(sim: slcp.Simulator) -> np.ndarray:
    return np.zeros((1, 1, sim.nu))


def _policies(sim: slcp.Simulator) -> dict[str, Any] | None:
    """A plan and a library of one entry; None: there are no controls."""
    if not sim.nu:
        return None
    gain = np.zeros((1, sim.nu, sim.nx))
    plan = SimpleNamespace(us=_controls(sim)[0], xs=np.tile(sim.scene.x0, (2, 1)), K=gain)
    one = np.zeros(1)
    entries = ddp.Library(
        x=sim.scene.x0[None], u=_controls(sim)[0], K=gain, cost=one, gain=one, age=one, chain=one, plan=one,
        period=sim.scene.state_period, header={"scene": sim.scene.name, "digest": scene_digest(sim.scene)},
    )  # fmt: skip
    return {"plan": ddp.TrackingPolicy(plan), "library": ddp.NearestPolicy(entries)}


def _task_of(sim: slcp.Simulator) -> slcp.Task:
    """A task of a scene, with the kernels of all tasks whose cost is terms and whose measures are data."""
    cost = slcp.costs.terms(sim.scene, [slcp.costs.Term("square", 1.0, state=0)])
    return slcp.Task(sim.scene.name, sim.scene, cost, horizon=2, options=sim.options)


WHAT: dict[str, Callable[[slcp.Simulator], Any]] = {
    "step": lambda sim: sim.step(sim.scene.x0),
    "rollout": lambda sim: sim.rollout(sim.scene.x0[None], _controls(sim)),
    "gap": lambda sim: sim.rollout(sim.scene.x0[None], _controls(sim), record="gap"),
    "linearize": lambda sim: sim.linearize(sim.scene.x0),
    "second": lambda sim: sim.linearize(sim.scene.x0, second=True),
    "gradient": lambda sim: slcp.vjp(sim, sim.scene.x0[None], _controls(sim), np.ones((1, 2, sim.nx))),
}


def _plan(task: slcp.Task, sim: slcp.Simulator) -> None:
    ddp.plan(task, 4, sim=sim, options=ddp.Options(max_iterations=1), sampling=ddp.Sampling(iterations=1))


def _sweep(task: slcp.Task, sim: slcp.Simulator) -> None:
    half = task.steps * task.scene.step_size / 2.0
    slcp.sweep(
        task.replace(options=sim.options), _policies(sim), worlds=1, step_sizes=(half,),
        dtype=sim.dtype.__name__, device=sim.device,
    )  # fmt: skip


OF_TASKS: dict[str, Callable[[slcp.Task, slcp.Simulator], Any]] = {"plan": _plan, "sweep": _sweep}
SINGLE = ("sweep",)  # what runs in single precision where nothing else is asked for


@dataclass(frozen=True)
class Ahead:
    """What came of compiling ahead.

    Attributes:
        kernels: that were compiled or found.
        impossible: why, by name, of what the scene or the options do not have.
    """

    kernels: list[Loaded]
    impossible: dict[str, str]


def compile_ahead(
    make: Callable[[str], slcp.Simulator], what: list[str], task: slcp.Task | None = None,
    dtype: str | None = None,
) -> Ahead:  # fmt: skip
    """The kernels that some of `WHAT` and `OF_TASKS` need, compiled or found; what cannot be is left out.

    Args:
        make: a simulator of a precision.
        what: names.
        task: whose sweeps and plans; None: of the scene alone.
        dtype: None: float64, and float32 for sweeps.
    """
    impossible = {}
    with recorded() as kernels:
        for name in what:
            sim = make(dtype or ("float32" if name in SINGLE else "float64"))
            try:
                if name in OF_TASKS:
                    OF_TASKS[name](_task_of(sim) if task is None else task, sim)
                else:
                    WHAT[name](sim)
            except slcp.InputError as error:
                impossible[name] = str(error)
    return Ahead(kernels, impossible)
