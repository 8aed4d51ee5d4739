"""Mean and variance of a stream, block by block."""

import math
from dataclasses import dataclass

import numpy as np

Z95 = 1.959963984540054


@dataclass(frozen=True)
class Moments:
    """How many values there are, their mean, and the sum of their squared deviations from it.

    The sums of a block are exact before they are rounded, so no processor gives others; blocks are joined as
    by Chan, Golub and LeVeque (1983).
    """

    count: int = 0
    mean: float = 0.0
    squares: float = 0.0

    @classmethod
    def of(cls, values: np.ndarray) -> "Moments":
        """Of the finite ones of some values."""
        values = np.asarray(values, float)
        values = values[np.isfinite(values)]
        if not len(values):
            return cls()
        mean = _sum(values) / len(values)
        with np.errstate(over="ignore", invalid="ignore"):
            return cls(len(values), mean, _sum((values - mean) ** 2))

    def __add__(self, other: "Moments") -> "Moments":
        """Of both together."""
        if not self.count or not other.count:
            return self if self.count else other
        count, apart = self.count + other.count, other.mean - self.mean
        mean = self.mean + apart * (other.count / count)
        squares = self.squares + other.squares + apart * apart * (self.count * (other.count / count))
        return Moments(count, mean, squares)

    @property
    def variance(self) -> float:
        """The unbiased estimate; NaN for fewer than two values."""
        return self.squares / (self.count - 1) if self.count > 1 else math.nan

    def interval(self, z: float = Z95) -> tuple[float, float, float]:
        """The mean and its normal-theory interval: (mean, low, high); NaN without values."""
        if not self.count:
            return math.nan, math.nan, math.nan
        half = z * math.sqrt(self.variance / self.count)
        return self.mean, self.mean - half, self.mean + half


def _sum(values: np.ndarray) -> float:
    try:
        return math.fsum(values.tolist())
    except OverflowError:  # beyond the largest number
        return math.inf
