"""What steps with many contacts should cost, as shares of MuJoCo's time in the same run, and whether they do.

A target is a time beside MuJoCo's on the machine where both were measured (its own boxes, four contacts of a
pair), or a number of times faster than MuJoCo. It is judged by the quotient, so that it scales with the
machine; a robot's, which has no boxes, by how much faster this machine runs MuJoCo's stacks than that one.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

Rows = list[dict[str, Any]]
MUJOCO = {  # us a step of stacks of 3, 10 and 30 of MuJoCo's boxes on the machine of the targets
    "rest": {"stack:3": 10.0, "stack:10": 31.0, "stack:30": 70.0},
    "tumbling": {"stack:3": 12.0, "stack:10": 45.0, "stack:30": 165.0},
}
TIMES = {  # us a step there, float64
    ("rest", "hard"): {"stack:10": 3.5, "stack:30": 12.0},
    ("rest", "smoothed"): {"stack:10": 5.0, "stack:30": 16.0},
    ("rest", "coulomb"): {"stack:10": 5.0, "stack:30": 16.0},
    ("tumbling", "hard"): {"stack:3": 1.5, "stack:10": 9.0, "stack:30": 62.0},
    ("tumbling", "smoothed"): {"stack:3": 3.7, "stack:10": 28.0, "stack:30": 170.0, "walker": 0.9},
    ("tumbling", "coulomb"): {"stack:3": 2.4, "stack:10": 17.0, "stack:30": 121.0, "walker": 0.5},
}
FASTER = {("rest", f"stack:{n}"): 3.0 for n in (3, 10, 30)}  # than MuJoCo
FASTER |= {("tumbling", f"heap:{n}"): 1.0 for n in (10, 30, 60, 100)} | {("tumbling", "hopper"): 1.0}
UNSOLVED = 1e-4  # of tumbling steps


@dataclass(frozen=True)
class Verdict:
    """A target and what was measured.

    Attributes:
        scene, motion, law: of what.
        what: is measured.
        measured, most: what it is, and what it may be.
        seconds: of a step, ours.
    """

    scene: str
    motion: str
    law: str
    what: str
    measured: float
    most: float
    seconds: float

    @property
    def met(self) -> bool:
        """Whether it is reached."""
        return self.measured <= self.most


def verdicts(rows: Rows) -> list[Verdict]:
    """Every target of which there are float64 rows of `slcp bench contacts`."""
    peers: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        if row["program"] == "MuJoCo":
            peers.setdefault((row["scene"], row["motion"]), {})[row["model"]] = float(row["seconds"])
    here = machine_factor(peers)
    out: list[Verdict] = []
    for row in rows:
        if row["program"] != "slcp-warp" or row["dtype"] != "float64":
            continue
        scene, motion, law = row["scene"], row["motion"], row["law"]
        seconds, beside = float(row["seconds"]), peers[scene, motion]
        add = _adder(out, scene, motion, law, seconds)
        if scene in TIMES.get((motion, law), {}):
            goal = TIMES[motion, law][scene]
            if scene in MUJOCO[motion]:
                add("time beside MuJoCo's boxes", seconds / beside["boxes"], goal / MUJOCO[motion][scene])
            elif here is not None:
                add("us, scaled to the machine of the targets", 1e6 * seconds * here, goal)
        if (motion, scene) in FASTER:
            most = 1.0 / FASTER[motion, scene]
            for model, time in beside.items():
                add(f"time beside MuJoCo, {model}", seconds / time, most)
        if motion == "tumbling":
            add("share of steps unsolved", float(row["unsolved"]) / float(row["made"]), UNSOLVED)
    return out


def _adder(out: list[Verdict], scene: str, motion: str, law: str, seconds: float) -> Any:
    def add(what: str, measured: float, most: float) -> None:
        out.append(Verdict(scene, motion, law, what, measured, most, seconds))

    return add


def machine_factor(peers: dict[tuple[str, str], dict[str, float]]) -> float | None:
    """How many times longer MuJoCo's stacks took on the machine of the targets; None without stacks here."""
    found = [1e-6 * time / peers[scene, motion]["boxes"] for motion, times in MUJOCO.items()
             for scene, time in times.items() if (scene, motion) in peers]  # fmt: skip
    return float(np.median(found)) if found else None


def table(rows: Rows) -> list[str]:
    """Lines of Markdown: a line for every scene and measure, what is missed by most first."""
    found = verdicts(rows)
    groups: dict[tuple[str, str, str], dict[str, Verdict]] = {}
    for v in found:
        groups.setdefault((v.scene, v.motion, v.what), {})[v.law] = v
    lines = [f"{sum(v.met for v in found)} of {len(found)} are met. In each cell: measured / at most.", "",
             "| scene | motion | what | hard | smoothed | Coulomb | times over at worst |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip

    def over(by_law: dict[str, Verdict]) -> float:
        return max(v.measured / v.most for v in by_law.values())

    for key, by_law in sorted(groups.items(), key=lambda item: -over(item[1])):
        cells = [_cell(by_law[law]) if law in by_law else "" for law in ("hard", "smoothed", "coulomb")]
        worst = over(by_law)
        lines.append(f"| {' | '.join((*key, *cells, 'met' if worst <= 1.0 else f'{worst:.3g}'))} |")
    return lines


def _cell(v: Verdict) -> str:
    text = f"{v.measured:.3g} / {v.most:.3g}"
    return text if v.met else f"**{text}**"
