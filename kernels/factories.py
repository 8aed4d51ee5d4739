"""Kernel factories that remember what they made, for all threads.

Warp's code generation and its modules keep state of the process. Two threads that made one kernel at once
would get two structs of one name, of which a launch takes only its own, and would load a module while it
changes: so whatever makes or loads kernels does it under one lock, and what is made is found without it.

Warp reads a function's text from its file when the function is made, by the line at which Python found it. A
file that has changed since, as an upgrade under a running process changes it, would give other lines: so
nothing is made from files that are not those that the process began with.
"""

import functools
import inspect
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
        self.folder, self._looked = folder, time.monotonic()
        self._stamps = self._now()

    def _now(self) -> dict[str, tuple[int, int]]:
        found = ((path, path.stat()) for path in sorted(self.folder.rglob("*.py")))
        return {str(path): (stat.st_mtime_ns, stat.st_size) for path, stat in found}

    def check(self) -> None:
        """Raise SourcesChangedError for files that have changed, come or gone; looked at every `EVERY` s."""
        if time.monotonic() - self._looked < EVERY:
            return
        self._looked, now = time.monotonic(), self._now()
        if now != self._stamps:
            names = sorted(path for path, _ in set(now.items()) ^ set(self._stamps.items()))
            raise SourcesChangedError(
                f"{names[0]} is not the file that this process began with; kernels that are still to be made "
                "would be of another program: start again"
            )


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
