"""What a filter's sensors show in a run: when they are read, with what noise, and what never comes."""

import math
from statistics import NormalDist

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.policies.around import OF_ESTIMATES, make_sensor_kernel

from ...inputs.errors import ArgumentError
from ...simulator import Simulator
from .sensors import Sensors

SAME = 1e-6  # of the time between two readings: what is nearer is when one is due


class Readings:
    """The sensors of a filter in one run of some worlds.

    What `policies.Sensor` says is drawn here, by world and question; of a state whose sensor is a number the
    run's own noise is in what it shows.
    """

    def __init__(
        self, sensors: Sensors, bias: np.ndarray, model: Simulator, worlds: np.ndarray, seed: int
    ) -> None:
        """Args:
        sensors: of the scene that runs, whose points they show.
        bias: (S,) what each shows beside what it is of.
        model: whose device draws.
        worlds: their numbers (B,), through all chunks of a sweep.
        seed: of noise, and of what is lost.
        """
        self._sensors, self._bias, self._model, self._seed = sensors, bias, model, seed
        self._numbers: wp.array = wp.array(np.asarray(worlds, np.int32), dtype=wp.int32, device=model.device)
        self._noise = np.sqrt(sensors.variance) * sensors.drawn
        of_all = NormalDist()
        self._lost = np.array([_quantile(of_all, each.lost) for each in sensors.every])
        self._draws = bool(self._noise.any() or np.isfinite(self._lost).any())
        self._begun = np.full(len(sensors), -1.0)  # how often it had been due, when it was read last
        self._questions = 0

    def of(self, x: np.ndarray, time: float, felt: dict[str, np.ndarray]) -> np.ndarray:
        """(B, S) of states (B, nx) at a time [s], and of what was felt in the step before, by name; NaN where
        one is not read.
        """
        out = self._sensors.expected(x)
        for i in self._sensors.of_step:
            if self._sensors.names[i] not in felt:
                raise ArgumentError(
                    f"sensor {self._sensors.names[i]!r} feels forces; feel(shown) comes before act"
                )
            out[:, i] = felt[self._sensors.names[i]]
        out += self._bias
        if self._draws:
            normal = self._normal(len(x))
            out = out + self._noise * normal[:, : len(self._sensors)]
            out[normal[:, len(self._sensors) :] < self._lost] = np.nan
        for sensor, each in enumerate(self._sensors.every):
            if each.every > 0.0:
                begun = math.floor(time / each.every + SAME)
                if begun == self._begun[sensor]:
                    out[:, sensor] = np.nan
                self._begun[sensor] = begun
        return out

    def _normal(self, worlds: int) -> np.ndarray:
        """Standard normal numbers (B, 2 S) of the next question."""
        sim, width = self._model, 2 * len(self._sensors)
        asked: wp.array = wp.full(worlds, self._questions, dtype=wp.int32, device=sim.device)
        one: wp.array = wp.ones(width, dtype=sim.dtype, device=sim.device)
        nothing: wp.array = wp.zeros((worlds, width), dtype=sim.dtype, device=sim.device)
        out: wp.array = wp.empty_like(nothing)
        inputs = [asked, self._seed, OF_ESTIMATES, self._numbers, one, nothing, out]
        launch(make_sensor_kernel(sim.dtype), worlds, inputs, sim.device)
        self._questions += 1
        return np.asarray(out.numpy(), float)


def _quantile(of: NormalDist, share: float) -> float:
    if share in (0.0, 1.0):
        return math.inf if share else -math.inf
    return of.inv_cdf(share)
