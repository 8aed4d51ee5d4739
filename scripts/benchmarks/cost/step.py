"""`slcp bench step`: a step on one core, beside MuJoCo's.

A step touches when its contact carries an impulse: MuJoCo's when the pair's distance is negative at the start
of the step, ours when the normal impulse is at least TOUCH. Touching states are timed on stretches of a
simulator's own rollouts in which every step touches.
"""

import functools

import slcp_warp as slcp

from ..peers.mujoco_model import Peer
from ..peers.mujoco_windows import peer_windows
from ..shared.ours import DTYPES, TOUCH, Ours, cpu_threads
from ..shared.timing import Case, Rows, finish, time_interleaved
from ..shared.workload import make_workload


def bench_step(worlds: int = 2000, steps: int = 75, repeats: int = 9, seed: int = 0) -> Rows:
    """A step on one core beside MuJoCo's, over whole rollouts and over touching windows."""
    scene = slcp.scenes.flicking_finger()
    work = make_workload(scene, worlds, steps, seed)
    peer = Peer(scene)
    name, q = f"MuJoCo {peer.version}", work.x0[:200, : scene.nv]
    exact = Peer(scene, ccd_tolerance="1e-12").deviation(q)
    touching, share = peer_windows(peer, work)
    whole, part = name, f"{name}, touching"
    cases = [
        Case(whole, lambda: peer.rollout(work), work.steps, facts={"touching_share": share}),
        Case(part, lambda: peer.rollout(touching), touching.steps, facts={"touching_share": 1.0}),
    ]
    notes = [
        f"MuJoCo's model differs from the scene by at most {exact.mass_matrix:.1e} of the mass matrix's "
        f"largest entry, {exact.distance:.1e} m in the distance",
        f"touching steps: {name} {share:.1%} (distance < 0); ours: normal impulse >= {TOUCH} N s",
    ]
    with cpu_threads(1):
        for residual in ("rem-logistic", "hard"):
            for dtype in DTYPES:
                ours = Ours(work, dtype, residual)
                label, share = f"{residual} {dtype}", float(ours.touching.mean())
                facts = {"dtype": dtype, "residual": residual, "failed_share": ours.failed}
                for suffix, part_of, touch, reference in (
                    ("", ours.work, share, whole),
                    (", touching", ours.touching_windows, 1.0, part),
                ):
                    run = functools.partial(ours.rollout, part_of)
                    facts = facts | {"touching_share": touch}
                    cases.append(Case(label + suffix, run, part_of.steps, reference, facts=facts))
                notes.append(
                    f"{label}: touching {share:.1%}, worlds not solved and left out {ours.failed:.1%}"
                )
        results = time_interleaved(cases, repeats)
    return finish("step", "us per step", results, notes, "process CPU time, one thread")
