"""The most likely numbers, from several starts at once: Fisher's scoring, differences side by side."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .information import Information
from .likelihood import Likelihood, Surprise
from .stirring import stirred

NEAR = 0.1  # of a standard deviation: what a number is moved by for a difference
FIRST, LEAST = 1e-3, 1e-7  # of the first differences, and of any
DAMPING = (0.0, 0.01, 0.1, 1.0, 10.0, 100.0)  # of a step, tried side by side
FARTHEST = 2.0  # that a step moves a number by
NOTHING = 1e-4  # of a cost
STIRRED, ENOUGH = 4, 0.01  # times at most in a stage, and what is gained of a cost to go on
RESOLUTION, ROUGHLY = 1e-3, 0.1  # squared standard deviations from the minimum, by a quadratic model
NEARBY = 0.3  # standard deviations between two starts on the same way


@dataclass
class Minimum:
    """Where one of the starts has come to.

    Attributes:
        place: (size,), see `Likelihood`.
        cost: (M70).
        information: (M71), of what was known before included; None so far.
        stirred: how often it has been.
        ended: "resolution", "rounds", or "rough": no step along the derivatives lowers the cost by more than
            nothing; "" so far.
    """

    place: np.ndarray
    cost: float = np.inf
    information: Information | None = None
    stirred: int = 0
    ended: str = ""

    @property
    def known(self) -> Information:
        """The information, where there is one."""
        assert self.information is not None
        return self.information

    def reach(self, count: int, runs: int) -> tuple[np.ndarray, np.ndarray]:
        """(K,), (R, starts) what numbers and first states are moved by for differences."""
        if self.information is None:
            return np.full(count, FIRST), np.full((runs, (len(self.place) - count) // runs), FIRST)
        numbers, starts = (np.clip(NEAR * each, LEAST, NEAR) for each in self.information.deviations)
        return numbers, starts


class Search:
    """Starts on their way down.

    Attributes:
        minima: the least cost first once they have ended.
    """

    def __init__(self, likelihood: Likelihood, starts: np.ndarray, seed: int = 0) -> None:
        """Args:
        starts: (S, size).
        seed: of what is tried about a place.
        """
        self.likelihood, self._rng = likelihood, np.random.default_rng(seed)
        self.minima = [Minimum(place) for place in starts]

    def run(self, rounds: int, told: Callable[[], None] = lambda: None, roughly: bool = False) -> None:
        """Until every start has ended, by the likelihood as it is now.

        Args:
            rounds: at most.
            told: called once a round.
            roughly: to a third of a deviation, where the likelihood is another one afterwards.
        """
        self._near = ROUGHLY if roughly else RESOLUTION
        costs = self.likelihood.cost(np.stack([each.place for each in self.minima]))
        for each, now in zip(self.minima, costs):
            each.cost, each.ended, each.stirred = float(now), "" if np.isfinite(now) else "rough", 0
        for number in range(rounds + 1):
            active = [each for each in self.minima if not each.ended]
            if not active:
                break
            self._round(active, last=number == rounds)
            told()
        self.minima.sort(key=lambda each: each.cost)

    def _round(self, active: list[Minimum], last: bool) -> None:
        steps = [self._steps(each, slope) for each, slope in zip(active, self.slopes(active))]
        going = [(each, own) for each, own in zip(active, steps) if not each.ended]
        if not going:
            return
        tried = np.stack([each.place + own for each, own in going])
        costs = self.likelihood.cost(tried.reshape(-1, tried.shape[-1])).reshape(tried.shape[:2])
        for (each, _), places, own in zip(going, tried, costs):
            best = int(own.argmin())
            if last:
                each.ended = "rounds"
            elif each.cost - own[best] < NOTHING:
                each.ended = "rough"
            if own[best] < each.cost:
                each.place, each.cost = places[best], float(own[best])
        self._join()
        for each in self.minima:
            known = each.information is not None
            if known and each.ended == "rough" and each.stirred < STIRRED and self._near < ROUGHLY:
                self._stir(each)

    def _stir(self, minimum: Minimum) -> None:
        """Where derivatives lead no further, look about; go on from what is better."""
        minimum.stirred += 1
        place, cost = stirred(self.likelihood, minimum.place, minimum.known, self._rng)
        if minimum.cost - cost > ENOUGH:
            minimum.place, minimum.cost, minimum.ended = place, cost, ""

    def _join(self) -> None:
        """Leave out starts that have come to where a better one is."""
        kept: list[Minimum] = []
        for each in sorted(self.minima, key=lambda each: each.cost):
            count = self.likelihood.count
            if all(own.information is None or apart(own, each, count) >= NEARBY for own in kept):
                kept.append(each)
        self.minima = kept

    def slopes(self, active: list[Minimum]) -> list[np.ndarray]:
        """Gradients (size,); their informations are put in."""
        runs, count = self.likelihood.runs, self.likelihood.count
        moves = [_moves(each, count, runs) for each in active]
        rows = [np.concatenate([each.place[None], each.place + own, each.place - own])
                for each, own in zip(active, moves)]  # fmt: skip
        found, size = self.likelihood.surprise(np.concatenate(rows)), len(rows[0])
        return [
            slopes(each, Surprise(*(part[i * size : (i + 1) * size] for part in found)), count)
            for i, each in enumerate(active)
        ]

    def _steps(self, minimum: Minimum, gradient: np.ndarray) -> np.ndarray:
        """Steps (dampings, size) to try; a minimum that is near enough has ended."""
        known = minimum.known
        if not (np.isfinite(gradient).all() and all(np.isfinite(each).all() for each in known)):
            minimum.information, minimum.ended = None, "rough"
            return np.zeros((len(DAMPING), len(gradient)))
        steps = np.array([known.damped(damping).step(gradient) for damping in DAMPING])
        if -gradient @ steps[0] <= self._near:
            minimum.ended = "resolution"
        return np.asarray(steps / np.maximum(1.0, np.abs(steps).max(axis=1, keepdims=True) / FARTHEST))


def _moves(minimum: Minimum, count: int, runs: int) -> np.ndarray:
    """(K + starts, size): a number of all logs, or a state of every log's own start, is moved."""
    numbers, starts = minimum.reach(count, runs)
    of_starts = np.zeros((starts.shape[1], *starts.shape))
    for i in range(starts.shape[1]):
        of_starts[i, :, i] = starts[:, i]
    out = np.zeros((count + starts.shape[1], len(minimum.place)))
    out[:count, :count] = np.diag(numbers)
    out[count:, count:] = of_starts.reshape(starts.shape[1], starts.size)
    return out


