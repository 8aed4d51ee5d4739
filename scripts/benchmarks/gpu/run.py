"""Running sections one after the other, each in a process of its own, so that none takes the others with it.

An illegal access on a GPU leaves no use of it in the process, and a kernel that hangs can only be killed from
outside. What a section finds comes over a pipe and is in the file before the next thing is looked for.
"""

import contextlib
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any

import warp as wp

from .record import DONE, FAILED, LEFT_OUT, RUNNING, Event, Found, Record
from .sections import SECTIONS, Section
from .setting import Setting

LEAST = 10.0  # seconds that a section needs to begin
Send = Callable[[Event], None]
Say = Callable[[str], None]
Work = Callable[[Setting, Found], None]


def run(
    record: Record, setting: Setting, names: Sequence[str], seconds: float, say: Say, apart: bool = True
) -> None:
    """Run sections by name, in at most so many seconds all together.

    Args:
        apart: each in a process of its own; without, an error of Python's is all that is survived.
    """
    end = time.monotonic() + seconds
    for name in names:
        section = SECTIONS[name]

        def send(event: Event, name: str = name) -> None:
            record.add(name, event)

        why = _left_out(section, setting, end - time.monotonic())
        if why:
            send({"kind": "end", "status": LEFT_OUT, "error": why})
            say(f"{name}: left out, {why}")
            continue
        send({"kind": "end", "status": RUNNING})
        begin, limit = time.monotonic(), min(section.seconds, end - time.monotonic())
        (_in_process if apart else _here)(section.run, setting, send, limit)
        found = record.section(name)
        if found["status"] == RUNNING:
            send({"kind": "end", "status": FAILED, "error": "its process ended without a word"})
        send({"kind": "end", "seconds": round(time.monotonic() - begin, 3)})
        bad = sum(not check["right"] for check in found["checks"])
        count, spent = len(found["checks"]), found["seconds"]
        say(f"{name}: {found['status']}, {count} checks, {bad} wrong, {spent:.1f} s")


def _left_out(section: Section, setting: Setting, left: float) -> str:
    """Why a section is not run, or ""."""
    if section.gpu and not setting.gpu:
        return "it needs a GPU"
    return "no time was left" if left < LEAST else ""


def _here(work: Work, setting: Setting, send: Send, _limit: float = 0.0) -> None:
    """Run a section and send its end, whatever it is."""
    wp.config.log_level = wp.LOG_WARNING
    try:
        work(setting, Found(send))
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        send({"kind": "end", "status": FAILED, "error": text, "traceback": traceback.format_exc()})
    else:
        send({"kind": "end", "status": DONE})


def _child(work: Work, setting: Setting, pipe: Connection) -> None:
    """A section's process, and the leader of those that it starts."""
    if hasattr(os, "setsid"):
        os.setsid()
    _here(work, setting, pipe.send)
    pipe.close()


def _in_process(work: Work, setting: Setting, send: Send, limit: float) -> None:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(work, setting, theirs))
    process.start()
    theirs.close()
    end = time.monotonic() + limit
    try:
        while time.monotonic() < end:
            if ours.poll(max(0.0, min(0.5, end - time.monotonic()))):
                send(ours.recv())
        send({"kind": "end", "status": FAILED, "error": f"it took more than {limit:.0f} s"})
    except (EOFError, OSError):  # it is done, or dead
        process.join(5.0)
        if process.exitcode:
            error = f"its process ended with code {process.exitcode}"
            send({"kind": "end", "status": FAILED, "error": error})
    finally:
        _end(process)


def _end(process: Any) -> None:
    """Nothing that a section started outlives it."""
    if process.is_alive():
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if hasattr(os, "killpg"):
                os.killpg(process.pid, signal.SIGKILL)
        process.kill()  # where it has no group of its own yet
    process.join(10.0)
