"""Study "many": what steps with many contacts cost, by size and batch, and error against cost of piles.

Costs are those of `slcp bench contacts`. Errors are of positions: where nothing should move the largest drift
in ten seconds, else the median over starts against our own motion of hard contact under a fine step
(contacts/problems.py). `error_self` is against the program's own limit: MuJoCo's contacts are soft, so where
bodies collide in groups it converges to another motion. Every point is timed in turn with the others of its
problem.
"""

import functools
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from ..contacts.cost import LAWS, Plan, bench_contacts
from ..contacts.problems import energy_gained, moves, rests
from ..contacts.worlds import ALL, MOTIONS, world
from ..exact.problems import STEP_SIZES, Problem
from ..peers.drake import Drake
from ..peers.mjx import MJX
from ..peers.mujoco import MuJoCo
from ..peers.mujoco_warp import MuJoCoWarp
from ..peers.peer import Peer, installed
from ..shared.rows import Rows, Say, report, timed
from . import contact_peers
from .contact import Curve, point

STUDY = "many"
CURVES = (
    Curve("Coulomb"),
    Curve("Coulomb, float32", dtype="float32"),
    Curve("Anitescu", friction="anitescu"),
    Curve("smoothed, sigma = .01", "rem-logistic", "anitescu", sigma=0.01),
    Curve("smoothed, sigma = .001", "rem-logistic", "anitescu", sigma=0.001),
)
SETTINGS = ("default", "CG", "stiff", "overdamped")
RESTS = ("stack:3", "stack:10", "stack:30", "discs:10", "discs:30")
MOVES = ("stack:3", "stack:10", "stack:30", "heap:10", "heap:30", "beam:8", "walker", "hopper")
OTHERS, SHARE = ("stack:3", "stack:10", "heap:10"), (0.02, 0.01, 0.005)  # of the peers that take long
WORLDS = 64  # of mujoco_warp
STILL_SIZES = (0.05, 0.02, 0.01, 0.005)  # of what rests
BATCHES = (1, 10, 100, 1000, 10_000, 100_000)
STEPS = 2000  # world steps of a timed call, at least
REPEATS = 3
PATIENCE = 60.0  # CPU seconds of a point, beyond which it is left out


def cost_rows(say: Say, names: Iterable[str] = ALL, plan: Plan | None = None) -> Rows:
    """The rows of `slcp bench contacts`, with the columns of a study."""
    plan = plan or Plan(MOTIONS, tuple(LAWS), ("float64", "float32"), repeats=5, seen=400)
    found = bench_contacts([world(name) for name in names], plan, say, lambda rows: None)
    return report(say, [as_study(row) for row in found], "problem", "value", "curve", "seconds", "ratio")


def as_study(row: dict[str, Any], knob: str = "size") -> dict[str, Any]:
    """A row of `slcp bench contacts` with the columns of a study: by size, or by batch."""
    kind, _, size = row["scene"].partition(":")
    ours = row["program"] != "MuJoCo"
    curve = f"{row['law']}, {row['dtype']}" if ours else f"MuJoCo, {row['model']}"
    name = kind if knob == "size" else row["scene"]
    solved = 1.0 - row["unsolved"] / row["seen"] if ours else ""
    return {
        "study": STUDY, "problem": f"{name}, {row['motion']}, by {knob}", "curve": curve, "knob": knob,
        "value": row["batch"] if knob == "batch" else int(size or row["bodies"]), "cost_of": "step",
        "solved_share": solved, "device": "cpu", "threads": 1,
    } | row  # fmt: skip


def batch_rows(say: Say, name: str = "stack:10", batches: Iterable[int] = BATCHES) -> Rows:
    """A tumbling stack against the number of worlds in a call; the largest batches are timed once."""
    out: Rows = []
    for batch in batches:
        plan = Plan(
            ("tumbling",), ("hard", "smoothed"), ("float64",), batch, repeats=1 if batch > 1000 else 5,
            most=1e9, steps=10,
        )  # fmt: skip
        out += [as_study(row, "batch") for row in bench_contacts([world(name)], plan, say, lambda rows: None)]
    return out


