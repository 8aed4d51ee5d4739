"""Policies that act on the host, asked between launches."""

import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from ..inputs.arrays import ArrayError
from ..inputs.checks import attribute, number, numeric, shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..measures.arithmetic import SUM
from ..measures.signals import OF_CONTACTS, OF_TENDONS, Signal

FELT = (*OF_CONTACTS, OF_TENDONS)


class HostPolicy(Protocol):
    """A policy that acts on the host: any object with `act`; the others may be missing.

    Attributes:
        period: between two questions [s], rounded to whole steps; None, or missing: a step.
        senses: by name signals of contacts and tendons (`slcp_warp.measures`), which `feel` is told.
    """

    period: float | None
    senses: Mapping[str, Signal]

    def begin(self, sim: Any, worlds: np.ndarray, step_size: float) -> None:
        """A rollout begins, or a chunk of a sweep: what is remembered of worlds is to be forgotten.

        Args:
            sim: the simulator that steps them.
            worlds: their numbers (B,), through all chunks of a sweep.
            step_size: of their steps [s]; a `begin` of two arguments is not told.
        """

    def feel(self, shown: dict[str, np.ndarray]) -> None:
        """Before every question: what `senses` names, (B,) each, in the step that was made last; NaN before
        the first.
        """

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> Any:
        """Controls (B, nu) or (nu,) of the states x (B, nx) at a time [s], held until the next question."""


def acts_on_host(policy: Any) -> bool:
    """Whether a policy is asked on the host."""
    return not isinstance(policy, type) and callable(attribute(policy, "act"))


def steps_between(policy: Any, step_size: float) -> int:
    """Steps between two questions to a policy on the host."""
    period = attribute(policy, "period")
    if period is None:
        return 1
    return max(1, math.floor(number("policy.period", period, 0.0, above=True) / step_size + 0.5))


def senses_of(policy: Any) -> dict[str, Signal]:
    """What a policy on the host feels, by name.

    Raises:
        ArgumentError, ArgumentTypeError: what is no signal of contacts or tendons, nobody to feel it.
    """
    given = attribute(policy, "senses")
    if not given:
        return {}
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        raise ArgumentTypeError(f"policy.senses is {shown(given)}; a dict of signals by name is needed")
    for name, signal in given.items():
        if not isinstance(signal, Signal) or not any(each.kind in FELT for each in signal.parts()):
            raise ArgumentTypeError(
                f"policy.senses[{name!r}] is {shown(signal)}; a signal of contacts or tendons, of "
                "slcp_warp.measures, is needed"
            )
        other = [each for each in signal.parts() if each.kind not in (*FELT, SUM) or each.since_start]
        if other:
            raise ArgumentError(
                f"policy.senses[{name!r}] is {signal!r}, with {other[0]!r}; contacts and tendons of a step, "
                "and sums of these alone, are felt"
            )
    if not callable(attribute(policy, "feel")):
        raise ArgumentTypeError(f"policy is a {type(policy).__name__} with senses; it needs a method `feel`")
    return dict(given)


class Asked:
    """A policy on the host in one rollout, or one chunk of a sweep.

    Attributes:
        every: steps between two questions.
        senses: what it feels, by name.
        look: of a rollout, what gives that, (B, F), from a step: states before, controls, states after,
            impulses, gaps and status; None: it feels nothing, or is told otherwise.

    Raises:
        ArgumentError: worlds whose step sizes differ, which have no time in common.
    """

    def __init__(self, policy: Any, sim: Any, worlds: np.ndarray, step_sizes: np.ndarray) -> None:
        if len(step_sizes) and np.ptp(step_sizes):
            raise ArgumentError(
                f"policy is a {type(policy).__name__}, which acts on the host at times of all worlds; their "
                f"step sizes are {step_sizes.min():g} to {step_sizes.max():g} s, and one is needed"
            )
        self.policy, self.nu, self.worlds = policy, sim.nu, worlds
        self.h = float(step_sizes[0]) if len(step_sizes) else sim.scene.step_size
        self.every = steps_between(policy, self.h)
        self.senses = senses_of(policy)
        self.look: Callable[..., np.ndarray] | None = None
        begin = attribute(policy, "begin")
        if begin is not None:
            if not callable(begin):
                raise ArgumentTypeError(f"policy.begin is {shown(begin)}; a function is needed")
            begin(*(sim, worlds, self.h)[: 3 if _takes_size(begin) else 2])

    def controls(self, k: int, x: np.ndarray, felt: np.ndarray | None = None) -> np.ndarray:
        """Controls (B, nu) of states (B, nx) at step k, and of what was felt in the last one, (B, F); None:
        nothing yet.

        Raises:
            ArgumentError, ArrayError: what came back is no such array of finite numbers.
        """
        if self.senses:
            felt = np.full((len(x), len(self.senses)), np.nan) if felt is None else felt
            self.policy.feel(dict(zip(self.senses, felt.T.copy())))
        return told(self.policy, x.astype(np.float64), k * self.h, self.worlds, self.nu)


def _takes_size(begin: Any) -> bool:
    """Whether a policy's `begin` is told the size of steps, as its third argument."""
    try:
        inspect.signature(begin).bind(None, None, None)
    except (TypeError, ValueError):
        return False
    return True


def told(policy: Any, x: np.ndarray, time: float, worlds: np.ndarray, nu: int) -> np.ndarray:
    """Controls (B, nu) that a policy on the host gives for states (B, nx).

    Raises:
        ArgumentError, ArrayError: what came back is no such array of finite numbers.
    """
    given = policy.act(x, time, worlds)
    found = numeric(given)
    if found is None:
        raise ArgumentError(f"policy gave {shown(given)} at {time:g} s; an array of numbers is needed")
    if found.shape not in ((nu,), (len(x), nu)):
        raise ArrayError(
            f"policy gave shape {found.shape} at {time:g} s; ({len(x)}, {nu}) or ({nu},) is needed"
        )
    out = np.broadcast_to(found, (len(x), nu))
    still = np.isfinite(x).all(1)
    if not np.isfinite(out[still]).all():
        bad = out[still][~np.isfinite(out[still])][0]
        raise ArgumentError(f"policy gave {bad} at {time:g} s; finite numbers are needed")
    return out
