"""`slcp bench jacobian`: A and B at touching states, beside a step and MuJoCo's finite differences."""

import functools

import numpy as np

import slcp_warp as slcp

from ..peers.mujoco_model import Peer
from ..shared.ours import DTYPES, Ours, cpu_threads
from ..shared.timing import Case, Rows, finish, time_interleaved
from ..shared.workload import make_workload
from .mujoco_windows import peer_windows


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
