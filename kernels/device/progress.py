"""What is said of kernels while they are compiled, and a record of it for programs.

Compiling a kernel takes seconds, of a scene with many contacts more than a minute. Once it has taken one
second, a line on stderr says what is compiled, and at its end for how long. There is none with
SLCP_PROGRESS=0, nor where Warp is to say nothing but errors (`warp.config.log_level`, `warp.config.quiet`).
"""

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import warp as wp

from ..method import Method
from ..specialisation import Specialisation
from ..structure import Structure

PATIENCE = 1.0  # seconds of silence
OFF = ("0", "off", "no", "false")

_scenes: dict[Structure, str] = {}
_records: list[list["Loaded"]] = []
_announced: list[str] = []  # what is being compiled and may have a line


@dataclass(frozen=True)
class Loaded:
    """A kernel that was made ready for a device, and whether it had to be compiled for that."""

    kernel: str
    device: str
    seconds: float
    compiled: bool


def name_scene(structure: Structure, name: str) -> None:
    """Call scenes of a structure by this name from now on."""
    _scenes[structure] = name


def describe(kernel: wp.Kernel) -> str:
    """A kernel in words: what it does, of which scene, and what else its factory was called with."""
    given = dict(getattr(kernel, "made_with", {}))
    for spec in [value for value in given.values() if isinstance(value, Specialisation)]:
        given = spec._asdict() | given
    scenes = [_scenes.get(value, "a scene") for value in given.values() if isinstance(value, Structure)]
    details = [word for name, value in given.items() for word in _words(name, value)]
    what = kernel.key.rpartition("_")[0] or kernel.key  # without the digest
    what = what.removesuffix("_kernel").replace("_", " ")
    return what + "".join(f" of {name}" for name in scenes) + (f" ({', '.join(details)})" if details else "")


def _words(name: str, argument: Any) -> list[str]:
    if argument is True:
        return [name.replace("_", " ")]
    if isinstance(argument, Method):
        words = [argument.residual]
        if argument.coulomb:
            words.append("Coulomb's friction")
        if argument.trapezoidal:
            words.append("trapezoidal")
        return words
    if isinstance(words := getattr(argument, "in_words", None), str):
        return [words]
    if isinstance(argument, str):
        return [argument.replace("_", " ")]
    return [argument.__name__] if argument in (wp.float32, wp.float64) else []


@contextmanager
def recorded() -> Iterator[list[Loaded]]:
    """A list of the kernels that are made ready meanwhile, by any thread."""
    kernels: list[Loaded] = []
    _records.append(kernels)
    try:
        yield kernels
    finally:
        _records[:] = [each for each in _records if each is not kernels]  # lists of equal kernels are equal


def record(loaded: Loaded) -> None:
    """Tell those who listen (`recorded`) that a kernel is ready."""
    for kernels in _records:
        kernels.append(loaded)


def wanted() -> bool:
    """Whether a user is to see what is compiled."""
    off = os.environ.get("SLCP_PROGRESS", "").strip().lower() in OFF
    return not (off or wp.config.log_level > wp.LOG_WARNING or getattr(wp.config, "quiet", False))


@contextmanager
def announced(what: str) -> Iterator[None]:
    """Say what is compiled once the block has taken `PATIENCE` seconds, and for how long at its end."""
    if not wanted():
        yield
        return
    line = _Line(f"slcp-warp: compiling {what} ...")
    _announced.append(what)
    try:
        yield
    except BaseException:
        line.end("stopped after")
        raise
    else:
        line.end("")
    finally:
        _announced.remove(what)


def compiling() -> bool:
    """Whether something is compiled whose line others would tear."""
    return bool(_announced)


@contextmanager
def one_line() -> Iterator[None]:
    """Leave out Warp's own line about a kernel, which would tear this one, where this one is to be seen.

    For a thread that holds the lock of building.
    """
    level = wp.config.log_level
    if wanted() and level == wp.LOG_INFO:
        wp.config.log_level = wp.LOG_WARNING
    try:
        yield
    finally:
        wp.config.log_level = level


class _Line:
    """A line that is begun after a while, and ended if it was begun; in two parts, and no carriage return."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.start = time.monotonic()
        self.begun = self.ended = False
        self.lock = threading.Lock()
        self.timer = threading.Timer(PATIENCE, self.begin)
        self.timer.daemon = True
        self.timer.start()

    def begin(self) -> None:
        with self.lock:
            if not self.ended:
                self.begun = True
                _write(self.text)

    def end(self, how: str) -> None:
        self.timer.cancel()
        with self.lock:
            self.ended = True
            if self.begun:
                _write(f" {how}{' ' if how else ''}{time.monotonic() - self.start:.1f} s\n")


def _write(text: str) -> None:
    try:
        sys.stderr.write(text)
        sys.stderr.flush()
    except (AttributeError, OSError, ValueError):  # no stderr, or one that is closed: nobody reads it
        pass