def slopes(minimum: Minimum, found: Surprise, count: int) -> np.ndarray:
    """Gradient (size,) of (M70) at a minimum so far, whose information is put in.

    Args:
        found: surprise of its place, then of what is moved forth, and back.
        count: K.
    """
    runs, moved = found.off.shape[1], len(found.off) // 2
    numbers, starts = minimum.reach(count, runs)
    twice = 2.0 * np.concatenate([np.tile(numbers[:, None], (1, runs)), starts.T])
    off = np.where(np.isfinite(found.off), found.off, 0.0)
    inverse = np.linalg.inv(found.covariance[0])
    weighed = (inverse @ off[0][..., None])[..., 0]
    d_off = (off[1 : 1 + moved] - off[1 + moved :]) / twice[..., None, None]
    d_both = found.covariance[1 : 1 + moved] - found.covariance[1 + moved :]
    d_both /= twice[..., None, None, None]
    each = np.einsum("krta,rta->kr", d_off, weighed)
    each -= 0.5 * np.einsum("rta,krtab,rtb->kr", weighed, d_both, weighed, optimize=True)
    d_both = inverse @ d_both
    each += 0.5 * np.einsum("krtaa->kr", d_both)
    information = np.einsum("krta,rtab,lrtb->rkl", d_off, inverse, d_off, optimize=True)
    information += 0.5 * np.einsum("krtab,lrtba->rkl", d_both, d_both)
    minimum.information = Information.of(information, count)
    return np.concatenate([each[:count].sum(axis=1), each[count:].T.ravel()]) + minimum.place


def apart(minimum: Minimum, other: Minimum, count: int) -> float:
    """How many standard deviations another minimum's K numbers are away."""
    off = (other.place - minimum.place)[:count]
    return float(np.sqrt(max(0.0, off @ minimum.known.reduced @ off)))
