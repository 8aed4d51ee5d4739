"""`slcp bench gradients`: what gradients of rollouts cost, in time against the rollout and in memory,
`slcp bench products`: what products with derivatives cost, and `slcp bench libraries`: what it costs to come
from PyTorch or JAX.
"""

import functools
import importlib.util
import resource
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp

from ..shared.optional import load
from ..shared.ours import PAPER, Ours, cpu_threads
from ..shared.timing import Case, print_table, tidy_rows, time_interleaved
from ..shared.workload import make_workload

MEGABYTE = 1024.0  # ru_maxrss is in kilobytes on Linux


def bench_gradients(worlds: int, steps: int, every: int, repeats: int, seed: int) -> list[dict[str, Any]]:
    """Rollouts of the finger, float32, and their gradients by x0, controls and parameters, one thread."""
    sim = slcp.Simulator(slcp.scenes.flicking_finger(), PAPER, device="cpu", dtype="float32")
    rng = np.random.default_rng(seed)
    start = sim.scene.x0 + 0.1 * rng.standard_normal((worlds, sim.nx))
    torque = rng.standard_normal((worlds, steps, sim.nu))

    def put(a: np.ndarray) -> wp.array:
        return wp.array(a, dtype=wp.float32, device="cpu", requires_grad=True)

    def gradient(count: int, checkpoint: int | None, tracked: bool) -> None:
        x0, us = put(start[:count]), put(torque[:count])
        params = sim.params.track() if tracked else sim.params
        with wp.Tape() as tape:
            traj = sim.rollout(x0, us, params, checkpoint=checkpoint)
        tape.backward(grads={traj.states: wp.full_like(traj.states, 1.0)})

    cases = [
        Case(
            "rollout",
            lambda: sim.rollout(start.astype(np.float32), torque.astype(np.float32)),
            worlds * steps,
        )
    ]
    peaks = []
    with cpu_threads(1):
        for name, checkpoint, tracked in (
            (f"gradient, every {every}th state kept", every, False),
            ("gradient", None, False),
            ("gradient, parameters too", None, True),
        ):
            gradient(2, checkpoint, tracked)  # kernels
            before = _peak()
            gradient(worlds, checkpoint, tracked)
            peaks.append(f"{name}: {_peak() - before:.0f} MB more than before, {_peak():.0f} MB in all")
            run = lambda c=checkpoint, t=tracked: gradient(worlds, c, t)  # noqa: E731
            cases.append(Case(name, run, worlds * steps, "rollout"))
        results = time_interleaved(cases, repeats)
    clock = "process CPU time, one thread, copies included; ratios are rollout / case"
    print_table(f"gradients of {worlds} rollouts of {steps} steps: {clock}", "us per step", results, peaks)
    return tidy_rows("gradients", results, clock)


def bench_products(worlds: int, steps: int, repeats: int, seed: int) -> list[dict[str, Any]]:
    """Products with derivatives along rollouts of the finger, in NumPy, one thread."""
    cases = []
    with cpu_threads(1):
        for dtype in ("float32", "float64"):
            ours = Ours(make_workload(slcp.scenes.flicking_finger(), worlds, steps, seed), dtype)
            sim, params = ours.sim, ours.params
            x0, us = ours.work.x0, ours.work.controls
            count = us.shape[0] * us.shape[1]
            states = sim.rollout(x0, us, params).states
            weights, dx0, dus = np.ones(states.shape), np.ones(x0.shape), np.ones(us.shape)
            x, u = states[:, :-1].reshape(count, -1), us.reshape(count, -1)
            along = weights[:, 1:].reshape(x.shape)
            runs: dict[str, Callable[[], Any]] = {
                "rollout": functools.partial(sim.rollout, x0, us, params),
                "vjp": functools.partial(slcp.vjp, sim, x0, us, weights, params),
                "jvp": functools.partial(slcp.jvp, sim, x0, us, dx0, dus, params),
                "A, B": functools.partial(sim.linearize, x, u, params),
                "weighted Hessian": functools.partial(slcp.weighted_hessian, sim, x, u, along, params),
            }
            reference = f"{dtype} rollout"
            for name, run in runs.items():
                label = f"{dtype} {name}"
                cases.append(Case(label, run, count, None if label == reference else reference))
        results = time_interleaved(cases, repeats)
    clock = "process CPU time, one thread, copies included; ratios are rollout / case"
    print_table(f"products with derivatives: {clock}", "us per step", results, [])
    return tidy_rows("products", results, clock)


def bench_libraries(worlds: int, steps: int, repeats: int, seed: int) -> list[dict[str, Any]]:
    """A rollout of the finger, float64, and the gradient of its states' mean square by the controls, from
    NumPy, PyTorch and JAX, whichever are installed; all threads, wall time.
    """
    sim = slcp.Simulator(slcp.scenes.flicking_finger(), PAPER, device="cpu", dtype="float64")
    rng = np.random.default_rng(seed)
    x0 = sim.scene.x0 + 0.1 * rng.standard_normal((worlds, sim.nx))
    us = rng.standard_normal((worlds, steps, sim.nu))
    weights = np.ones((worlds, steps + 1, sim.nx))
    runs: dict[str, Callable[[], Any]] = {
        "NumPy, rollout": lambda: sim.rollout(x0, us),
        "NumPy, vjp": lambda: slcp.vjp(sim, x0, us, weights),
    }
    for name, make in (("torch", _from_torch), ("jax", _from_jax)):
        if importlib.util.find_spec(name) is not None:
            runs |= make(sim, x0, us)
    cases = [
        Case(name, run, 1, None if name == "NumPy, rollout" else "NumPy, rollout")
        for name, run in runs.items()
    ]
    results = time_interleaved(cases, repeats, time.perf_counter)
    clock = "wall time, all threads; ratios are NumPy's rollout / case"
    print_table(f"{worlds} rollouts of {steps} steps: {clock}", "ms", results, [])
    return tidy_rows("libraries", results, clock)


def _from_torch(sim: Any, x0: np.ndarray, us: np.ndarray) -> dict[str, Callable[[], Any]]:
    torch, ours = load("torch", "PyTorch", "torch"), load("slcp_warp.torch", "PyTorch", "torch")
    x, u = torch.tensor(x0), torch.tensor(us, requires_grad=True)

    def gradient() -> None:
        u.grad = None
        ours.rollout(sim, x, u).states.square().mean().backward()

    return {"PyTorch, rollout": lambda: ours.rollout(sim, x, u.detach()), "PyTorch, gradient": gradient}


def _from_jax(sim: Any, x0: np.ndarray, us: np.ndarray) -> dict[str, Callable[[], Any]]:
    jax, ours = load("jax", "JAX", "jax"), load("slcp_warp.jax", "JAX", "jax")
    jax.config.update("jax_enable_x64", True)
    x, u = jax.numpy.asarray(x0), jax.numpy.asarray(us)
    forward = jax.jit(lambda x, u: ours.rollout(sim, x, u).states)
    gradient = jax.jit(jax.grad(lambda u, x: (ours.rollout(sim, x, u).states ** 2).mean()))
    return {
        "JAX, rollout": lambda: jax.block_until_ready(forward(x, u)),
        "JAX, gradient": lambda: jax.block_until_ready(gradient(u, x)),
        "JAX, rollout without jit": lambda: jax.block_until_ready(ours.rollout(sim, x, u)),
    }


def _peak() -> float:
    """Largest resident memory of this process so far [MB]: what grows from case to case."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MEGABYTE
