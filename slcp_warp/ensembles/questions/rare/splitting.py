"""Multilevel splitting in a space of standard normal numbers: how probable the lowest scores are.

The event is approached over falling levels of the score. Between two levels, particles that are below the
first are moved by a Markov chain that leaves the normal law below it as it is (preconditioned Crank-Nicolson
moves, kept where the score stays below); the share of them that is below the second is one factor of the
probability. A pilot run sets levels and sizes of moves. Then independent islands run with these fixed: the
product of an island's factors has exactly the probability as its mean, however slowly the chains mix.

Au and Beck 2001 (subset simulation); Cerou, Del Moral, Furon and Guyader 2012 (fixed levels, unbiased);
Papaioannou et al. 2015 (moves in normal space, their acceptance); Dau and Chopin 2022 (all states of the
chains count: "waste-free").
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....inputs.errors import ArgumentError

Score = Callable[[np.ndarray], np.ndarray]  # (B, d) standard normal numbers -> (B,), the event: the lowest
ACCEPTED = 0.44  # share of the moves of the pilot (Papaioannou et al. 2015)
SMALL, LARGE = 0.01, 1.0  # sizes of moves
PATIENCE = 15  # times as many particles that the pilot moves where all have the same score
ENOUGH = 0.5  # of the share that is kept: so many particles in the event end the levels


class StuckError(ArgumentError):
    """A score that no level leads down: all particles that are left have the same one."""


@dataclass(frozen=True)
class Levels:
    """What a pilot run fixed.

    Attributes:
        scores: falling; the last is the event's, whether the pilot came to it or not.
        sizes: of the moves below each level but the last, in (0, 1].
    """

    scores: tuple[float, ...]
    sizes: tuple[float, ...]


@dataclass(frozen=True)
class Effort:
    """How much is spent.

    Attributes:
        particles: a level and an island.
        length: states of each chain; particles / length chains start in an island.
        keep: share of the particles that the pilot's levels keep.
        most: levels above the event.
        event: scores at or below it are the event.
    """

    particles: int = 500
    length: int = 20
    keep: float = 0.2
    most: int = 30
    event: float = 0.0

    @property
    def chains(self) -> int:
        """Chains of an island."""
        return max(1, self.particles // self.length)


def next_level(scores: np.ndarray, above: float, keep: float, event: float = 0.0) -> float:
    """The score that the lowest `keep` of the particles do not exceed, below the level `above`; the event's,
    where enough of them are in it.

    Raises:
        StuckError: no particle is below that level.
    """
    if (scores <= event).mean() >= ENOUGH * keep:
        return event
    level = float(np.sort(scores)[max(0, int(np.ceil(keep * len(scores))) - 1)])
    if level >= above:
        lower = scores[scores < above]
        if not lower.size:
            raise StuckError(
                f"the margin of all {len(scores)} worlds is at its lowest, {above:.6g}: nothing says which "
                "of them are nearer to failing. Give as `margin` a measure that goes on falling until "
                "the task fails, such as a position or a speed; more `particles` may meet a lower one"
            )
        level = float(lower.max())
    return max(level, event)


@dataclass(frozen=True)
class Moves:
    """Preconditioned Crank-Nicolson moves, sqrt(1 - size^2) z + size xi.

    Attributes:
        width: numbers of a particle.
        fresh: how many of them, the last, have no small changes: half of the moves draw each anew, the others
            leave it.
    """

    width: int
    fresh: int = 0

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Particles (count, width) without a condition."""
        return rng.standard_normal((count, self.width))

    def propose(self, z: np.ndarray, size: float, rng: np.random.Generator) -> np.ndarray:
        """A move of every particle; half of them have a third of the size, whichever is right where it is."""
        sizes = size * np.where(rng.random(len(z)) < 0.5, 1.0, 1.0 / 3.0)[:, None]
        drawn = self.draw(len(z), rng)
        out = np.sqrt(1.0 - sizes**2) * z + sizes * drawn
        if self.fresh:
            anew = rng.random((len(z), self.fresh)) < 0.5
            out[:, -self.fresh :] = np.where(anew, drawn[:, -self.fresh :], z[:, -self.fresh :])
        return out


