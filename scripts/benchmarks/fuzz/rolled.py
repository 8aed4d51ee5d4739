"""Worlds that are followed: every step of a rollout is judged as a step from where it starts.

The generic kernels' rollouts go on in double precision from step to step, whatever they give back; in float32
they are followed by single steps that hand on what they remember, which start where they say.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slcp_warp.description.kinematics import Array
from slcp_warp.options import Status

from .draws import Worlds
from .judge import Outcome
from .judged import kind_of, numbers_for, parameters

FAR = 100.0  # [m, rad], and a hundred times that a second: a world is followed no further
AT_ONCE = 400  # steps that are judged together


@dataclass(frozen=True)
class Followed:
    """Steps as worlds by themselves: where each starts, what came of it, and which world's and step it is."""

    worlds: Worlds
    out: Outcome
    world: Array
    step: Array

    def part(self, keep: Any) -> "Followed":
        """Some of the steps."""
        return Followed(self.worlds.part(keep), self.out.part(keep), self.world[keep], self.step[keep])

    def pieces(self) -> list["Followed"]:
        """Of AT_ONCE steps each."""
        places = np.arange(len(self.world))
        return [self.part(places[i : i + AT_ONCE]) for i in range(0, len(places), AT_ONCE)]


@dataclass(frozen=True)
class Stepped:
    """A rollout by single steps, as far as `follow` asks."""

    states: Array
    impulse: Array
    gap: Array
    status: Array


def roll(sim: Any, worlds: Worlds, us: Array) -> Any:
    """The package's rollout of the worlds under controls (B, N, nu)."""
    params, kind = parameters(sim, numbers_for(sim, worlds)), kind_of(sim)
    x, us = worlds.x.astype(kind), us.astype(kind)
    if sim.strategy == "generic" and kind is np.float32:
        return _stepped(sim, x, us, params)
    return sim.rollout(x, us, params, record=("impulse", "gap"))


def _stepped(sim: Any, x: Array, us: Array, params: Any) -> Stepped:
    """A failed world stays where it is."""
    states, impulses, gaps, warm = [x], [], [], None
    status = np.zeros(len(x), int)
    for k in range(us.shape[1]):
        done = sim.step(states[-1], us[:, k] if sim.nu else None, params, warm_start=warm)
        going = (status == Status.SOLVED)[:, None]
        states.append(np.where(going, done.state, states[-1]))
        impulses.append(np.where(going, done.impulse, 0.0))
        gaps.append(done.gap)
        status = np.where(going[:, 0], done.status, status)
        warm = done.multiplier
    return Stepped(np.stack(states, 1), np.stack(impulses, 1), np.stack(gaps, 1), status)


def follow(run: Any, worlds: Worlds, us: Array) -> Followed:
    """The steps of a rollout, as far as there are any: a world that fails ends with the step that does."""
    states, impulse, gap = (np.asarray(a, float) for a in (run.states, run.impulse, run.gap))
    impulse, gap = (np.where(np.isnan(a), 0.0, a) for a in (impulse, gap))  # of steps that failed
    count, steps = us.shape[:2]
    nr = worlds.numbers["sigma"].shape[1]
    before, after = states[:, :-1], states[:, 1:]
    moves = (before != after).any(2) | (impulse[:, :, :nr] != 0.0).any(2)
    last = np.where(moves.any(1), steps - 1 - moves[:, ::-1].argmax(1), -1)
    status = np.asarray(run.status)
    end = np.where(status == Status.SOLVED, steps - 1, np.minimum(last + 1, steps - 1))
    nv = before.shape[2] // 2
    far = FAR * np.where(np.arange(2 * nv) < nv, 1.0, 100.0)
    near = np.logical_and.accumulate((np.abs(before) < far).all(2), 1)
    world, step = np.nonzero(near & (np.arange(steps) <= end[:, None]))
    failed = (status[world] != Status.SOLVED) & (step == end[world])
    starts = replace(worlds.part(world), x=before[world, step], u=us[world, step])
    out = Outcome(after[world, step], impulse[world, step][:, :nr], gap[world, step][:, :nr],
                  np.where(failed, status[world], int(Status.SOLVED)))  # fmt: skip
    return Followed(starts, out, world, step)
