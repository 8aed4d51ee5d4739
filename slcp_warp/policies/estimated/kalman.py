"""States from sensors: an extended Kalman filter whose model is a simulator, through contact."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ...description.names import index_of
from ...description.scene import Scene
from ...gradients import tape
from ...inputs.checks import array, instance, number, shown, whole
from ...inputs.errors import ArgumentError, ArgumentTypeError
from ...options import Status
from ...parameters import Parameters
from ...simulator import Simulator

LEAST, MOST = 1e-50, 1e50  # of standard deviations: their squares are numbers


class Belief(NamedTuple):
    """What is known of the states of some worlds.

    Attributes:
        mean: (B, nx).
        covariance: (B, nx, nx).
        failures: (B,) predictions so far in which the model's step had no solution, or no derivatives.
    """

    mean: np.ndarray
    covariance: np.ndarray
    failures: np.ndarray


class KalmanFilter:
    """An extended Kalman filter: the mean goes by the model's step, the covariance by its exact A, (M66).

    With a model of `Options(noise="state")` contact is as soft as the state is uncertain: (M18) with the
    covariance of v + q/h that is believed, (M69), in place of a noise level that is chosen.

    Args:
        model: what is believed, a simulator with derivatives; `scene.step_size` is the size of its steps.
        sensors: state name -> standard deviation of its measurement, 1e-50 to 1e50 [its unit].
        process: what the model does not know: standard deviation by which a state strays in a second, as
            white noise does (by sqrt(t) in t seconds); by state name, or one number for all velocities, which
            take positions along, (M67) [its unit per root of a second].
        start: standard deviation of the first state, by state name (others 0), (nx,), or one for all.
        x0: (nx,) mean of the first state; None: the scene's.
        params: numbers of the model, one row; None: the simulator's.

    Raises:
        ArgumentError, ArgumentTypeError: names that the scene has not got, numbers out of range.
        OptionError: a model without derivatives.
    """

    def __init__(
        self,
        model: Simulator,
        sensors: Mapping[str, float],
        process: Any,
        start: Any = 0.0,
        x0: Any = None,
        params: Parameters | None = None,
    ) -> None:
        self.model = instance("model", model, Simulator, "a slcp_warp.Simulator")
        tape.derivatives_exist(model.options.method)
        scene, nx = model.scene, model.nx
        if not isinstance(sensors, Mapping) or not sensors:
            raise ArgumentTypeError(f"sensors is {shown(sensors)}; a dict of numbers by state name is needed")
        self.places = np.array([index_of("a name of sensors", name, scene.state_names) for name in sensors])
        self.sensors = tuple(scene.state_names[place] for place in self.places)
        if len(set(self.sensors)) < len(self.sensors):
            raise ArgumentError(f"sensors names a state twice: {', '.join(self.sensors)}")
        sds = [number(f"sensors[{name!r}]", sd, LEAST, MOST) for name, sd in sensors.items()]
        self._measured = np.square(sds)
        velocities = np.arange(nx) >= scene.nv
        self._process = np.square(_deviations("process", process, scene, velocities))
        self._first = np.diag(np.square(_deviations("start", start, scene, np.full(nx, True))))
        if not (self._process.any() or self._first.any()):
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
            np.tile(self.x0, (worlds, 1)), np.tile(self._first, (worlds, 1, 1)), np.zeros(worlds, int)
        )

    def predict(self, belief: Belief, u: Any, seconds: float | None = None) -> Belief:
        """What is known after a time in which controls acted, (M66), in steps of about the model's size.

        Where the model's step is not solved, or has no derivatives, bodies go on at their velocities.

        Args:
            u: (B, nu) or (nu,) controls.
            seconds: how long [s]; None: a step of the model.
        """
        seconds = self.step_size if seconds is None else number("seconds", seconds, 0.0, above=True)
        steps = max(1, round(seconds / self.step_size))
        h, nv = seconds / steps, self.model.nx // 2
        params = self.params.replace(step_size=h) if abs(h / self.step_size - 1.0) > 1e-9 else self.params
        free = np.eye(2 * nv)
        free[:nv, nv:] = h * np.eye(nv)
        for _ in range(steps):
            mean, covariance, failures = belief
            if self._adapts:
                params = params.replace(**_noise(covariance, h))
            linear = self.model.linearize(mean, u, params)
            after = self.model.step(mean, u, params)
            solved = (linear.status == Status.SOLVED) & (after.status == Status.SOLVED)
            A = np.where(solved[:, None, None], linear.A.astype(float), free)
            mean = np.where(solved[:, None], after.state.astype(float), mean @ free.T)
            covariance = _symmetric(A @ covariance @ A.swapaxes(1, 2)) + self._strayed(h)
            belief = Belief(mean, covariance, failures + ~solved)
        return belief

    def correct(self, belief: Belief, measured: Any) -> Belief:
        """What is known when the sensors have been read, (M68); angles count modulo their period.

        Args:
            measured: (B, sensors), in their order; NaN where one was not read.
        """
        mean, covariance, failures = instance("belief", belief, Belief, "a policies.Belief")
        seen = array("measured", measured, (len(mean), len(self.places)), finite=False)
        known = np.isfinite(seen)
        off = np.where(known, seen - mean[:, self.places], 0.0)
        period = np.asarray(self.model.scene.state_period)[self.places]
        turns = np.round(np.divide(off, period, out=np.zeros_like(off), where=period > 0.0))
        off = off - turns * period
        noise, to_sensors = np.diag(self._measured), covariance[:, self.places] * known[:, :, None]
        both = to_sensors[:, :, self.places] * known[:, None, :] + noise
        gain = np.linalg.solve(both, to_sensors).swapaxes(1, 2)
        left = np.tile(np.eye(mean.shape[1]), (len(mean), 1, 1))
        left[:, :, self.places] -= gain
        covariance = left @ covariance @ left.swapaxes(1, 2) + gain @ noise @ gain.swapaxes(1, 2)
        return Belief(mean + (gain @ off[:, :, None])[:, :, 0], _symmetric(covariance), failures)

    def _strayed(self, h: float) -> np.ndarray:
        """Covariance (nx, nx) of what noise has done after a step of size h [s], (M67)."""
        nv = len(self._process) // 2
        of_q, of_v = np.diag(self._process[:nv]), np.diag(self._process[nv:])
        across = 0.5 * h**2 * of_v
        return np.block([[h * of_q + h**3 / 3.0 * of_v, across], [across, h * of_v]])

    def estimate(self, measured: Any, controls: Any) -> Belief:
        """A recorded run, looked at afterwards: every estimate from what was measured until then.

        Args:
            measured: (B, N + 1, sensors), at the model's steps; NaN where nothing was.
            controls: (B, N, nu) that acted, or (N, nu).

        Returns:
            Mean (B, N + 1, nx), covariance (B, N + 1, nx, nx) and failures (B,) after N steps.
        """
        seen = array("measured", measured, ("B", "N + 1", len(self.places)), finite=False)
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


def _noise(covariance: np.ndarray, h: float) -> dict[str, np.ndarray]:
    """Parameters with which J (Sigma_q/h^2 + Sigma_v) J' is the variance of J (v + q/h), (M69)."""
    nv = covariance.shape[1] // 2
    both = np.concatenate([np.eye(nv) / h, np.eye(nv)], axis=1)
    of_speed = _symmetric(both @ covariance @ both.T)
    return {"position_covariance": np.zeros_like(of_speed), "velocity_covariance": of_speed}


def _symmetric(a: np.ndarray) -> np.ndarray:
    return 0.5 * (a + a.swapaxes(1, 2))


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
