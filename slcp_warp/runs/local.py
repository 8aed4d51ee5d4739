"""Processes of this machine, one pool each: where one ends, only its own chunk is lost."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from typing import Any

UNBORN = (
    "worker processes end before they begin; a script that starts them needs its calls below "
    'if __name__ == "__main__":'
)
STILLBORN = 3  # workers, one after the other: one may be killed while it begins
THREADS, VISIBLE = "SLCP_WARP_THREADS", "CUDA_VISIBLE_DEVICES"


class Pools:
    """Pools of one process each, started when they are needed and again when they end.

    Attributes:
        unborn: why none can be started, empty while there is no sign of it.
    """

    def __init__(self, count: int, devices: Sequence[str] | None = None) -> None:
        self.surroundings = [_surroundings(k, count, devices) for k in range(count)]
        self.pools: list[ProcessPoolExecutor | None] = [None] * count
        self.pending = [0] * count
        self.born: list[Future[Any] | None] = [None] * count
        self.unborn = ""
        self._stillborn: set[Future[Any]] = set()
        self._lock = threading.RLock()

    def __len__(self) -> int:
        return len(self.pools)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Run a function in the process that has least to do."""
        with self._lock:
            k = min(range(len(self)), key=self.pending.__getitem__)
            try:
                future = self._pool(k).submit(function, *arguments)
            except BrokenExecutor:
                self._end(k)
                future = self._pool(k).submit(function, *arguments)
            self.pending[k] += 1
        future.add_done_callback(lambda done: self._settle(k, done))
        return future

    def kill(self) -> None:
        """End all processes at once."""
        with self._lock:
            for k in range(len(self)):
                self._end(k)

    def _pool(self, k: int) -> ProcessPoolExecutor:
        pool = self.pools[k]
        if pool is None:
            context = multiprocessing.get_context("spawn")  # a fork would copy locks and threads of kernels
            pool = self.pools[k] = ProcessPoolExecutor(1, context, initializer=_begin)
            with _environment(self.surroundings[k]):
                self.born[k] = pool.submit(os.getpid)
        return pool

    def _settle(self, k: int, future: "Future[Any]") -> None:
        with self._lock:
            self.pending[k] -= 1
            born = self.born[k]
            if future.cancelled() or born is None or not born.done() or born.cancelled():
                return
            if born.exception() is None:
                self._stillborn.clear()
            elif isinstance(future.exception(), BrokenExecutor):
                self._stillborn.add(born)
                if len(self._stillborn) >= STILLBORN:
                    self.unborn = UNBORN

    def _end(self, k: int) -> None:
        pool, self.pools[k] = self.pools[k], None
        if pool is None:
            return
        for process in list((getattr(pool, "_processes", None) or {}).values()):
            with suppress(OSError, ValueError):
                process.kill()
        pool.shutdown(wait=False)


def _surroundings(k: int, count: int, devices: Sequence[str] | None) -> dict[str, str]:
    """Environment variables of a worker: its share of the cores, and its GPU."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    found = {THREADS: os.environ.get(THREADS) or str(max(1, cores // count))}
    if devices is not None:
        name, _, number = devices[k % len(devices)].partition(":")
        place = int(number) if number.isdigit() else 0
        visible = [text for text in os.environ.get(VISIBLE, "").split(",") if text.strip()]
        if name == "cuda":
            found[VISIBLE] = visible[place] if place < len(visible) else str(place)
    return found


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Environment variables as a process that is started meanwhile finds them."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _begin() -> None:
    """In a new worker: Ctrl-C is for the process that started it, and with that one it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
