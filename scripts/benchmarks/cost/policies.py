"""`slcp bench policies`: what policies of users, and learners, cost beside linear feedback."""

import functools
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp
from slcp_warp import measures, policies

from ..shared.ours import cpu_threads
from ..shared.timing import Case, print_table, tidy_rows, time_interleaved

WIDTH = 32
FORCE = 0.5  # of every control
SCENES = ("flicking_finger", "push_block")


def feedback(dtype: Any, VX: Any, VU: Any, Data: Any) -> Any:
    """Linear feedback as a user writes it."""
    nx, nu = VX._length_, VU._length_

    @wp.func
    def control(data: Data, world: int, step: int, x: VX):  # type: ignore[no-untyped-def]
        u = VU()
        for i in range(nu):
            u[i] = data.u_ref[i]
            for j in range(nx):
                u[i] += data.K[i, j] * (x[j] - data.x_ref[j])
        return u

    return control


def network(scene: slcp.Scene, activation: str) -> policies.Network:
    """Two hidden layers of WIDTH, whose last weights are zero: controls as those of zero gains."""
    import torch

    torch.manual_seed(0)
    nn = torch.nn
    act = getattr(nn, activation)
    last = nn.Linear(WIDTH, scene.nu)
    nn.init.zeros_(last.weight)
    nn.init.constant_(last.bias, FORCE)
    layers = [nn.Linear(2 * scene.nv, WIDTH), act(), nn.Linear(WIDTH, WIDTH), act(), last]
    return policies.Network(nn.Sequential(*layers))


def constant(u: np.ndarray, x: np.ndarray, time: float) -> np.ndarray:
    """The same controls always."""
    return u


def played(environment: slcp.Environment, u: np.ndarray, steps: int) -> None:
    """A learner's steps under the same controls always."""
    for _ in range(steps):
        environment.step(u)


def bench_policies(worlds: int, steps: int, repeats: int, seed: int) -> list[dict[str, Any]]:
    """Sweeps under policies that give the same controls, for the same contacts; float32, one thread."""
    cases = []
    with cpu_threads(1):
        for name in SCENES:
            scene = slcp.scenes.NAMED[name]()
            K, u = np.zeros((scene.nu, 2 * scene.nv)), np.full(scene.nu, FORCE)
            task = slcp.Task(
                name, scene, slcp.costs.terms(scene, [slcp.costs.effort(1.0)]), horizon=steps,
                disturbances=slcp.Disturbances(torque=1.0), measures={"end": measures.final(0)},
                success=measures.final(0) > 0.0,
            )  # fmt: skip
            given = {
                "linear": policies.Linear(K, scene.x0, u),
                "function": policies.Function(feedback, K=K, x_ref=scene.x0, u_ref=u),
                f"network 2 x {WIDTH}, ReLU": network(scene, "ReLU"),
                f"network 2 x {WIDTH}, Tanh": network(scene, "Tanh"),
                "callback, every step": policies.Callback(functools.partial(constant, u)),
                "callback, every 10 steps": policies.Callback(
                    functools.partial(constant, u), period=10 * scene.step_size
                ),
            }

            def run(policy: Any, task: slcp.Task = task) -> Any:
                return slcp.sweep(
                    task,
                    policy,
                    worlds=worlds,
                    seed=seed,
                    cases=task.options,
                    device="cpu",
                    strategy="specialised",
                )

            for label, policy in given.items():
                what = f"{name}: {label}"
                reference = None if label == "linear" else f"{name}: linear"
                cases.append(Case(what, functools.partial(run, policy), worlds * steps, reference))
            environment = slcp.Environment(task, worlds, seed=seed, device="cpu", strategy="specialised")
            environment.reset()
            play = functools.partial(played, environment, np.tile(u, (worlds, 1)), steps)
            cases.append(Case(f"{name}: environment", play, worlds * steps, f"{name}: linear"))
        results = time_interleaved(cases, repeats)
    clock = "process CPU time, one thread; ratios are linear / case"
    print_table(f"sweeps of {worlds} worlds x {steps} steps: {clock}", "us per step", results, [])
    return tidy_rows("policies", results, clock)
