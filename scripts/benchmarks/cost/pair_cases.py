"""The cases of `slcp bench pair`, in a process of their own: run by any interpreter that has slcp-warp.

Only the public interface is used, so that an older version runs the same file. The parent writes the name of
a case a line, this process answers with the CPU seconds per item of one call of it (the first call of a case
compiles its kernels and is not timed), or with what went wrong. Launches use one thread.
"""

import dataclasses
import functools
import json
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp

SEED = 0
STEPS = 50
FINGER = {
    "rem-logistic": {},
    "hard": {"residual": "hard"},
    "coulomb": {"residual": "hard", "friction": "coulomb"},
    "trapezoidal": {"integrator": "trapezoidal"},
    "rem-normal": {"residual": "rem-normal"},
}
OTHERS = {
    "sliding block": ("sliding_block", 2000, ("rem-logistic", "hard", "coulomb")),
    "walker": ("walker", 500, ("rem-logistic", "coulomb")),
    "stack of 10": ("stack_of_10", 20, ("rem-logistic", "hard", "coulomb")),
}


def scene_of(name: str) -> slcp.Scene:
    """A named scene, or a stack of boxes."""
    return slcp.scenes.stack(10) if name == "stack_of_10" else slcp.scenes.NAMED[name]()


def rollout(scene: str, worlds: int, dtype: str, **choices: Any) -> tuple[Callable[[], Any], int]:
    """A rollout from random velocities around the scene's start, under small random controls."""
    sim = slcp.Simulator(scene_of(scene), slcp.Options(**choices), device="cpu", dtype=dtype)
    rng = np.random.default_rng(SEED)
    x0 = np.tile(sim.scene.x0, (worlds, 1))
    x0[:, sim.nx // 2 :] += 0.5 * rng.standard_normal((worlds, sim.nx // 2))
    us = rng.standard_normal((worlds, STEPS, sim.nu))
    kind = np.dtype(dtype)
    return functools.partial(sim.rollout, x0.astype(kind), us.astype(kind)), worlds * STEPS


def linearization(dtype: str) -> tuple[Callable[[], Any], int]:
    """A and B at the states of rollouts of the finger."""
    sim = slcp.Simulator(scene_of("flicking_finger"), slcp.Options(scaling="none"), device="cpu", dtype=dtype)
    rng = np.random.default_rng(SEED)
    us = rng.standard_normal((100, STEPS, sim.nu)).astype(dtype)
    x = sim.rollout(np.tile(sim.scene.x0, (100, 1)).astype(dtype), us).states[:, :-1].reshape(-1, sim.nx)
    return functools.partial(sim.linearize, np.ascontiguousarray(x), us.reshape(-1, sim.nu)), len(x)


def passes(dtype: str) -> tuple[Callable[[], Any], int]:
    """Thirty passes of full second-order DDP from the canonical start."""
    sim = slcp.Simulator(scene_of("flicking_finger"), slcp.Options(scaling="none"), device="cpu", dtype=dtype)
    problem = ddp.Problem(sim, slcp.tasks.flicking_finger().cost, horizon=75)
    workspace = ddp.Workspace(problem, 1, ddp.Options(max_iterations=30))
    run = functools.partial(workspace.run, sim.scene.x0, np.zeros((75, sim.nu)))
    return run, run()


def sweep() -> tuple[Callable[[], Any], int]:
    """A sweep of the finger that tracks a plan, with measures that every version has."""
    task = slcp.tasks.flicking_finger()
    sim = slcp.Simulator(task.scene, slcp.Options(scaling="none"), device="cpu")
    problem = ddp.Problem(sim, task.cost, horizon=75)
    plan = ddp.solve(problem, task.scene.x0, np.zeros((75, sim.nu)), ddp.Options(max_iterations=3))
    task = dataclasses.replace(
        task,
        duration=STEPS * 0.05,
        disturbances=slcp.Disturbances(torque=0.1, parameters={"mass": 0.1}),
        measures={"share": slcp.measures.contact_share(), "gap": slcp.measures.lowest_gap()},
        success=None,
    )
    policy = ddp.TrackingPolicy(plan)
    choices = [slcp.Options(scaling="none"), slcp.Options(residual="hard", scaling="none")]
    run = functools.partial(slcp.sweep, task, policy, worlds=2000, cases=choices, device="cpu")
    return run, 2 * 2000 * STEPS


def cases() -> dict[str, Callable[[], tuple[Callable[[], Any], int]]]:
    """name -> what prepares the case: a call and how many items (steps, points, passes) it does."""
    out: dict[str, Callable[[], tuple[Callable[[], Any], int]]] = {}
    for dtype in ("float32", "float64"):
        for label, choices in FINGER.items():
            out[f"finger, {label}, {dtype}"] = functools.partial(
                rollout, "flicking_finger", 1000, dtype, **{"scaling": "none", **choices}
            )
        out[f"finger, A and B, {dtype}"] = functools.partial(linearization, dtype)
    out["finger, DDP pass, float64"] = functools.partial(passes, "float64")
    out["finger, sweep, float32"] = sweep
    for label, (scene, worlds, methods) in OTHERS.items():
        for method in methods:
            choices = FINGER[method]
            out[f"{label}, {method}, float64"] = functools.partial(
                rollout, scene, worlds, "float64", **choices
            )
    return out


def main() -> None:
    """Answer the parent's lines until there are no more."""
    prepared: dict[str, tuple[Callable[[], Any], int]] = {}
    answers = sys.stdout
    sys.stdout = sys.stderr
    for line in sys.stdin:
        name = line.strip()
        try:
            if name not in prepared:
                prepared[name] = cases()[name]()
                prepared[name][0]()
            run, count = prepared[name]
            start = time.process_time()
            run()
            answer: dict[str, Any] = {"seconds": (time.process_time() - start) / count}
        except Exception as error:  # an older version may lack what a case needs: say so, go on
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
