"""How many worlds a chunk takes: as many as run in about a second, measured on the first of them."""

import time

from slcp_warp.kernels.device.launch import thread_count

from ..chunks import ARMS, Part
from ..tasks import TaskSweep

SECONDS = 1.0  # of a chunk: stopping waits for one, and resuming repeats at most one a worker
TRIAL = 0.05  # seconds that a measurement takes at least
MOST_CHUNKS = 2**16  # files of a store; chunks of larger sweeps take longer


def measured(work: TaskSweep, threads: int | None = None) -> list[int]:
    """Worlds of a chunk for every part of a sweep; its kernels are compiled on the way.

    Args:
        threads: that a chunk will run on, None: all of this process's.
    """
    share = 1.0 if threads is None else min(1.0, threads / thread_count())
    parts = work.chunks.parts
    sizes: list[int] = []
    for part in parts:
        if part.arm == ARMS[0]:
            wanted = 1 << int(share * SECONDS * _rate(work, part)).bit_length() >> 1
        least = -(-part.worlds * len(parts) // MOST_CHUNKS)
        sizes.append(min(part.at_once, max(1, wanted, 1 << (least - 1).bit_length())))
    return sizes


def _rate(work: TaskSweep, part: Part) -> float:
    """Worlds a second."""
    worlds = min(part.at_once, 8 * thread_count())
    work.rows(part, 0, 1)  # compiled, and policies on their device
    while True:
        began = time.perf_counter()
        work.rows(part, 0, worlds)
        seconds = time.perf_counter() - began
        if seconds >= TRIAL or worlds == part.at_once:
            return worlds / max(seconds, 1e-6)
        worlds = min(part.at_once, 4 * worlds)
