"""What a step with many contacts costs: ours, MuJoCo's, and another version's, in turn in one run."""

import functools
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp

from ..cost.pair import PairError, Runner
from ..peers.mujoco_model import Peer
from ..shared.machine import machine
from ..shared.rows import Say
from ..shared.workload import Workload
from .worlds import World

Rows = list[dict[str, Any]]
SIDE = Path(__file__).with_name("side.py")
SETTLE = 300  # steps made before those at rest are timed, in each program by itself
LAWS: dict[str, dict[str, Any]] = {
    "hard": {"residual": "hard"},
    "smoothed": {"residual": "rem-logistic"},
    "coulomb": {"residual": "hard", "friction": "coulomb"},
}
PATIENCE = 60.0  # seconds of one scene and motion after which no further round is begun


@dataclass(frozen=True)
class Plan:
    """What is measured of every scene.

    Attributes:
        worlds: of a call; None: by size of the scene, `default_worlds`.
        repeats: rounds at most.
        other: interpreter of another version, "" for none.
        steps: that are timed.
        most: CPU seconds of a call of ours, beyond which it has fewer worlds and steps.
        seen: tumbling worlds that are run at least once, to see whether they are solved.
    """

    motions: tuple[str, ...]
    laws: tuple[str, ...]
    dtypes: tuple[str, ...]
    worlds: int | None = None
    repeats: int = 7
    seed: int = 0
    strategy: str = "auto"
    other: str = ""
    steps: int = 75
    most: float = 0.5
    seen: int = 1


@dataclass
class Case:
    """One program on one scene: `seconds` gives CPU seconds of a step, and is called once a round."""

    row: dict[str, Any]
    seconds: Callable[[], float]
    spent: list[float] = field(default_factory=list)


def default_worlds(bodies: int) -> int:
    """Worlds of a call: some hundred bodies."""
    return max(4, 400 // bodies)


def mujoco_cases(world: World, motion: str, starts: np.ndarray, steps: int) -> Iterator[Case]:
    """MuJoCo's models of a scene, its default options."""
    for name, geoms in {"same pairs": None, **world.geoms}.items():
        peer = Peer(world.scene, 1, None, (), geoms)
        x, nu = starts, world.scene.nu
        if motion == "rest":
            before = peer.rollout(Workload(x[:1], np.zeros((1, SETTLE, nu))))[:, -1]
            x = np.tile(before, (len(x), 1))
        work = Workload(x, np.zeros((len(x), steps, nu)))
        moved = np.abs(peer.rollout(work)[:, -1] - x)[:, : world.scene.nv].max()
        row = {
            "program": "MuJoCo", "version": peer.version, "model": name, "dtype": "float64",
            "batch": len(x), "steps": steps, "made": work.steps, "unsolved": "", "moved": moved,
        }  # fmt: skip

        def seconds(peer: Peer = peer, work: Workload = work) -> float:
            begin = time.process_time()
            peer.rollout(work)
            return (time.process_time() - begin) / work.steps

        yield Case(row, seconds)


class Ours:
    """Our side and that of another version, each in its process, and the folder with what they read."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan, self.folder = plan, folder
        self.runners = {"slcp-warp": Runner(sys.executable, SIDE)}
        if plan.other:
            self.runners["other"] = Runner(plan.other, SIDE)

    def close(self) -> None:
        """End both processes."""
        for runner in self.runners.values():
            runner.process.kill()
            runner.process.wait()

    def cases(self, world: World, motion: str, starts: np.ndarray, worlds: int, say: Say) -> Iterator[Case]:
        """Every law and precision on a scene; `worlds` of the starts are timed, all of them judged."""
        scene, listed, states = (self.folder / name for name in ("scene.json", "listed.json", "starts.npy"))
        slcp.save_scene(world.scene, scene)
        slcp.save_scene(world.scene.with_listed_contacts(), listed)
        np.save(states, starts)
        for law in self.plan.laws:
            for dtype in self.plan.dtypes:
                given = {
                    "starts": str(states), "worlds": worlds, "steps": self.plan.steps,
                    "settle": SETTLE if motion == "rest" else 0, "most": self.plan.most,
                    "options": LAWS[law], "dtype": dtype, "strategy": self.plan.strategy,
                    "of": f"{world.name} {motion}",
                }  # fmt: skip
                for program, runner in self.runners.items():
                    old = program == "other"  # a version before may not know contacts="auto"
                    job = json.dumps(given | {"scene": str(listed if old else scene)})
                    facts = runner.ask(job)
                    if "error" in facts:
                        say(f"{program} on {world.name}, {motion}, {law}, {dtype}: {facts['error']}")
                        continue
                    row = {"program": program, "law": law, "dtype": dtype, **facts}
                    yield Case(row, functools.partial(_seconds, runner, job))


def _seconds(runner: Runner, job: str) -> float:
    seconds = runner.seconds(job)
    if isinstance(seconds, str):
        raise PairError(f"{runner.python!r}: {seconds}")
    return seconds


def measure(cases: list[Case], repeats: int) -> None:
    """Rounds in which all cases take turns, each round beginning with another one."""
    begin = time.perf_counter()
    for case in cases:
        case.seconds()
    for r in range(repeats):
        for i in range(len(cases)):
            case = cases[(i + r) % len(cases)]
            case.spent.append(case.seconds())
        if time.perf_counter() - begin > PATIENCE:
            break


def finished(cases: list[Case], common: dict[str, Any]) -> Rows:
    """Rows with medians and spreads, and how many times MuJoCo's time is ours in the same round.

    Of MuJoCo's models the one of the least median counts.
    """
    peers = [case for case in cases if case.row["program"] == "MuJoCo"]
    best = min(peers, key=lambda case: float(np.median(case.spent)), default=None)
    out: Rows = []
    for case in cases:
        low, middle, high = (float(x) for x in np.percentile(case.spent, [10, 50, 90]))
        row = common | case.row | {"seconds": middle, "seconds_p10": low, "seconds_p90": high,
                                   "repeats": len(case.spent)}  # fmt: skip
        if best is not None and case not in peers:
            ratios = np.array(best.spent) / np.array(case.spent)
            low, middle, high = (float(x) for x in np.percentile(ratios, [10, 50, 90]))
            row |= {"ratio": middle, "ratio_p10": low, "ratio_p90": high, "against": best.row["model"]}
        out.append(row)
    return out


def bench_contacts(worlds: Iterable[World], plan: Plan, say: Say, done: Callable[[Rows], None]) -> Rows:
    """Every world at rest and tumbling; `done` gets the rows of each as they are measured.

    Raises:
        PairError: an interpreter does not start or dies.
    """
    out: Rows = []
    with tempfile.TemporaryDirectory() as folder:
        ours = Ours(plan, Path(folder))
        try:
            for world in worlds:
                for motion in plan.motions:
                    count = plan.worlds or default_worlds(world.bodies)
                    seen = max(count, plan.seen if motion == "tumbling" else 0)
                    starts = world.starts(motion, seen, plan.seed)
                    cases = list(mujoco_cases(world, motion, starts[:count], plan.steps))
                    cases += ours.cases(world, motion, starts, count, say)
                    measure(cases, plan.repeats)
                    facts = {"benchmark": "contacts", "scene": world.name, "motion": motion,
                             "bodies": world.bodies, "h": world.scene.step_size}  # fmt: skip
                    rows = [row | machine() for row in finished(cases, facts)]
                    done(rows)
                    out += rows
        finally:
            ours.close()
    return out
