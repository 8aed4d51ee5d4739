"""What the broad phase saves: a step of discs, close together and far apart, with it and with all pairs.

    python -m slcp_warp.scripts.benchmarks.contacts.near [--law hard] [--count 10 --count 100]

Both are the same kernels; they take turns, CPU time on one core, medians. Prints a table, with the time that
it takes to make a scene and a simulator of it and the memory of a world's workspace.
"""

import argparse
import time
from collections.abc import Iterator
from unittest import mock

import numpy as np

import slcp_warp as slcp
from slcp_warp.kernels.generic import topology
from slcp_warp.kernels.generic.work import bytes_per_world

from .cost import LAWS
from .worlds import world

COUNTS = (10, 20, 30, 60, 100)
KINDS = {"discs": ("rest", "tumbling"), "gas": ("tumbling",)}
STEPS, SETTLE, WORLDS, REPEATS = 25, 200, 2, 5
HEAD = ("scene", "pairs", "rows", "made in [s]", "kB a world", "all pairs [us]", "near pairs [us]", "ratio")


def simulators(scene: slcp.Scene, law: str) -> list[slcp.Simulator]:
    """Of a scene: one that looks at all pairs, and one that looks at items first."""
    made = []
    for items in (False, True):
        with mock.patch.object(topology, "items_first", lambda s, items=items: items):
            made.append(slcp.Simulator(scene, slcp.Options(**LAWS[law]), device="cpu", strategy="generic"))
    return made


def costs(sims: list[slcp.Simulator], x: np.ndarray, settle: int) -> np.ndarray:
    """Seconds (REPEATS, 2) of a step of a world from those of the states (B, nx) whose worlds are solved; an
    error where there is none, or where two motions differ.
    """
    if settle:
        x = sims[1].rollout(x[:1], steps=settle).states[:, -1]
    ends = [sim.rollout(x, steps=STEPS) for sim in sims]
    if np.abs(ends[0].states[:, 1] - ends[1].states[:, 1]).max() > 1e-9:
        raise RuntimeError("near pairs make another motion than all pairs")
    x = x[np.all([run.status == slcp.Status.SOLVED for run in ends], axis=0)][:WORLDS]
    if not len(x):
        raise RuntimeError("no world was solved")
    spent = np.zeros((REPEATS, 2))
    for r in range(REPEATS):
        for i in ((0, 1), (1, 0))[r % 2]:
            begin = time.process_time()
            sims[i].rollout(x, steps=STEPS)
            spent[r, i] = (time.process_time() - begin) / (STEPS * len(x))
    return spent


def rows(counts: tuple[int, ...], law: str) -> Iterator[tuple[str, ...]]:
    """The table's rows, as they are measured."""
    for kind, motions in KINDS.items():
        for count in counts:
            name = f"{kind}:{count}"
            begin = time.process_time()
            scene = world(name).scene
            slcp.Simulator(scene, slcp.Options(**LAWS[law]), device="cpu", strategy="generic")
            made, s = time.process_time() - begin, scene.structure
            sims = simulators(scene, law)
            for motion in motions:
                spent = costs(sims, world(name).starts(motion, 4 * WORLDS, 0), SETTLE * (motion == "rest"))
                every, near = np.median(spent, axis=0) * 1e6
                ratio = np.median(spent[:, 0] / spent[:, 1])
                yield (f"{name} {motion}", f"{len(s.pairs):,}", f"{s.nr:,}", f"{made:.2f}",
                       f"{bytes_per_world(s) / 1e3:,.0f}", f"{every:.1f}", f"{near:.1f}",
                       f"{ratio:.2f}")  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--law", choices=LAWS, default="hard", help="of contact")
    parser.add_argument("--count", type=int, action="append", help="of discs; may be given again")
    given = parser.parse_args()
    print(f"| {' | '.join(HEAD)} |\n|{'---|' * len(HEAD)}")
    for row in rows(tuple(given.count or COUNTS), given.law):
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