def affordable(p: Problem, curve: Curve, h: float) -> bool:
    """Whether a point is measured in a bearable time, by the first tenth of its steps."""
    sim = curve.simulator(p.scene)
    params = sim.params.replace(step_size=h)
    count = max(1, round(p.duration / h) // 10)
    starts, us = p.starts[:1].astype(curve.dtype), np.zeros((1, count, sim.nu), curve.dtype)
    sim.rollout(starts, us[:, :1], params)
    begin = time.process_time()
    sim.rollout(starts, us, params)
    return 10.0 * len(p.starts) * (time.process_time() - begin) * (2 + REPEATS) < PATIENCE


def own_rows(p: Problem, curves: Iterable[Curve], step_sizes: Iterable[float], say: Say) -> Rows:
    """Our curves on a problem."""
    cases = []
    for curve in curves:
        for h in step_sizes:
            if not affordable(p, curve, h):
                say(f"left out: {curve.name} on {p.name} at h = {h}: more than {PATIENCE:g} s")
                continue
            case = point(p, curve, h, STEPS, STUDY)
            states = case.run().states.astype(float)
            facts = {"note": p.note, "error_self": case.facts["error"]}
            facts |= {"energy_gained": energy_gained(p.scene, states)}
            cases.append(replace(case, facts=case.facts | facts))
    return timed(cases, REPEATS)


def peer_rows(peer: Peer, p: Problem, limit: Problem, step_sizes: tuple[float, ...]) -> Rows:
    """A peer on a problem; its errors against its own limit, too."""
    out = contact_peers.problem_rows(peer, p, step_sizes, STUDY)
    for row in out:
        setting = row["curve"].removeprefix(f"{peer.name}, ")
        states = peer.prepare(p.scene, p.starts, p.duration, row["h"], setting).rollout()
        finite = np.isfinite(states).all()
        row["error_self"] = limit.typical(limit.errors(states[:, -1]))["error"] if finite else np.inf
        row["energy_gained"] = energy_gained(p.scene, states) if finite else np.inf
    return out


def problem_rows(name: str, still: bool, say: Say, step_sizes: tuple[float, ...] = STEP_SIZES,
                 curves: Iterable[Curve] = CURVES) -> Rows:  # fmt: skip
    """All rows of a pile that rests, or is thrown; none where there is no truth of it."""
    begin = time.perf_counter()
    try:
        p, limit = (rests(name), rests(name)) if still else moves(name)
    except ValueError as error:
        say(f"left out: {name}: {error}")
        return []
    out = own_rows(p, curves, step_sizes, say)
    for peer in installed((functools.partial(MuJoCo, touching=SETTINGS),), say):
        out += peer_rows(peer, p, limit, step_sizes)
    say(f"{p.name}: {time.perf_counter() - begin:.0f} s. {p.note}")
    return out


def other_rows(name: str, say: Say) -> Rows:
    """The peers that compile or step for long on a pile that is thrown, those that are installed."""
    out: Rows = []
    try:
        p, _ = moves(name)
    except ValueError as error:
        say(f"left out: {name}: {error}")
        return out
    for peer in installed((functools.partial(MuJoCoWarp, batch=WORLDS), MJX, Drake), say):
        begin = time.perf_counter()
        try:
            out += contact_peers.problem_rows(peer, p, SHARE, STUDY)
            say(f"{peer.name} {peer.version} on {p.name}: {time.perf_counter() - begin:.0f} s")
        except Exception as error:
            say(f"left out: {peer.name} on {p.name} failed, {type(error).__name__}: {error}")
    return out


def pieces(say: Say) -> list[tuple[str, Callable[[], Rows]]]:
    """Costs by scene and by batch, and every problem."""
    out: list[tuple[str, Callable[[], Rows]]] = [
        (f"cost of {name}", functools.partial(cost_rows, say, (name,))) for name in ALL
    ]
    out += [("batch", functools.partial(batch_rows, say))]
    out += [
        (f"{name} rests", functools.partial(problem_rows, name, True, say, STILL_SIZES)) for name in RESTS
    ]
    out += [(f"{name} moves", functools.partial(problem_rows, name, False, say)) for name in MOVES]
    return out + [(f"{name} under other peers", functools.partial(other_rows, name, say)) for name in OTHERS]


def rows(say: Say) -> Rows:
    """All of the study."""
    return [row for _, measure in pieces(say) for row in measure()]
