"""Sensors of the forces of a step: what they are foretold to show when it has been made."""

from typing import Any, NamedTuple

import numpy as np

from ...inputs.errors import ArgumentError
from ...measures.signals import OF_TENDONS, TRAPEZOIDAL, Signal
from ...parameters import Parameters
from ...simulator import Simulator
from .sensors import Sensors, moved


class Shown(NamedTuple):
    """What is foretold of the F sensors of the forces of a step that has been made, in B worlds.

    Attributes:
        mean: (B, F), NaN where the step, or one beside it, was not solved.
        across: (B, nx, F) covariance with the state after the step.
        covariance: (B, F, F).
    """

    mean: np.ndarray
    across: np.ndarray
    covariance: np.ndarray


class Forces:
    """Of a model's sensors those of the forces of a step."""

    def __init__(self, model: Simulator, sensors: Sensors) -> None:
        self._model = model
        every = [sensors.every[i].of for i in sensors.of_step]
        self._signals = [of for of in every if isinstance(of, Signal)]
        kinds = {part.kind for of in self._signals for part in of.parts()}
        if OF_TENDONS in kinds and model.options.method.trapezoidal:
            raise ArgumentError(f"a sensor of {OF_TENDONS}: {TRAPEZOIDAL}")

    def foretold(
        self, mean: np.ndarray, covariance: np.ndarray, A: np.ndarray, u: Any, params: Parameters
    ) -> Shown:
        """After a step from a mean (B, nx) of a covariance (B, nx, nx), whose end has the slopes A, (M75).

        Slopes of forces are central differences of steps beside it, all in one launch.
        """
        B, nx, F = len(mean), mean.shape[1], len(self._signals)
        if not covariance.any():
            values = self._values(mean, u, params)
            return Shown(values, np.zeros((B, nx, F)), np.zeros((B, F, F)))
        known = np.isfinite(mean).all(axis=1)
        around, twice = moved(np.where(known[:, None], mean, self._model.scene.x0), np.arange(nx))
        count = around.shape[1]
        us = np.repeat(np.broadcast_to(u, (B, self._model.nu)), count, axis=0)
        if params.worlds is not None:
            params = params.from_table(np.repeat(params.table(), count, axis=0))
        values = self._values(around.reshape(B * count, nx), us, params).reshape(B, count, F)
        slopes = ((values[:, 1 : 1 + nx] - values[:, 1 + nx :]) / twice[:, :, None]).swapaxes(1, 2)
        known = known & np.isfinite(values).all(axis=(1, 2))
        slopes = np.where(known[:, None, None], slopes, 0.0)
        to_forces = covariance @ slopes.swapaxes(1, 2)
        return Shown(np.where(known[:, None], values[:, 0], np.nan), A @ to_forces, slopes @ to_forces)

    def _values(self, x: np.ndarray, u: Any, params: Parameters) -> np.ndarray:
        """(n, F) in a step from states (n, nx); NaN where it is not solved."""
        us = np.broadcast_to(u, (len(x), self._model.nu))[:, None]
        run = self._model.rollout(x, us, params, record=("controls", "impulse"))
        return np.stack([run.series(each)[:, 0] for each in self._signals], axis=1)
