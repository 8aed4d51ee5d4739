"""`slcp bench jacobian`: A and B at touching states beside MuJoCo's finite differences; A and B of stacks."""

import functools
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp

from ..peers.mujoco_model import Peer
from ..peers.mujoco_windows import peer_windows
from ..shared.ours import DTYPES, Ours, cpu_threads
from ..shared.timing import Case, Rows, finish, time_interleaved
from ..shared.workload import make_workload


def bench_jacobian(worlds: int = 1000, steps: int = 75, repeats: int = 9, seed: int = 0) -> Rows:
    """The Jacobian pair A, B at touching states, beside a step there and MuJoCo's finite differences."""
    work = make_workload(slcp.scenes.flicking_finger(), worlds, steps, seed)
    peer = Peer(slcp.scenes.flicking_finger())
    theirs, _ = peer_windows(peer, work)
    x, u = theirs.x0[:1000], theirs.controls[:1000, 0]
    forward, centred = (f"MuJoCo {peer.version} {kind}" for kind in ("forward", "centred"))

    def set_states() -> None:
        for state, control in zip(x, u):
            peer.set_state(state, control)

    def differences(both_sides: bool) -> Case:
        label, reference = (centred, forward) if both_sides else (forward, None)
        run = functools.partial(peer.finite_differences, x, u, both_sides)
        return Case(label, run, len(x), reference, overhead=set_states)

    cases = [differences(False), differences(True)]
    with cpu_threads(1):
        for dtype in DTYPES:
            ours = Ours(work, dtype)
            touching = ours.touching_windows
            x0, u0 = touching.x0, np.ascontiguousarray(touching.controls[:, 0])
            linearize = functools.partial(ours.sim.linearize, x0, u0, ours.params)
            step = functools.partial(ours.rollout, touching)
            cases.append(Case(f"{dtype} step", step, touching.steps, facts={"dtype": dtype}))
            cases.append(Case(f"{dtype} A, B", linearize, len(x0), forward, facts={"dtype": dtype}))
        results = time_interleaved(cases, repeats)
    took = {r.case.name: r.seconds for r in results}
    notes = [f"{d}: A, B cost {np.median(took[f'{d} A, B'] / took[f'{d} step']):.2f} steps" for d in DTYPES]
    return finish("jacobian", "us per call", results, notes, "touching, process CPU time, one thread")


LAWS: dict[str, dict[str, Any]] = {
    "smoothed": {},
    "hard": {"residual": "hard"},
    "Coulomb": {"residual": "hard", "friction": "coulomb"},
}
SETTLE, ALONG = 100, 16  # steps before those that are timed, and these


def bench_stack_jacobian(counts: tuple[int, ...], repeats: int = 9, seed: int = 0) -> Rows:
    """A and B along trajectories of stacks of boxes, at rest and tumbling, beside their steps."""
    cases = []
    with cpu_threads(1):
        for count in counts:
            for law, options in LAWS.items():
                for motion in ("rest", "tumbling"):
                    cases += _of_stack(count, law, options, motion, seed)
        results = time_interleaved(cases, repeats)
    took = {r.case.name: r.seconds for r in results}
    notes = [
        f"{name[:-6]}: A, B cost {np.median(took[name] / took[name[:-4] + 'step']):.1f} steps"
        for name in took if name.endswith("A, B")
    ]  # fmt: skip
    return finish(
        "jacobian of stacks", "us per call", results, notes, "process CPU time, one thread, float64"
    )


def _of_stack(count: int, law: str, options: dict[str, Any], motion: str, seed: int) -> list[Case]:
    scene = slcp.scenes.stack(count)
    sim = slcp.Simulator(scene, slcp.Options(**options), device="cpu", strategy="generic")
    worlds, nv = max(4, 200 // count), scene.nv
    x = np.tile(scene.x0, (worlds, 1))
    if motion == "tumbling":
        x[:, nv:] += np.random.default_rng(seed).standard_normal((worlds, nv))
    before = ALONG if motion == "tumbling" else SETTLE
    x = sim.rollout(x, steps=before).states[:, -1]
    run = sim.rollout(x, steps=ALONG)
    solved = np.flatnonzero(run.status == 0)

    def put(a: np.ndarray) -> Any:
        return wp.array(np.ascontiguousarray(a), dtype=wp.float64, device="cpu")

    xs, shape = run.states[solved], (len(solved), ALONG)
    outputs = (
        sim.empty(*shape, sim.nx, sim.nx), sim.empty(*shape, sim.nx, 0), sim.empty(0, 0, 0, 0),
        wp.zeros(shape, dtype=wp.int32, device="cpu"),
    )  # fmt: skip
    nobody = wp.zeros(0, dtype=wp.int32, device="cpu")
    table, us = sim.parameter_array(None, len(solved)), np.zeros((*shape, 1))
    linearize = sim.kernels.stepping.prepare_linearize(
        table, put(xs), put(us), sim.empty(0, 0), nobody, outputs, False
    )
    name, calls = f"stack of {count}, {law}, {motion}: ", len(solved) * ALONG
    facts = {"dtype": "float64", "boxes": count, "law": law, "motion": motion, "worlds": len(solved)}
    step = functools.partial(sim.rollout, xs[:, 0], steps=ALONG)
    return [
        Case(name + "step", step, calls, facts=facts),
        Case(name + "A, B", linearize, calls, overhead=step, facts=facts),
    ]
