"""A policy that sees what a Kalman filter makes of a few noisy sensors, in place of the state."""

import copy
import functools
import threading
import warnings
from typing import Any

import numpy as np

from ...description.points import Point
from ...description.scene import Scene
from ...inputs.checks import attribute, flag, instance, number, shown, whole
from ...inputs.errors import ArgumentError, ArgumentTypeError
from ...inputs.limits import any_limits, limit_rows
from ...inputs.times import nearest_steps
from ...measures.signals import Signal
from ...simulator import Simulator
from ...stepping.acting import Acting, acting
from ...stepping.arguments import at_step_size
from ..around import controls_before
from .extended import Belief
from .foresight import foreseeing
from .kalman import KalmanFilter
from .past import Past
from .readings import Readings
from .sensing import first_state, sensors_of
from .sensors import OF_MASS, OF_PLACES, Sensors
from .sent import Sent

OF_RUN = ("belief", "kept", "_inner", "_late", "_sent", "_last", "_thread", "_readings", "_past")


class Estimated:
    """A policy behind an extended Kalman filter: it is given the mean of what the filter believes.

    It acts on the host (`policies.HostPolicy`), once a step of the filter's model. Of the states that a run
    shows, a task's noise on them included, it reads the filter's sensors only; in between the model goes on
    with the controls that act.

    Args:
        policy: any, in kernels or on the host; it sees the mean as it sees states elsewhere.
        filter: what it believes.
        delay: from a control to its action [s], as of a task; to the nearest step of the run.
        foresee: whether it sees the state that the model foretells for when its control acts, and counts
            steps from there; False: the state that is. None: True, but for a policy with a `lag` of its own
            (`ddp.MPC`).
        limits: (lower, upper) of the controls that act, each a number or (nu,); None: none beside the
            policy's own.
        before: controls (nu,), or one number for all, until the first that is sent acts; None: zero.
        period: between two questions [s], as of a task's hold; None: a step of the model.
        keep: True: `kept` has every estimate of the run.
        seed: of what `policies.Sensor` says of noise and lost readings, which are drawn here, by a world's
            number and whatever seed a sweep has.
        simulated: whether states of a simulated run come, of which sensors show what they are of, with their
            biases; False: they are what a machine's sensors showed of its states, biases and all.

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
        delay: float = 0.0,
        foresee: bool | None = None,
        limits: Any = None,
        before: Any = None,
        period: float | None = None,
        keep: bool = False,
        seed: int = 0,
        simulated: bool = True,
    ) -> None:
        self.filter = instance("filter", filter, KalmanFilter, "a policies.KalmanFilter")
        self.delay, self.keep = number("delay", delay, 0.0), flag("keep", keep)
        self.seed, self.simulated = whole("seed", seed, 0), flag("simulated", simulated)
        if not self.simulated and (filter.sensing.places < 0).any():
            raise ArgumentError(
                "simulated is False, and filter has sensors of other things than states, which `act` is not "
                "given; KalmanFilter.predict and .correct are needed"
            )
        self.foresee = not attribute(policy, "lag") if foresee is None else flag("foresee", foresee)
        if self.foresee:
            policy = foreseeing(policy, self.delay)
        self.policy = at_step_size(policy, self.filter.step_size)
        self.worlds = attribute(policy, "worlds") or 1
        self.limits = any_limits(limits, "limits")
        lower, upper = limit_rows(self.limits, self.filter.model.nu, "limits")
        if len(lower) != 1:
            raise ArgumentError(f"limits are for {len(lower)} worlds; one pair for all is needed")
        self._within = lower, upper
        self.before = controls_before("before", before, self.filter.model.nu)
        own = self.filter.step_size
        self.period = own if period is None else number("period", period, 0.0, above=True)
        self.belief: Belief | None = None
        self.kept: list[tuple[float, Belief]] = []
        self._ahead = copy.copy(self.filter)
        self._ahead.forces = None  # what is foretold of later is not read
        self._felt: dict[str, np.ndarray] = {}

    @property
    def senses(self) -> dict[str, Any]:
        """Sensors of forces, whose signals a run tells (`policies.HostPolicy`)."""
        sensing = self.filter.sensing
        return {sensing.names[i]: sensing.every[i].of for i in sensing.of_step}

    def feel(self, shown: dict[str, np.ndarray]) -> None:
        """What sensors of forces show of the step before."""
        self._felt = shown

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
        start: Any = None,
        **given: Any,
    ) -> "Estimated":
        """A policy of a task's runs, with what its disturbances say of sensors, start, delay and hold.

        Args:
            task: a `slcp_warp.Task`.
            policy: as of the class.
            sensors: names of the measured states, whose noise is that of `Disturbances.sensor`, or a dict as
                of `KalmanFilter`.
            process, model: as of `KalmanFilter`; model None: the task's simulator.
            start: as of `KalmanFilter`; None: how far the task's runs begin from their mean.
            given: of the class, in place of what the task says.

        Raises:
            ArgumentError: sensors without noise, which no filter can weigh; a delay or a hold that is drawn,
                or a start that follows what is, where no number is given in its place.
        """
        disturbances = attribute(task, "disturbances")
        if disturbances is None or not callable(attribute(task, "simulator")):
            raise ArgumentTypeError(f"task is a {type(task).__name__}; a slcp_warp.Task is needed")
        model = task.simulator() if model is None else instance("model", model, Simulator, "a Simulator")
        if start is None and disturbances.follow:
            raise ArgumentError(
                f"start is not given, and Disturbances.follow, {shown(dict(disturbances.follow))}, moves it; "
                "standard deviations are needed"
            )
        mean, deviation = first_state(task)
        deviation = deviation if start is None else start
        found = KalmanFilter(model, sensors_of(task, sensors), process, deviation, mean)
        own: dict[str, Any] = {"limits": task.control_limits, "before": disturbances.before}
        for name, of in (("delay", disturbances.delay), ("period", disturbances.hold)):
            if name not in given and not isinstance(of, float):
                what = f"Disturbances.{'hold' if name == 'period' else name} is {shown(of)}"
                raise ArgumentError(f"{name} is not given, and {what}, drawn; seconds are needed")
            own[name] = of if name == "delay" else of or None
        return cls(policy, found, **(own | given))

    def begin(self, sim: Any, worlds: np.ndarray, step_size: float | None = None) -> None:
        """A run begins; see `policies.HostPolicy`.

        Args:
            sim, worlds: as there.
            step_size: of the run [s]; None: the simulator's.

        Raises:
            ArgumentError: another mechanism than the model's.
        """
        own = self.filter.model.scene
        names = [(scene.state_names, scene.control_names, scene.structure) for scene in (sim.scene, own)]
        if names[0] != names[1]:
            raise ArgumentError(
                f"filter.model is of scene {own.name!r}, and scene {sim.scene.name!r} is to be controlled; "
                "the same mechanism is needed"
            )
        numbers = np.asarray(worlds)
        h = sim.scene.step_size if step_size is None else step_size
        self._late = h * nearest_steps("delay", self.delay, h) if self.delay else 0.0
        self._inner: Acting = acting(self.policy, self.filter.model, numbers, self.filter.step_size)
        self._felt = {}
        late, same = np.array([each.late for each in self.filter.sensing.every]), 1e-6 * self.filter.step_size
        self._past = Past(late, same) if late.any() else None
        self._sent = Sent(np.tile(self.before, (len(numbers), 1)), self._late, same, float(late.max()))
        self._last: float | None = None  # when it was asked
        self._thread = threading.get_ident()
        self.belief, self.kept = self.filter.begin(len(numbers)), []
        self._check_run(sim.scene, h)
        filter = self.filter
        sensors = Sensors(sim.scene, filter.sensing.with_noise(np.sqrt(filter.sensing.variance)))
        self._readings = Readings(sensors, filter.bias, filter.model, numbers, self.seed)

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> np.ndarray:
        """Controls (B, nu) of the states x (B, nx), of which the sensors' are read."""
        if "_inner" not in vars(self) or self.belief is None:
            raise ArgumentError("this policy is in no run yet; begin(sim, worlds) comes before act")
        if self._thread != threading.get_ident():
            raise ArgumentError("this policy is in a run of another thread; give each a copy of its own")
        belief = self.belief
        if self._last is not None:
            belief = self._until(self.filter, belief, self._last, time)
        seen = self._read(x, time)
        if self._past is None:
            belief = self.filter.correct(belief, seen)
        else:
            until = functools.partial(self._until, self.filter)
            belief = self._past.believed(time, belief, seen, self.filter.correct, until)
        self.belief = belief
        if self.keep:
            self.kept.append((time, belief))
        acts = time
        if self.foresee and self._late:
            acts, belief = time + self._late, self._until(self._ahead, belief, time, time + self._late)
        step = round(acts / self.filter.step_size)
        u = np.clip(self._inner.controls(belief.mean, step, acts), *self._within)
        self._sent.send(time, u)
        self._last = time
        return u

    def _check_run(self, scene: Scene, h: float) -> None:
        """Raise ArgumentError for impulses in steps of another size; warn of points by other numbers."""
        sensing, params = self.filter.sensing, self.filter.params
        parts = [part for each in sensing.every if isinstance(each.of, Signal) for part in each.of.parts()]
        impulses = [part for part in parts if part.kind in ("impulse", "tangential_impulse")]
        if impulses and abs(h / self.filter.step_size - 1.0) > 1e-6:
            raise ArgumentError(
                f"filter has a sensor of {impulses[0]!r}, which grows with steps; the run makes steps of "
                f"{h:g} s and the model of {self.filter.step_size:g} s: a force is needed in its place"
            )
        own = scene.default_parameters()
        points = [point for part in parts for point in (part.which, part.minus) if isinstance(point, Point)]
        numbers = OF_MASS if any(point.of_mass for point in points) else OF_PLACES
        if points and any(not np.array_equal(params[name], own[name]) for name in numbers):
            warnings.warn(
                "filter has sensors of points, which a run shows by the numbers of its scene, and lengths, "
                "angles or masses of another mechanism (model=, params=)",
                RuntimeWarning,
                stacklevel=2,
            )

    def _read(self, x: np.ndarray, time: float) -> np.ndarray:
        """(B, sensors) that are read."""
        if self.simulated:
            return self._readings.of(x, time, self._felt)
        return np.asarray(x[:, self.filter.sensing.places])

    def _until(self, filter: KalmanFilter, belief: Belief, begin: float, end: float) -> Belief:
        """What is believed after the controls that act between two times."""
        for u, seconds in self._sent.acting(begin, end):
            belief = filter.predict(belief, u, seconds)
        return belief
