"""States from sensors: an extended Kalman filter whose model is a simulator, through contact."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from ...description.names import index_of
from ...description.scene import Scene
from ...gradients import tape
from ...inputs.checks import array, instance, number, shown, whole
from ...inputs.errors import ArgumentError
from ...parameters import Parameters
from ...simulator import Simulator
from .extended import Belief, corrected, foretold, spread
from .forces import Forces
from .sensing import by_sensor
from .sensors import MOST, Sensor, Sensors, difference

AGAIN = 3  # times that slopes of sensors that are no states are taken at what they tell
NEAR = 0.01  # of a deviation, by which that changes no more


class KalmanFilter:
    """An extended Kalman filter: the mean goes by the model's step, the covariance by its exact A, (M66).

    With a model of `Options(noise="state")` contact is as soft as the state is uncertain: (M18) with the
    covariance of v + q/h that is believed, (M69), in place of a noise level that is chosen.

    Args:
        model: what is believed, a simulator with derivatives; `scene.step_size` is the size of its steps.
        sensors: state name -> standard deviation of its measurement, 1e-50 to 1e50 [its unit]; or a name of
            its own -> a `policies.Sensor` of something else: points, distances, forces, a function.
        process: what the model does not know: standard deviation by which a state strays in a second, as
            white noise does (by sqrt(t) in t seconds); by state name, or one number for all velocities, which
            take positions along, (M67) [its unit per root of a second].
        start: standard deviation of the first state, by state name (others 0), (nx,), or one for all.
        x0: (nx,) mean of the first state; None: the scene's.
        params: numbers of the model, one row; None: the simulator's.
        bias: what a sensor shows beside what it is of, by its name; None: nothing [its unit].

    Attributes:
        sensors: (sensors,) their names.
        sensing: what they show.
        variance, bias: (sensors,) of the sensors.
        process: (nx,) variances of states after a second.
        x0, first: (nx,), (nx, nx) mean and covariance of the first state.
        step_size: of the model [s].

    Raises:
        ArgumentError, ArgumentTypeError: names that the scene has not got, numbers out of range.
        OptionError: a model without derivatives.
        ArgumentError: sensors of forces, and a model in float32, whose differences are noise.
    """

    def __init__(
        self,
        model: Simulator,
        sensors: Mapping[str, float | Sensor],
        process: Any,
        start: Any = 0.0,
        x0: Any = None,
        params: Parameters | None = None,
        bias: Mapping[str, float] | None = None,
    ) -> None:
        self.model = instance("model", model, Simulator, "a slcp_warp.Simulator")
        tape.derivatives_exist(model.options.method)
        scene, nx = model.scene, model.nx
        self.sensing = Sensors(scene, sensors)
        self.sensors, self.variance = self.sensing.names, self.sensing.variance
        self.forces = Forces(model, self.sensing) if len(self.sensing.of_step) else None
        if self.forces and model.dtype is not wp.float64:
            raise ArgumentError(
                "model is of float32, and sensors are of forces, whose slopes are differences; "
                "Simulator(..., dtype='float64') is needed"
            )
        self.bias = by_sensor("bias", bias, self.sensors)
        velocities = np.arange(nx) >= scene.nv
        self.process = np.square(_deviations("process", process, scene, velocities))
        self.first = np.diag(np.square(_deviations("start", start, scene, np.full(nx, True))))
        if not (self.process.any() or self.first.any()):
            raise ArgumentError("process and start are both 0: what is sure learns nothing; one is needed")
        self.x0 = scene.x0 if x0 is None else array("x0", x0, (nx,))
        self.params = model.params.matching(params, 1)
        if self.params.worlds is not None:
            raise ArgumentError(
                f"params has rows of {self.params.worlds} worlds; one, of the model, is needed"
            )
        self.step_size = float(np.ravel(self.params["step_size"])[0])

    def __repr__(self) -> str:
        how = "as soft as the state is uncertain" if self._adapts else self.model.options.residual
        return f"<KalmanFilter of {self.model.scene.name!r}: sees {', '.join(self.sensors)}; contact {how}>"

    @property
    def _adapts(self) -> bool:
        return self.model.options.method.state_noise

    def begin(self, worlds: int) -> Belief:
        """What is known of so many worlds before anything is measured."""
        whole("worlds", worlds, 0)
        return Belief(
            np.tile(self.x0, (worlds, 1)), np.tile(self.first, (worlds, 1, 1)), np.zeros(worlds, int)
        )

    def predict(self, belief: Belief, u: Any, seconds: float | None = None) -> Belief:
        """What is known after a time in which controls acted, (M66), in steps of about the model's size.

        Where the model's step is not solved bodies go on at their velocities, and where it has no
        derivatives, as of what is pushed flush under Coulomb's friction, errors of the mean do.

        Args:
            u: (B, nu) or (nu,) controls.
            seconds: how long [s]; None: a step of the model.
        """
        seconds = self.step_size if seconds is None else number("seconds", seconds, 0.0, above=True)
        steps = max(1, round(seconds / self.step_size))
        h = seconds / steps
        params = self.params.replace(step_size=h) if abs(h / self.step_size - 1.0) > 1e-9 else self.params
        strayed = spread(self.process, h)
        for _ in range(steps):
            belief = foretold(self.model, belief, u, params, h, strayed, self.forces)
        return belief

    def correct(self, belief: Belief, measured: Any) -> Belief:
        """What is known when the sensors have been read, (M68); angles count modulo their period.

        Sensors of forces show those of the step before: at the start there are none, and nothing is read.

        Args:
            measured: (B, sensors), in their order; NaN where one was not read.
        """
        mean = instance("belief", belief, Belief, "a policies.Belief").mean
        seen = array("measured", measured, (len(mean), len(self.sensors)), finite=False)
        return self.surprised(belief, seen - self.bias, self.params, self.variance)[0]

    def surprised(
        self, belief: Belief, shown: np.ndarray, params: Parameters, variance: np.ndarray
    ) -> tuple[Belief, np.ndarray, np.ndarray]:
        """What is known when the sensors have been read, what they were off by, and its covariance.

        Where sensors are no states their slopes are taken again at what they tell, as long as they are met
        better there (M76).

        Args:
            shown: (B, sensors) without their biases; NaN where one was not read.
            params: of the worlds, or one row.
            variance: (sensors,) or (B, sensors).

        Returns:
            Belief, (B, sensors) with NaN where one was not read, (B, sensors, sensors).
        """
        told, off, both = self._told(belief, belief.mean, shown, params, variance)[:3]
        for _ in range(AGAIN if self.sensing.bends else 0):
            again, _, _, left = self._told(belief, told.mean, shown, params, variance)
            sd = np.sqrt(np.maximum(np.diagonal(again.covariance, axis1=1, axis2=2), 0.0))
            far = (np.abs(again.mean - told.mean) > NEAR * sd).any(axis=1)  # of each world by itself
            if not far.any():
                break
            expected = self.sensing.expected(again.mean, params)
            better = far & (self._left(expected, shown, variance) < left)
            mean = np.where(better[:, None], again.mean, told.mean)
            told = Belief(mean, np.where(better[:, None, None], again.covariance, told.covariance),
                          told.failures)  # fmt: skip
        return told, off, both

    def _told(
        self, belief: Belief, at: np.ndarray, shown: np.ndarray, params: Parameters, variance: np.ndarray
    ) -> tuple[Belief, np.ndarray, np.ndarray, np.ndarray]:
        """As `surprised`, with slopes at states (B, nx), and (B,) by what sensors are off there."""
        expected, slopes = self.sensing.seen(at, params)
        left = self._left(expected, shown, variance)
        if belief.shown is not None:
            expected[:, self.sensing.of_step] = belief.shown.mean
        off = difference(shown, expected, self.sensing.period)
        off = off - (slopes @ (belief.mean - at)[:, :, None])[:, :, 0]
        return *corrected(belief, off, slopes, variance, self.sensing.of_step), left

    def _left(self, expected: np.ndarray, shown: np.ndarray, variance: np.ndarray) -> np.ndarray:
        """(B,) by what sensors of states are off, squared, in deviations of theirs."""
        off = difference(shown, expected, self.sensing.period)
        off[np.isnan(expected) & np.isfinite(shown)] = np.inf  # what is not defined is not met
        off[:, self.sensing.of_step] = 0.0
        return np.asarray(np.nansum(off**2 / variance, axis=1))

    def estimate(self, measured: Any, controls: Any) -> Belief:
        """A recorded run, looked at afterwards: every estimate from what was measured until then.

        Args:
            measured: (B, N + 1, sensors), at the model's steps; NaN where nothing was.
            controls: (B, N, nu) that acted, or (N, nu).

        Returns:
            Mean (B, N + 1, nx), covariance (B, N + 1, nx, nx) and failures (B,) after N steps.
        """
        seen = array("measured", measured, ("B", "N + 1", len(self.sensors)), finite=False)
        if not seen.shape[1]:
            raise ArgumentError(f"measured has shape {seen.shape}; that of the start, at least, is needed")
        us = array("controls", controls)
        us = np.broadcast_to(us, (len(seen), *us.shape)) if us.ndim == 2 else us
        if us.shape != (len(seen), seen.shape[1] - 1, self.model.nu):
            need = f"({len(seen)}, {seen.shape[1] - 1}, {self.model.nu})"
            raise ArgumentError(f"controls has shape {us.shape}; {need} is needed")
        beliefs = [self.correct(self.begin(len(seen)), seen[:, 0])]
        for k in range(us.shape[1]):
            beliefs.append(self.correct(self.predict(beliefs[-1], us[:, k]), seen[:, k + 1]))
        mean, covariance = (np.stack(each, axis=1) for each in list(zip(*beliefs))[:2])
        return Belief(mean, covariance, beliefs[-1].failures)


def _deviations(name: str, given: Any, scene: Scene, all_of: np.ndarray) -> np.ndarray:
    """(nx,) standard deviations, by state name, as they are, or one for `all_of` the states."""
    if isinstance(given, Mapping):
        out = np.zeros(len(all_of))
        for state, sd in given.items():
            out[index_of(f"a name of {name}", state, scene.state_names)] = number(
                f"{name}[{state!r}]", sd, 0.0, MOST
            )
        return out
    found = array(name, given)
    if found.shape not in ((), all_of.shape) or not ((found >= 0.0) & (found <= MOST)).all():
        raise ArgumentError(
            f"{name} is {shown(given)}; a number from 0 to {MOST:g}, ({len(all_of)},) of them, or numbers by "
            "state name, are needed"
        )
    return np.where(all_of, found, 0.0) if found.ndim == 0 else found