def chain(
    score: Score, moves: Moves, z: np.ndarray, scores: np.ndarray, level: float, size: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """One move of every particle below a level: states, scores, share of accepted moves."""
    proposal = moves.propose(z, size, rng)
    found = score(proposal)
    accepted = found <= level
    z = np.where(accepted[:, None], proposal, z)
    return z, np.where(accepted, found, scores), float(accepted.mean())


def pilot(score: Score, moves: Moves, effort: Effort, worlds: int, rng: np.random.Generator) -> Levels:
    """Levels and sizes of moves, set from `worlds` particles a level, down to the event.

    Beyond `effort.most` levels the event is the next, however few particles come to it. Where all have the
    same score, up to PATIENCE times as many are moved before they count as stuck: a margin of few values may
    fall seldom.
    """
    z = moves.draw(worlds, rng)
    scores = score(z)
    levels: list[float] = []
    sizes: list[float] = []
    above, size, patience = np.inf, LARGE, PATIENCE
    while True:
        try:
            above = next_level(scores, above, effort.keep, effort.event)
        except StuckError:
            if not patience:
                raise
            patience -= 1
            more, lower, _ = _spread(score, moves, z, scores, above, size, effort, worlds, rng)
            z, scores = np.concatenate([z, more]), np.concatenate([scores, lower])
            continue
        levels.append(above)
        if above <= effort.event:
            return Levels(tuple(levels), tuple(sizes))
        z, scores, size = _spread(score, moves, z, scores, above, size, effort, worlds, rng)
        sizes.append(size)
        if len(levels) == effort.most:
            return Levels((*levels, effort.event), tuple(sizes))
        patience = PATIENCE


def _spread(
    score: Score, moves: Moves, z: np.ndarray, scores: np.ndarray, above: float, size: float, effort: Effort,
    worlds: int, rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """Chains of some of the particles below a level: all their states, scores, the size of moves found."""
    seeds = rng.choice(np.flatnonzero(scores <= above), max(1, worlds // effort.length))
    z, scores = z[seeds], scores[seeds]
    states, values, used = [z], [scores], []
    for move in range(effort.length - 1):
        z, scores, share = chain(score, moves, z, scores, above, size, rng)
        step = (share - ACCEPTED) / np.sqrt(1.0 + 0.5 * move)
        size = float(np.clip(size * np.exp(step), SMALL, LARGE))
        states.append(z)
        values.append(scores)
        used.append(size)
    return np.concatenate(states), np.concatenate(values), float(np.mean(used[len(used) // 2 :]))


def resampled(count: int, wanted: int, rng: np.random.Generator) -> np.ndarray:
    """(wanted,) of `count` survivors, each equally often up to one (systematic resampling)."""
    order = rng.permutation(count)
    places = (rng.random() + np.arange(wanted)) * (count / wanted)
    return order[np.minimum(places.astype(int), count - 1)]


@dataclass
class Islands:
    """Independent runs over fixed levels.

    Particles of level 0 are drawn plainly, those of each further level among what is below the one before.

    Attributes:
        counts: (levels, islands) particles at or below each level.
        failing: (levels, islands) those of them that are in the event.
        totals: (levels,) particles of an island there.
        accepted: (levels - 1,) share of accepted moves below each level.
        ended: (n, width) particles in the event, of the lowest level that met any, of all islands.
    """

    counts: np.ndarray
    failing: np.ndarray
    totals: np.ndarray
    accepted: np.ndarray
    ended: np.ndarray

    @property
    def shares(self) -> np.ndarray:
        """(islands,) each one's probability of the last level."""
        return self.reached(len(self.totals) - 1)

    def reached(self, level: int) -> np.ndarray:
        """(islands,) each one's probability of a level."""
        return np.prod(self.counts[: level + 1] / self.totals[: level + 1, None], axis=0)

    def failed(self, level: int) -> np.ndarray:
        """(islands,) each one's probability of the event, by the particles of this level alone."""
        above = np.ones(self.counts.shape[1]) if level == 0 else self.reached(level - 1)
        return above * self.failing[level] / self.totals[level]


def run_islands(
    score: Score,
    levels: Levels,
    moves: Moves,
    effort: Effort,
    islands: int,
    rng: np.random.Generator,
) -> Islands:
    """Run over fixed levels, all islands side by side."""
    count, last = len(levels.scores), len(levels.scores) - 1
    counts, failing, totals = (
        np.zeros((count, islands), int),
        np.zeros((count, islands), int),
        np.zeros(count, int),
    )
    accepted = np.full(max(last, 0), np.nan)
    z = moves.draw(islands * effort.particles, rng)
    scores, owner = score(z), np.repeat(np.arange(islands), effort.particles)
    totals[:], totals[0] = effort.chains * effort.length, effort.particles
    ended = z[:0]
    for k in range(count):
        if k > 0:
            z, scores, owner, accepted[k - 1] = _level(
                score, moves, levels, k - 1, z, owner, effort, islands, rng
            )
        fails, below = scores <= effort.event, scores <= levels.scores[k]
        failing[k] = np.bincount(owner[fails], minlength=islands)
        counts[k] = np.bincount(owner[below], minlength=islands)
        ended = z[fails] if fails.any() else ended
        z, owner = z[below], owner[below]
        if not len(z):
            break
    return Islands(counts, failing, totals, accepted, ended)


def _level(
    score: Score, moves: Moves, levels: Levels, k: int, z: np.ndarray, owner: np.ndarray, effort: Effort,
    islands: int, rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:  # fmt: skip
    """Chains below level k: their states, scores, whose they are, and the share of accepted moves."""
    chosen = []
    for island in range(islands):
        mine = np.flatnonzero(owner == island)
        if mine.size:
            chosen.append(mine[resampled(len(mine), effort.chains, rng)])
    start = np.concatenate(chosen)
    z, owner = z[start], owner[start]
    scores = score(z)
    states, values, shares = [z], [scores], []
    for _ in range(effort.length - 1):
        z, scores, share = chain(score, moves, z, scores, levels.scores[k], levels.sizes[k], rng)
        states.append(z)
        values.append(scores)
        shares.append(share)
    owners = np.tile(owner, effort.length)
    return np.concatenate(states), np.concatenate(values), owners, float(np.mean(shares))
