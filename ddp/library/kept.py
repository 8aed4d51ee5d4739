"""The folders in which libraries keep what is finished while they are built."""

import os
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from slcp_warp import Simulator
from slcp_warp.ensembles.stored.identity import told
from slcp_warp.inputs.checks import path as checked_path
from slcp_warp.runs.sequence import Sequence, opened
from slcp_warp.runs.store import Store

from ..identity import device_kind, function_identity, problem_identity, simulator_identity
from ..problem import Problem

SHIFTS, ROUNDS = "library", "refined library"


def _told(options: Any) -> Any:
    """A `RecedingOptions`; what is not given and was no option once is left out."""
    own = asdict(options)
    return told({name: own[name] for name in own if name != "first" or own[name] is not None}, "options")


def kept_shifts(folder: str | os.PathLike[str], problem: Problem, x0: np.ndarray, options: Any) -> Store:
    """The store of a library's shifts: a new one, or the one that is there if it is of the same chains.

    Args:
        x0: (chains, nx) where they start.
        options: a `RecedingOptions`.
    """
    specification = {
        "problem": problem_identity(problem), "x0": told(x0, "x0"),
        "options": _told(options),
    }  # fmt: skip
    return opened(checked_path("out", folder), Sequence(SHIFTS, specification, device_kind(problem.dynamics)))


def kept_rounds(
    folder: str | os.PathLike[str],
    problem: Problem,
    x0: np.ndarray,
    options: Any,
    count: int,
    rounds: int,
    score: Callable[[np.ndarray], np.ndarray],
    sim: Simulator,
) -> Store:
    """The store of a refined library's rounds: the states in which each round's chains start."""
    specification = {
        "problem": problem_identity(problem), "x0": told(x0, "x0"),
        "options": _told(options),
        "entries": count, "rounds": rounds, "score": function_identity(score, "score"),
        "tried on": simulator_identity(sim),
    }  # fmt: skip
    return opened(checked_path("out", folder), Sequence(ROUNDS, specification, device_kind(problem.dynamics)))
