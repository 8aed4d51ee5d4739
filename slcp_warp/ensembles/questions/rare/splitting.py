"""Multilevel splitting in a space of standard normal numbers: the probability that a score is at most 0.

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

Score = Callable[[np.ndarray], np.ndarray]  # (B, d) standard normal numbers -> (B,), the event: at most 0
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
        scores: falling; the last is 0, the event, or the lowest where the pilot stopped above it.
        sizes: of the moves below each level but the last, in (0, 1].
    """

    scores: tuple[float, ...]
    sizes: tuple[float, ...]

    @property
    def complete(self) -> bool:
        """Whether they lead to the event."""
        return self.scores[-1] <= 0.0


@dataclass(frozen=True)
class Effort:
    """How much is spent.

    Attributes:
        particles: a level and an island.
        length: states of each chain; particles / length chains start in an island.
        keep: share of the particles that the pilot's levels keep.
        most: levels.
    """

    particles: int = 500
    length: int = 20
    keep: float = 0.2
    most: int = 30

    @property
    def chains(self) -> int:
        """Chains of an island."""
        return max(1, self.particles // self.length)


def next_level(scores: np.ndarray, above: float, keep: float) -> float:
    """The score that the lowest `keep` of the particles do not exceed, below the level `above`.

    Raises:
        StuckError: no particle is below that level.
    """
    if (scores <= 0.0).mean() >= ENOUGH * keep:
        return 0.0
    level = float(np.sort(scores)[max(0, int(np.ceil(keep * len(scores))) - 1)])
    if level >= above:
        lower = scores[scores < above]
        if not lower.size:
            raise StuckError(
                f"the margin of all {len(scores)} worlds is at its lowest, {above:.6g}: nothing says which "
                "of them are nearer to failing; give a margin that falls steadily"
            )
        level = float(lower.max())
    return max(level, 0.0)


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
    """Levels and sizes of moves, set from `worlds` particles a level; complete, or `effort.most` of them.

    Where all have the same score, up to PATIENCE times as many are moved before they count as stuck: a margin
    of few values may fall seldom.
    """
    z = moves.draw(worlds, rng)
    scores = score(z)
    levels: list[float] = []
    sizes: list[float] = []
    above, size, patience = np.inf, LARGE, PATIENCE
    while True:
        try:
            above = next_level(scores, above, effort.keep)
        except StuckError:
            if not patience:
                raise
            patience -= 1
            more, lower, _ = _spread(score, moves, z, scores, above, size, effort, worlds, rng)
            z, scores = np.concatenate([z, more]), np.concatenate([scores, lower])
            continue
        levels.append(above)
        if above <= 0.0 or len(levels) == effort.most:
            return Levels(tuple(levels), tuple(sizes))
        z, scores, size = _spread(score, moves, z, scores, above, size, effort, worlds, rng)
        sizes.append(size)
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

    Attributes:
        counts: (levels, islands) particles at or below each level.
        totals: (levels,) particles of an island there.
        accepted: (levels - 1,) share of accepted moves below each level.
        ended: (n, width) particles at or below the last level, of all islands.
    """

    counts: np.ndarray
    totals: np.ndarray
    accepted: np.ndarray
    ended: np.ndarray

    @property
    def shares(self) -> np.ndarray:
        """(islands,) each one's probability of the last level."""
        return np.prod(self.counts / self.totals[:, None], axis=0)

    def reached(self, level: int) -> np.ndarray:
        """(islands,) each one's probability of a level."""
        return np.prod(self.counts[: level + 1] / self.totals[: level + 1, None], axis=0)


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
    counts, totals = np.zeros((count, islands), int), np.zeros(count, int)
    accepted = np.full(max(last, 0), np.nan)
    z = moves.draw(islands * effort.particles, rng)
    below = score(z) <= levels.scores[0]
    owner = np.repeat(np.arange(islands), effort.particles)
    counts[0] = np.bincount(owner[below], minlength=islands)
    totals[:], totals[0] = effort.chains * effort.length, effort.particles
    z, owner = z[below], owner[below]
    for k in range(last):
        if not len(z):
            break
        z, owner, accepted[k] = _level(score, moves, levels, k, z, owner, effort, islands, rng)
        counts[k + 1] = np.bincount(owner, minlength=islands)
    return Islands(counts, totals, accepted, z)


def _level(
    score: Score, moves: Moves, levels: Levels, k: int, z: np.ndarray, owner: np.ndarray, effort: Effort,
    islands: int, rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """Chains below level k: those of their states that are below the next one, whose they are, acceptance."""
    chosen = []
    for island in range(islands):
        mine = np.flatnonzero(owner == island)
        if mine.size:
            chosen.append(mine[resampled(len(mine), effort.chains, rng)])
    start = np.concatenate(chosen)
    z, owner = z[start], owner[start]
    level, below = levels.scores[k], levels.scores[k + 1]
    scores = score(z)
    states, owners, shares = [z[scores <= below]], [owner[scores <= below]], []
    for _ in range(effort.length - 1):
        z, scores, share = chain(score, moves, z, scores, level, levels.sizes[k], rng)
        states.append(z[scores <= below])
        owners.append(owner[scores <= below])
        shares.append(share)
    return np.concatenate(states), np.concatenate(owners), float(np.mean(shares)) if shares else np.nan
