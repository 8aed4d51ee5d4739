"""Work in processes forked from this one: Warp's compiler for a CPU takes one kernel at a time in a process.

A forked process has all that was made here, kernels included, and leaves what it compiles in the cache. Only
where that is safe: on Linux. Warp's lock of translation is held while forking, so that no other thread's is
held in the child for ever; a child that does not end in time, or in peace, is given up, and whoever asked
does its work.
"""

import os
import signal
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from warp._src.codegen import _codegen_lock

FORKS = sys.platform == "linux"
PAUSE = 0.02  # seconds between two looks


def in_processes(jobs: Sequence[Callable[[], Any]], most: int, patience: float) -> None:
    """Run jobs in processes of their own, at most so many at a time; what one raises, or is killed by, is not
    told.

    Args:
        patience: seconds after which a job is given up.
    """
    waiting, running = list(jobs), dict[int, float]()
    try:
        while waiting or running:
            while waiting and len(running) < most:
                running[_forked(waiting.pop(0))] = time.monotonic() + patience
            time.sleep(PAUSE)
            for pid in [pid for pid in running if _ended(pid)]:
                del running[pid]
            for pid in [pid for pid, end in running.items() if time.monotonic() > end]:
                _kill(pid)
                del running[pid]
    finally:
        for pid in running:
            _kill(pid)


def _forked(job: Callable[[], Any]) -> int:
    """Fork; the process that does the job. That one never leaves here, whatever comes in between."""
    own = os.getpid()
    try:
        with _codegen_lock, warnings.catch_warnings(action="ignore"):  # that a thread may hold another lock
            pid = os.fork()
        if pid:
            return pid
        job()
    except BaseException:  # the parent does it again, and sees what is wrong
        if os.getpid() == own:
            raise
        os._exit(1)
    os._exit(0)


def _ended(pid: int) -> bool:
    try:
        return os.waitpid(pid, os.WNOHANG)[0] == pid
    except ChildProcessError:  # somebody else has waited for it
        return True


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError, ChildProcessError):
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
