"""How well numbers explain recorded runs: what an extended Kalman filter of them is surprised by."""

from typing import NamedTuple

import numpy as np

from ....inputs.checks import memory
from ....policies.estimated.extended import Belief, foretold, solved, spread
from .logs import Logs
from .unknowns import Unknowns

REACH = 1e-3  # that first states are moved by for differences, in deviations
LARGEST = 2**28  # bytes of what is kept of the worlds that run at once


class Surprise(NamedTuple):
    """What sensors were off by from what a filter foretold, of C candidates.

    Attributes:
        off: (C, R, N + 1, sensors), NaN where one was not read.
        covariance: (C, R, N + 1, sensors, sensors) that was foretold of it; 1 for one that was not read.
        failures: (C, R) steps of the model without a solution, or without derivatives.
    """

    off: np.ndarray
    covariance: np.ndarray
    failures: np.ndarray


class Likelihood:
    """The negative logarithm of what is known after the logs, less a constant, (M70).

    It is a function of places: the K numbers that are looked for, behind them the first state of each log as
    far as nobody knows it (R, starts), all in standard deviations of what is known before.

    Attributes:
        count: K; 0 where the numbers are given.
        starts: (starts,) which states nobody knows at the start.
        softening: (nx,) variances of states after a second, beside those of the filter's process.
    """

    def __init__(self, unknowns: Unknowns, logs: Logs, given: np.ndarray | None = None) -> None:
        """Args:
        given: (K,) the numbers, where first states alone are looked for.
        """
        self.unknowns, self.logs, filter = unknowns, logs, unknowns.filter
        self.given, self.count = given, len(unknowns) if given is None else 0
        first = np.diag(filter.first)
        self.starts = np.flatnonzero(first)
        self._deviation = np.sqrt(first[self.starts])
        self.softening = np.zeros(filter.model.nx)
        runs, times, sensors = logs.measured.shape
        each = 8 * times * sensors * (sensors + 1)
        memory("measured: the logs of one candidate", runs, each, filter.model.device)
        self._at_once = max(1, LARGEST // (runs * each))

    @property
    def runs(self) -> int:
        """R."""
        return len(self.logs.x0)

    def places(self, z: np.ndarray) -> np.ndarray:
        """Places (C, size) of numbers z (C, count), with first states as the first measurements tell them."""
        filter, (seen, _, x0) = self.unknowns.filter, self.logs
        belief = Belief(x0, np.tile(filter.first, (self.runs, 1, 1)), np.zeros(self.runs, int))
        known = filter.surprised(belief, seen[:, 0] - filter.bias, filter.params, filter.variance)[0]
        starts = (known.mean - x0)[:, self.starts] / self._deviation
        return np.concatenate([z, np.tile(starts.ravel(), (len(z), 1))], axis=1)

    def first_states(self, places: np.ndarray) -> np.ndarray:
        """(C, R, nx) of places."""
        out = np.tile(self.logs.x0, (len(places), 1, 1))
        moved = places[:, self.count :].reshape(len(places), self.runs, len(self.starts))
        out[:, :, self.starts] += moved * self._deviation
        return out

    def surprise(self, places: np.ndarray) -> Surprise:
        """Of candidates (C, size), all logs and candidates side by side."""
        parts = [self._surprise(each) for each in self._parts(places)]
        return Surprise(*(np.concatenate(each) for each in zip(*parts)))

    def cost(self, places: np.ndarray) -> np.ndarray:
        """(C,) of candidates (C, size); infinite where there is none."""
        numbers = 0.5 * (places[:, : self.count] ** 2).sum(axis=1)
        return np.asarray(numbers + self.costs(places).sum(axis=1))

    def costs(self, places: np.ndarray) -> np.ndarray:
        """(C, R) what each log has in that of candidates (C, size)."""
        starts = places[:, self.count :].reshape(len(places), self.runs, len(self.starts))
        return np.asarray(self.data(places) + 0.5 * (starts**2).sum(axis=2))

    def data(self, places: np.ndarray) -> np.ndarray:
        """(C, R) what the sensors have in that, infinite where there is no such filter."""
        total = np.concatenate([costs(self._surprise(each)) for each in self._parts(places)])
        return np.where(np.isfinite(total), total, np.inf)

    def by_starts(self, places: np.ndarray) -> tuple[Surprise, np.ndarray]:
        """The surprise of candidates (C, size), and slopes (C, starts, R, N + 1, sensors) of what sensors are
        off by, by the first states of the logs.
        """
        count, starts, size = self.count, len(self.starts), places.shape[1]
        moves = np.zeros((starts, self.runs, starts))
        moves[np.arange(starts), :, np.arange(starts)] = REACH
        moved = np.concatenate([np.zeros((starts, count)), moves.reshape(starts, size - count)], axis=1)
        around = np.concatenate([np.zeros((1, size)), moved, -moved])
        found = self.surprise((places[:, None] + around).reshape(len(places) * len(around), size))
        off, covariance, failures = (
            each.reshape(len(places), len(around), *each.shape[1:]) for each in found
        )
        filled = np.where(np.isfinite(off), off, 0.0)
        slopes = (filled[:, 1 : 1 + starts] - filled[:, 1 + starts :]) / (2.0 * REACH)
        return Surprise(off[:, 0], covariance[:, 0], failures[:, 0]), slopes

    def start_information(self, places: np.ndarray) -> np.ndarray:
        """(C,) half the logarithm of the determinant of what logs tell of their first states: with it the
        cost at the likeliest first states is that of any.
        """
        out, at_once = [], max(1, self._at_once // (1 + 2 * len(self.starts)))
        for i in range(0, len(places), at_once):
            found, slopes = self.by_starts(places[i : i + at_once])
            with np.errstate(all="ignore"):
                weighed = np.einsum("crtab,clrtb->clrta", np.linalg.inv(found.covariance), slopes)
                told = np.einsum("ckrta,clrta->crkl", slopes, weighed)
                size = np.linalg.slogdet(told + np.eye(len(self.starts)))[1]
            out.append(0.5 * size.sum(axis=1))
        total = np.concatenate(out)
        return np.where(np.isfinite(total), total, np.inf)

    def _parts(self, places: np.ndarray) -> list[np.ndarray]:
        return [places[i : i + self._at_once] for i in range(0, len(places), self._at_once)]

    def _surprise(self, places: np.ndarray) -> Surprise:
        filter, (seen, us, _) = self.unknowns.filter, self.logs
        count, runs, nx, h = len(places), self.runs, filter.model.nx, filter.step_size
        z = places[:, : self.count] if self.given is None else np.tile(self.given, (count, 1))
        params = self.unknowns.parameters(z, runs)
        bias, variance, process = (np.repeat(each, runs, axis=0) for each in self.unknowns.around(z))
        strayed = process[:, None, None] ** 2 * spread(filter.process, h) + spread(self.softening, h)
        mean = self.first_states(places).reshape(count * runs, nx)
        belief = Belief(mean, np.zeros((count * runs, nx, nx)), np.zeros(count * runs, int))
        off, both = [], []
        seen_forces = np.isfinite(seen[:, :, filter.sensing.of_step]).any(axis=(0, 2))
        for k in range(seen.shape[1]):
            if k:
                u = np.tile(us[:, k - 1], (count, 1))
                forces = filter.forces if seen_forces[k] else None
                belief = foretold(filter.model, belief, u, params, h, strayed, forces)
            shown = np.tile(seen[:, k], (count, 1)) - bias
            belief, by, covariance = filter.surprised(belief, shown, params, variance)
            off.append(by)
            known = np.isfinite(by)
            both.append(np.where(known[:, :, None] & known[:, None, :], covariance, np.eye(len(bias[0]))))
        shape = count, runs, seen.shape[1]
        return Surprise(
            np.stack(off, axis=1).reshape(*shape, -1),
            np.stack(both, axis=1).reshape(*shape, *both[0].shape[1:]),
            belief.failures.reshape(count, runs),
        )


def costs(found: Surprise) -> np.ndarray:
    """(C, R) what sensors have in (M70), of candidates that are surprised by so much."""
    off = np.where(np.isfinite(found.off), found.off, 0.0)[..., None]
    with np.errstate(all="ignore"):
        distance = (off * solved(found.covariance, off)).sum(axis=(-2, -1))
        size = np.linalg.slogdet(found.covariance)[1]
        return np.asarray(0.5 * (distance + size).sum(axis=2))
