"""What the sections use, each at its smallest, so that its kernels are compiled by running it once."""

import contextlib
from collections.abc import Callable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.ensembles.sweep import sweep_scene
from slcp_warp.kernels.device import cache

from .product import PRODUCT, there
from .setting import METHODS, SINGLE, Setting, cast

LIBRARY = 2000  # entries


def start(sim: slcp.Simulator) -> tuple[np.ndarray, np.ndarray]:
    """The scene's state and no controls: one world, two steps."""
    x, us = cast(sim.dtype.__name__, sim.scene.x0[None], np.zeros((1, 2, sim.nu)))
    return x, us


def problem(setting: Setting, dtype: str, horizon: int, device: str | None = None) -> ddp.Problem:
    """The paper's problem over a horizon."""
    cost = slcp.tasks.flicking_finger().cost
    return ddp.Problem(setting.finger(dtype, device=device), cost, horizon=horizon)


def workspace(
    setting: Setting, dtype: str, batch: int, passes: int, device: str | None = None
) -> ddp.Workspace:
    """Room for passes that none of the problems ends early."""
    options = ddp.Options(max_iterations=passes, gradient_tolerance=0.0, improvement_tolerance=0.0)
    return ddp.Workspace(problem(setting, dtype, setting.sizes.horizon, device), batch, options)


def plan(setting: Setting, dtype: str) -> ddp.TrackingPolicy:
    """A plan of few passes, tracked."""
    x0 = slcp.scenes.flicking_finger().x0
    done = workspace(setting, dtype, 1, 3).solve(x0, np.zeros((setting.sizes.horizon, 2)))
    return ddp.TrackingPolicy(done)


def library(setting: Setting) -> ddp.NearestPolicy:
    """A library of states of random rollouts with the controls that were applied there."""
    work = setting.workload(max(1, LIBRARY // 20), 20)
    sim = setting.finger(SINGLE)
    x, us = cast(SINGLE, work.x0, work.controls)
    states = sim.rollout(x, us).states[:, :-1].reshape(-1, sim.nx)
    entries = len(states)
    one, scene, us = np.zeros(entries), sim.scene, work.controls.reshape(-1, sim.nu)
    whole = ddp.Library(
        x=states.astype(float), u=us, K=np.zeros((entries, sim.nu, sim.nx)), cost=one, gain=one, age=one,
        chain=one, plan=one, period=scene.state_period,
        header={"scene": scene.name, "digest": scene_digest(scene)},
    )  # fmt: skip
    return whole.policy()


def sweep(setting: Setting, policy: Any, worlds: int, duration: float) -> Any:
    """A sweep of the finger in single precision, of the smoothed and of the hard problem."""
    spec = slcp.SweepSpec(worlds=worlds, duration=duration, parameter_sd={"mass": 0.1}, torque_sd=0.1)
    scene = slcp.scenes.flicking_finger()
    return sweep_scene(scene, policy, spec, scaling="none", device=setting.device)


def _step(method: str, setting: Setting, dtype: str) -> None:
    sim = setting.finger(dtype, method)
    sim.step(start(sim)[0])


def _rollout(method: str, setting: Setting, dtype: str) -> None:
    sim = setting.finger(dtype, method)
    sim.rollout(*start(sim))


def _linearize(setting: Setting, dtype: str) -> None:
    sim = setting.finger(dtype)
    sim.linearize(start(sim)[0])


def _adjoint(setting: Setting, dtype: str) -> None:
    sim = setting.finger(dtype)
    x, us = start(sim)
    slcp.vjp(sim, x, us, np.ones((1, 3, sim.nx)))


def _by_mass(setting: Setting, dtype: str) -> None:
    sim = setting.finger(dtype)
    x, us = start(sim)
    slcp.vjp(sim, x, us, np.ones((1, 3, sim.nx)), parameters="mass")


def _taped_step(setting: Setting, dtype: str) -> None:
    sim = setting.finger(dtype)
    x: Any = wp.array(start(sim)[0], dtype=sim.dtype, device=sim.device, requires_grad=True)
    with wp.Tape() as tape:
        state = sim.step(x).state
    tape.backward(grads={state: wp.ones(state.shape, dtype=sim.dtype, device=sim.device)})


def _generic(setting: Setting, dtype: str) -> None:
    sim = setting.stack(dtype)
    sim.step(start(sim)[0])
    sim.rollout(*start(sim))


def _generic_linearize(setting: Setting, dtype: str) -> None:
    sim = setting.stack(dtype)
    sim.linearize(start(sim)[0])


def _generic_adjoint(setting: Setting, dtype: str) -> None:
    sim = setting.stack(dtype)
    slcp.vjp(sim, *start(sim), np.ones((1, 3, sim.nx)), parameters="mass")


def _planning(setting: Setting, dtype: str) -> None:
    plan(setting, dtype)


def _sweep(under: str, setting: Setting, dtype: str) -> None:
    if dtype == SINGLE:
        us, xs = np.zeros((2, 2)), np.tile(slcp.scenes.flicking_finger().x0, (3, 1))
        still = SimpleNamespace(us=us, xs=xs, K=np.zeros((2, 2, 6)))
        policy = library(setting) if under == "library" else ddp.TrackingPolicy(still)
        sweep(setting, policy, 1, 1.0)


def _block(block: int, setting: Setting, dtype: str) -> None:
    if dtype == SINGLE:
        with threads_of_a_block(setting.device, block):
            _rollout("smoothed", setting, dtype)


@contextlib.contextmanager
def threads_of_a_block(device: str, count: int) -> Iterator[None]:
    """Launches on a GPU with so many threads of a block, for which kernels are loaded anew."""
    alias, before = wp.get_device(device).alias, cache.BLOCK
    kept = cache._loaded.pop(alias, None)
    cache.BLOCK = count
    try:
        yield
    finally:
        cache.BLOCK = before
        cache._loaded.pop(alias, None)
        if kept is not None:
            cache._loaded[alias] = kept


COMPARED = (
    *("planning", "adjoint by mass", "linearize smoothed", "rollout smoothed"),
    *("generic", "generic linearize", "generic adjoint"),
    *(f"step {name}" for name in METHODS),
)


def _product(name: str, setting: Setting, dtype: str) -> None:
    if dtype == SINGLE:  # each has precisions of its own
        PRODUCT[name].run(setting.device)


def uses_of(setting: Setting) -> dict[str, Callable[[Setting, str], None]]:
    """Every use of kernels by name."""
    product = {f"product: {name}": partial(_product, name) for name, use in PRODUCT.items() if there(use)}
    return USES | product | {f"blocks of {block}": partial(_block, block) for block in setting.sizes.blocks}


USES: dict[str, Callable[[Setting, str], None]] = {  # the longest first
    "planning": _planning, "adjoint by mass": _by_mass, "adjoint smoothed": _adjoint,
    "linearize smoothed": _linearize, "generic adjoint": _generic_adjoint,
    "generic linearize": _generic_linearize, "generic": _generic,
    "sweep under a library": partial(_sweep, "library"), "sweep under a plan": partial(_sweep, "plan"),
    **{f"step {name}": partial(_step, name) for name in ("coulomb", "smoothed", "hard")},
    **{f"rollout {name}": partial(_rollout, name) for name in ("smoothed", "hard")},
    "steps on a tape": _taped_step,
}  # fmt: skip
