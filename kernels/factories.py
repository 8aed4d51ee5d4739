"""Kernel factories that remember what they made, for all threads.

Warp's code generation and its modules keep state of the process. Two threads that made one kernel at once
would get two structs of one name, of which a launch takes only its own, and would load a module while it
changes: so whatever makes or loads kernels does it under one lock, and what is made is found without it.
"""

import functools
import inspect
import os
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import warp as wp

Made = TypeVar("Made")

_lock = threading.RLock()


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
