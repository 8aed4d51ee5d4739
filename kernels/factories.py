"""Kernel factories that remember what they made, for all threads.

Warp's code generation and its modules keep state of the process. Two threads that made one kernel at once
would get two structs of one name, of which a launch takes only its own, and would load a module while it
changes: so whatever makes or loads kernels does it under one lock, and what is made is found without it.

Warp reads a function's text from its file when the function is made, by the line at which Python found it. A
file that has changed since, as an upgrade under a running process changes it, would give other lines: so
nothing is made from files that are not those that the process began with.
"""

import functools
import hashlib
import inspect
import math
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import warp as wp

Made = TypeVar("Made")

EVERY = 1.0  # seconds between two looks at the files

_lock = threading.RLock()


class SourcesChangedError(OSError):
    """A file of the kernels is not the one that this process began with."""


class Sources:
    """The files of a folder with its folders, as they are when this is made."""

    def __init__(self, folder: Path) -> None:
        self._looked = time.monotonic()
        self._known = {path: (_stamp(path), _digest(path)) for path in sorted(folder.rglob("*.py"))}

    def check(self) -> None:
        """Raise SourcesChangedError for files that say something else or are gone, every `EVERY` seconds."""
        if time.monotonic() - self._looked < EVERY:
            return
        self._looked = time.monotonic()
        for path, (stamp, digest) in self._known.items():
            now = _stamp(path)
            if now != stamp and (now is None or _digest(path) != digest):
                self._looked = -math.inf  # the next one that asks is told, too
                raise SourcesChangedError(
                    f"{path} is not the file that this process began with; kernels that are still to be made "
                    "would be of another program: start again"
                )
            self._known[path] = now, digest


def _stamp(path: Path) -> tuple[int, int] | None:
    """When a file was written and how long it is; None: it is not there."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


def _digest(path: Path) -> str:
    """Of what a file holds, "" where it cannot be read."""
    try:
        return hashlib.blake2b(path.read_bytes()).hexdigest()
    except OSError:
        return ""


_sources = Sources(Path(__file__).parent)


def building() -> Any:
    """The lock that is held while kernels are made or loaded."""
    return _lock


def cached(factory: Callable[..., Made]) -> Callable[..., Made]:
    """As `functools.cache`, but what threads ask for at the same time is made once."""
    made: dict[Any, Made] = {}

    @functools.wraps(factory)
    def find(*args: Any, **options: Any) -> Made:
        key = (args, *sorted(options.items())) if options else args
        try:
            return made[key]
        except KeyError:
            pass
        with building():
            if key not in made:
                _sources.check()
                made[key] = factory(*args, **options)
                for kernel in made[key] if isinstance(made[key], tuple) else (made[key],):
                    if isinstance(kernel, wp.Kernel):
                        kernel.made_with = inspect.signature(factory).bind(*args, **options).arguments
            return made[key]

    return find


def _after_fork() -> None:
    """A lock that another thread of the parent held would never be released in the child."""
    global _lock
    _lock = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
