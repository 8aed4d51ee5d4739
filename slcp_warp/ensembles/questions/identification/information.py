"""What logs tell of numbers and of their own first states: each log's of its own alone."""

from typing import NamedTuple

import numpy as np


class Information(NamedTuple):
    """Fisher's information, (M71): K numbers, which all logs share, and the first states of R logs.

    Attributes:
        shared: (K, K).
        cross: (R, K, starts).
        own: (R, starts, starts).
    """

    shared: np.ndarray
    cross: np.ndarray
    own: np.ndarray

    @classmethod
    def of(cls, each: np.ndarray, count: int) -> "Information":
        """From that of every log about K numbers and its start, (R, K + starts, K + starts), and what is
        known before.
        """
        starts = each.shape[1] - count
        shared = each[:, :count, :count].sum(axis=0) + np.eye(count)
        return cls(shared, each[:, :count, count:], each[:, count:, count:] + np.eye(starts))

    def damped(self, damping: float) -> "Information":
        """With so much more on the diagonal, as a share of what is there."""
        scale = 1.0 + damping * np.eye(len(self.shared)), 1.0 + damping * np.eye(self.own.shape[1])
        return Information(self.shared * scale[0], self.cross, self.own * scale[1])

    @property
    def reduced(self) -> np.ndarray:
        """(K, K) about the numbers, where first states are not known."""
        told = self.cross @ np.linalg.solve(self.own, self.cross.swapaxes(1, 2))
        return np.asarray(self.shared - told.sum(axis=0))

    def follows(self, moved: np.ndarray, pull: np.ndarray | float = 0.0) -> np.ndarray:
        """(R, starts) how far first states go along when numbers move (K,), with gradients (R, starts) of
        their own.
        """
        return np.asarray(-np.linalg.solve(self.own, (moved @ self.cross + pull)[..., None])[..., 0])

    def step(self, gradient: np.ndarray) -> np.ndarray:
        """Minus the gradient (size,) by the information."""
        count = len(self.shared)
        pull = gradient[count:].reshape(self.own.shape[:2])
        push = (self.cross @ np.linalg.solve(self.own, pull[..., None]))[..., 0].sum(axis=0)
        moved = -np.linalg.solve(self.reduced, gradient[:count] - push)
        return np.concatenate([moved, self.follows(moved, pull).ravel()])

    @property
    def deviations(self) -> tuple[np.ndarray, np.ndarray]:
        """(K,) of the numbers, and (R, starts) of the first states where the numbers are known."""
        both = np.linalg.inv(self.reduced), np.linalg.inv(self.own)
        numbers, starts = (np.sqrt(np.diagonal(each, axis1=-2, axis2=-1)) for each in both)
        return numbers, starts
