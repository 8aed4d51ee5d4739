"""A policy that sees what a Kalman filter makes of a few noisy sensors, in place of the state."""

from typing import Any

import numpy as np

from ...inputs.checks import attribute, flag, instance, whole
from ...inputs.errors import ArgumentError, ArgumentTypeError
from ...inputs.limits import any_limits, limit_rows
from ...simulator import Simulator
from ...stepping.acting import Acting, acting
from ...stepping.arguments import at_step_size
from ..around import LONGEST, controls_before
from .foresight import foreseeing
from .kalman import Belief, KalmanFilter
from .sensing import first_state, sensors_of

OF_RUN = ("belief", "kept", "_inner", "_numbers", "_sent", "_last")


class Estimated:
    """A policy behind an extended Kalman filter: it is given the mean of what the filter believes.

    It acts on the host (`policies.HostPolicy`), once a step of the filter's model. Of the states that a run
    shows, a task's noise on them included, it reads the filter's sensors only; in between the model goes on
    with the controls that act.

    Args:
        policy: any, in kernels or on the host; it sees the mean as it sees states elsewhere.
        filter: what it believes.
        lag: steps of the model from a control to its action, as of a task's delay.
        foresee: whether it sees the state that the model foretells for when its control acts, `lag` steps
            ahead, and counts steps from there; False: the state that is. None: True, but for a policy with a
            `lag` of its own (`ddp.MPC`).
        limits: (lower, upper) of the controls that act; None: none beside the policy's own.
        before: controls (nu,), or one number for all, until the first that is sent acts; None: zero.
        keep: True: `kept` has every estimate of the run.

    Attributes:
        belief: of the worlds of the run that it is in, after the last measurement; None before the first.
        kept: of that run, [(time [s], Belief), ...], with `keep`.

    Raises:
        ArgumentError, ArgumentTypeError: what is no filter, what is out of range.
    """

    sees_states = True  # whatever else a task's policies see

    def __init__(
        self,
        policy: Any,
        filter: KalmanFilter,
        lag: int = 0,
        foresee: bool | None = None,
        limits: Any = None,
        before: Any = None,
        keep: bool = False,
    ) -> None:
        self.filter = instance("filter", filter, KalmanFilter, "a policies.KalmanFilter")
        self.lag, self.keep = whole("lag", lag, 0, LONGEST), flag("keep", keep)
        self.foresee = not attribute(policy, "lag") if foresee is None else flag("foresee", foresee)
        if self.foresee:
            policy = foreseeing(policy, self.lag * self.filter.step_size)
        self.policy = at_step_size(policy, self.filter.step_size)
        self.limits = any_limits(limits, "limits")
        self.before = controls_before("before", before, self.filter.model.nu)
        self.period = self.filter.step_size
        self.belief: Belief | None = None
        self.kept: list[tuple[float, Belief]] = []

    def __repr__(self) -> str:
        return f"<Estimated {self.policy!r} behind {self.filter!r}>"

    def __getstate__(self) -> dict[str, Any]:
        """Of no run: copies and pickles begin anew."""
        own = {name: value for name, value in vars(self).items() if name not in OF_RUN}
        return own | {"belief": None, "kept": []}

    @classmethod
    def of_task(
        cls,
        task: Any,
        policy: Any,
        sensors: Any,
        process: Any,
        model: Simulator | None = None,
        **given: Any,
    ) -> "Estimated":
        """A policy of a task's runs, with what its disturbances say of sensors, start and delay.

        Args:
            task: a `slcp_warp.Task`.
            policy: as of the class.
            sensors: names of the measured states, whose noise is that of `Disturbances.sensor`, or a dict of
                standard deviations by name.
            process, model: as of `KalmanFilter`; model None: the task's simulator.
            given: of the class, in place of what the task says.

        Raises:
            ArgumentError: sensors without noise, which no filter can weigh; a delay that is drawn.
        """
        disturbances = attribute(task, "disturbances")
        if disturbances is None or not callable(attribute(task, "simulator")):
            raise ArgumentTypeError(f"task is a {type(task).__name__}; a slcp_warp.Task is needed")
        model = task.simulator() if model is None else instance("model", model, Simulator, "a Simulator")
        mean, deviation = first_state(task)
        found = KalmanFilter(model, sensors_of(task, sensors), process, deviation, mean)
        own: dict[str, Any] = {"limits": task.control_limits}
        if "lag" not in given and disturbances.delay:
            if not isinstance(disturbances.delay, float):
                raise ArgumentError("lag is not given, and Disturbances.delay is drawn; steps are needed")
            own["lag"], own["before"] = round(disturbances.delay / found.step_size), disturbances.before
        return cls(policy, found, **(own | given))

    def begin(self, sim: Any, worlds: np.ndarray) -> None:
        """A run begins; see `policies.HostPolicy`.

        Raises:
            ArgumentError: another mechanism's states than the model's.
        """
        own = self.filter.model.scene
        if tuple(sim.scene.state_names) != tuple(own.state_names):
            raise ArgumentError(
                f"filter.model is of scene {own.name!r}, and scene {sim.scene.name!r} is to be controlled; "
                "the same states are needed"
            )
        self._numbers = np.asarray(worlds)
        self._inner: Acting = acting(self.policy, self.filter.model, self._numbers)
        self._sent = np.tile(self.before, (self.lag, len(self._numbers), 1))  # and does not act yet
        self._last: tuple[float, np.ndarray] | None = None  # when it was asked, what it said
        self.belief, self.kept = self.filter.begin(len(self._numbers)), []

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> np.ndarray:
        """Controls (B, nu) of the states x (B, nx), of which the sensors' are read."""
        if "_inner" not in vars(self) or self.belief is None:
            raise ArgumentError("this policy is in no run yet; begin(sim, worlds) comes before act")
        belief = self.belief if self._last is None else self._meanwhile(time)
        self.belief = belief = self.filter.correct(belief, x[:, self.filter.places])
        if self.keep:
            self.kept.append((time, belief))
        step, seen = round(time / self.period), belief.mean
        if self.foresee and self.lag:
            step, seen = step + self.lag, self._ahead(seen)
        lower, upper = limit_rows(self.limits, self.filter.model.nu)
        u = np.clip(self._inner.controls(seen, step, step * self.period), lower, upper)
        self._last = time, u
        return u

    def _meanwhile(self, time: float) -> Belief:
        """What is believed now, after the controls that have acted since it was asked last."""
        assert self._last is not None and self.belief is not None
        before, held = self._last
        steps = max(1, round((time - before) / self.period))
        belief = self.belief
        for _ in range(steps):
            self._sent = np.concatenate([self._sent, held[None]])
            acted, self._sent = self._sent[0], self._sent[1:]
            belief = self.filter.predict(belief, acted, (time - before) / steps)
        return belief

    def _ahead(self, mean: np.ndarray) -> np.ndarray:
        """States (B, nx) when what is sent now acts; of worlds whose model fails those of now."""
        run = self.filter.model.rollout(mean, self._sent.swapaxes(0, 1), self.filter.params)
        last = run.states[:, -1].astype(float)
        return np.where(np.isfinite(last), last, mean)
