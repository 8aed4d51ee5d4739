"""The smallest vector that makes a score fail: directions on shells, then strategies that shrink.

First directions, evenly distributed, are tried at growing sizes, all in one batch. Then evolution strategies
with step sizes of their own start from the smallest failing vectors in different directions: each proposes
vectors around its best one, no larger, and takes the smallest that fails (Rechenberg's one-fifth rule for the
step size; Beyer and Schwefel 2002). In the end the ball inside the smallest is drawn from evenly; if anything
in it fails, the strategies go on from there. Nothing is assumed of the score but its sign.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

Fails = Callable[[np.ndarray], np.ndarray]  # (B, d) -> (B,), whether it fails
Suggest = Callable[[np.ndarray], np.ndarray]  # (K, d) failing vectors -> (n, d) others worth trying
SHELLS = 24
LAST = 1e-3  # relative step of a strategy that has come to rest
FINE = 0.02  # relative step below which a search may end
GAIN = 1e-3  # relative gain over `PATIENCE` rounds under which the search ends
PATIENCE = 5
BALLS = 6  # balls within the smallest failing vector that are looked through, at most


@dataclass
class Found:
    """What a search came to.

    Attributes:
        best: (K, d) the strategies' smallest failing vectors, the smallest first; none: nothing failed.
        tried: (n, d) all vectors that were tried, and `failed` (n,) whether each failed.
        suggested: improvements that came from `suggest`, and `drawn` from draws.
        rounds: of the strategies.
    """

    best: np.ndarray
    tried: np.ndarray
    failed: np.ndarray
    suggested: int = 0
    drawn: int = 0
    rounds: int = 0

    def after(self, earlier: "Found") -> "Found":
        """This one, with what an earlier one took."""
        for name in ("suggested", "drawn", "rounds"):
            setattr(self, name, getattr(self, name) + getattr(earlier, name))
        return self

    @classmethod
    def nothing(cls, dimension: int) -> "Found":
        """Of no search."""
        return cls(np.zeros((0, dimension)), np.zeros((0, dimension)), np.zeros(0, bool))


@dataclass
class Search:
    """A search for the smallest failing vector.

    Attributes:
        fails: of a batch of vectors.
        dimension: of a vector.
        batch: vectors at once.
        least, most: sizes of the innermost and of the outermost shell.
        strategies: that go on side by side.
        rounds: at most.
        suggest: other vectors that are worth trying beside those drawn, by gradients.
    """

    fails: Fails
    dimension: int
    batch: int
    least: float
    most: float
    strategies: int = 8
    rounds: int = 40
    suggest: Suggest | None = None
    _tried: list[np.ndarray] = field(default_factory=list)
    _failed: list[np.ndarray] = field(default_factory=list)

    def run(self, rng: np.random.Generator, known: np.ndarray | None = None) -> Found:
        """Shells, then strategies, as long as the ball that they leave has something that fails; `known`
        (n, d): vectors that are known to fail.
        """
        start = self._shells(rng)
        if known is not None:
            start = np.concatenate([known, start])
        found = self.refine(self._smallest(start), rng)
        for _ in range(BALLS):
            if not len(found.best):
                break
            inside = in_ball(2 * self.batch, self.dimension, rng) * np.linalg.norm(found.best[0])
            failed = self._try(inside)
            if not failed.any():
                break
            again = self.refine(self._smallest(np.concatenate([inside[failed], found.best])), rng)
            found = again.after(found)
        found.tried, found.failed = np.concatenate(self._tried), np.concatenate(self._failed)
        return found

    def _smallest(self, vectors: np.ndarray) -> np.ndarray:
        """(K, d) the smallest of them, of different directions."""
        order = np.argsort(np.linalg.norm(vectors, axis=1), kind="stable")
        return apart(vectors[order], self.strategies)

    def refine(self, best: np.ndarray, rng: np.random.Generator, step: float = 0.5) -> Found:
        """Strategies from failing vectors (K, d), of a relative step size to begin with."""
        found = Found.nothing(self.dimension)
        found.best = best.copy()
        if len(best):
            self._shrink(found, rng, step)
        return found

    def _try(self, vectors: np.ndarray) -> np.ndarray:
        failed = self.fails(vectors)
        self._tried.append(vectors)
        self._failed.append(failed)
        return failed

    def _shells(self, rng: np.random.Generator) -> np.ndarray:
        """(n, d) the smallest failing vector of every direction that has one."""
        count = max(2 * self.dimension, self.batch // SHELLS)
        axes = np.concatenate([np.eye(self.dimension), -np.eye(self.dimension)])
        drawn = rng.standard_normal((count - len(axes), self.dimension))
        directions = np.concatenate([axes, drawn / np.linalg.norm(drawn, axis=1, keepdims=True)])
        sizes = np.geomspace(self.least, self.most, SHELLS)
        failed = self._try((sizes[:, None, None] * directions).reshape(-1, self.dimension))
        first = failed.reshape(SHELLS, count)
        where = np.flatnonzero(first.any(axis=0))
        size = sizes[np.argmax(first[:, where], axis=0)]
        return directions[where] * size[:, None]

    def _shrink(self, found: Found, rng: np.random.Generator, step: float) -> None:
        """Every strategy's smallest failing vector, smaller from round to round."""
        best = found.best
        steps = np.full(len(best), step)
        history: list[float] = []
        for found.rounds in range(1, self.rounds + 1):
            proposals, owner, whose = self._proposals(best, steps, rng)
            failed = self._try(proposals)
            size, mine = np.linalg.norm(proposals, axis=1), np.linalg.norm(best, axis=1)
            gains = failed & (size < mine[owner])
            for k in range(len(best)):
                chosen = np.flatnonzero(gains & (owner == k))
                drawn = (owner == k) & ~whose
                share = (gains & drawn).sum() / max(drawn.sum(), 1)
                steps[k] = np.clip(steps[k] * (1.5 if share > 0.2 else 0.7), 0.1 * LAST, 1.0)
                if chosen.size:
                    pick = chosen[np.argmin(size[chosen])]
                    best[k] = proposals[pick]
                    found.suggested += int(whose[pick])
                    found.drawn += int(not whose[pick])
            history.append(float(np.linalg.norm(best, axis=1).min()))
            rests = (
                steps[np.argmin(np.linalg.norm(best, axis=1))] < FINE
                and len(history) > PATIENCE
                and history[-1] > (1.0 - GAIN) * history[-1 - PATIENCE]
            )
            if rests or steps.max() < LAST:
                break
        found.best = best[np.argsort(np.linalg.norm(best, axis=1), kind="stable")]

    def _proposals(
        self, best: np.ndarray, steps: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Vectors, whose strategy they are, and which of them were suggested."""
        each = self.batch // len(best)
        owner = np.repeat(np.arange(len(best)), each)
        size, step = np.linalg.norm(best, axis=1)[owner], steps[owner]
        shift = rng.standard_normal((len(owner), self.dimension)) / np.sqrt(self.dimension)
        around = best[owner] + (step * size)[:, None] * shift
        length = size * (1.0 - step * rng.random(len(owner)) ** 2)  # none is larger than its strategy's best
        drawn = around * (length / np.maximum(np.linalg.norm(around, axis=1), 1e-300))[:, None]
        if self.suggest is None:
            return drawn, owner, np.zeros(len(owner), bool)
        more = self.suggest(best)
        more = more[np.linalg.norm(more, axis=1) < np.linalg.norm(best, axis=1).max()]
        near = (
            np.argmin(np.linalg.norm(more[:, None] - best, axis=2), axis=1) if len(more) else np.zeros(0, int)
        )
        whose = np.concatenate([np.zeros(len(owner), bool), np.ones(len(more), bool)])
        return np.concatenate([drawn, more]), np.concatenate([owner, near]), whose


def in_ball(count: int, dimension: int, rng: np.random.Generator) -> np.ndarray:
    """(count, dimension) evenly in the unit ball."""
    drawn = rng.standard_normal((count, dimension))
    units = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
    return np.asarray(units * rng.random((count, 1)) ** (1.0 / dimension))


def apart(vectors: np.ndarray, count: int) -> np.ndarray:
    """Up to `count` of the vectors, in order, each in a direction away from those before it, then any."""
    units = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
    chosen: list[int] = []
    for i in range(len(vectors)):
        if len(chosen) < count and all(units[i] @ units[j] < 0.9 for j in chosen):
            chosen.append(i)
    chosen += [i for i in range(len(vectors)) if i not in chosen][: count - len(chosen)]
    return vectors[chosen].copy()
