"""A job: so many chunks, each a function of its index alone; and what says that two jobs are the same one."""

import hashlib
import importlib
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..inputs.checks import shown
from ..inputs.errors import ArgumentError

Columns = dict[str, np.ndarray]
Plain = dict[str, Any]  # values of JSON
MAKER = "__makes_jobs__"
MISSING = "(nothing)"


class Job(ABC):
    """A computation in chunks that do not depend on each other.

    Attributes:
        kind: what it computes, a word ("sweep").
        count: chunks; None: they follow from each other, and the caller knows when there are enough.
        device: kind of device that it runs on; results are the same bit for bit on one kind.
    """

    kind: str
    count: int | None
    device: str = "cpu"

    @abstractmethod
    def specification(self) -> Plain:
        """All that decides what is computed, as JSON values; no executor, no threads, no sizes of chunks."""

    @abstractmethod
    def run(self, index: int) -> Columns:
        """Columns of equal length, the rows of a chunk.

        The rows of chunk 0, 1, ... one after the other are the table, whatever the sizes of the chunks.
        """

    def layout(self) -> Plain:
        """How the rows are cut into chunks, as JSON values: what a job of the same specification, and of the
        same parts on disk, has to agree on.
        """
        return {"chunks": self.count}

    def reference(self) -> Plain:
        """`reference_to` a function, from which another process rebuilds the job.

        Raises:
            ArgumentError: something in it cannot travel; the message says what can be given in its place.
        """
        raise ArgumentError(f"a {self.kind} of this kind cannot be handed to other processes")

    def tally(self, columns: Columns) -> dict[str, int]:
        """Counts that add up over chunks, to be shown meanwhile; "rows" at least, "failures" where known."""
        return {"rows": len(next(iter(columns.values())))}

    def prepare(self) -> None:  # noqa: B027  most have nothing to prepare
        """Compile what the chunks need, before several processes would do it at once."""

    def provenance(self) -> Plain:
        """How to make it again, as JSON values, beside what the store adds of its own."""
        return {}


def makes_jobs(function: Callable[..., Job]) -> Callable[..., Job]:
    """Decorator: `rebuild` may call this function of a module. Others are refused: a manifest may come from
    anywhere.
    """
    setattr(function, MAKER, True)
    return function


def reference_to(maker: Callable[..., Job], **arguments: Any) -> Plain:
    """The reference of a job that `maker` (see `makes_jobs`) gives for arguments of JSON values."""
    if maker.__module__ == "__main__":
        raise ArgumentError(
            f"{maker.__qualname__} is of the script itself; a module that can be imported is needed"
        )
    return plain({"make": f"{maker.__module__}:{maker.__qualname__}", "arguments": arguments}, "reference")


def rebuild(reference: Mapping[str, Any]) -> Job:
    """The job of a reference.

    Raises:
        ArgumentError: it names nothing that makes jobs.
    """
    make, arguments = reference.get("make"), reference.get("arguments")
    if not isinstance(make, str) or not isinstance(arguments, dict):
        raise ArgumentError(f"reference is {shown(dict(reference))}; 'make' and 'arguments' are needed")
    module, _, name = make.partition(":")
    try:
        maker = getattr(importlib.import_module(module), name, None)
    except (ImportError, ValueError) as error:
        raise ArgumentError(
            f"reference names {make!r:.80}, which cannot be imported here: {error}"
        ) from error
    if maker is None or not getattr(maker, MAKER, False):
        raise ArgumentError(f"reference names {make!r:.80}, which makes no jobs")
    job: Job = maker(**arguments)
    return job


def plain(values: Any, what: str) -> Any:
    """Values as JSON gives them back: tuples as lists, NumPy's numbers as Python's."""
    try:
        return json.loads(json.dumps(values, default=_number))
    except (TypeError, ValueError, RecursionError) as error:
        raise ArgumentError(f"{what} holds what JSON cannot: {error}") from error


def _number(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__}")


def sha256_of(values: Any) -> str:
    """SHA-256 of JSON values in their canonical form: sorted keys, no blanks, ASCII."""
    text = json.dumps(values, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def differences(there: Any, here: Any, name: str = "") -> list[str]:
    """Where two JSON values differ, a line each: "seed: 0 there, 1 here"."""
    if isinstance(there, dict) and isinstance(here, dict):
        lines = []
        for key in dict.fromkeys((*there, *here)):
            label = f"{name}.{key}" if name else str(key)
            lines += differences(there.get(key, MISSING), here.get(key, MISSING), label)
        return lines
    return [] if there == here else [f"{name}: {shown(there)} there, {shown(here)} here"]
