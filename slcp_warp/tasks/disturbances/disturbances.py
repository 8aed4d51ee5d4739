"""What is uncertain in the runs of a task: starts, parameters, controls, sensors, kicks, pushes."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from slcp_warp.kernels.ensembles import disturbances as kernels
from slcp_warp.kernels.ensembles.draws import LAWS
from slcp_warp.kernels.structure import layout

from ...description.scene import Scene
from ...inputs.checks import array, instance, number, shown
from ...inputs.errors import ArgumentError
from . import follow as follows
from . import laws
from .distributions import Distribution, LogNormal, Normal, Uniform, UniformFactor, fixed_or_drawn, of
from .events import Dropout, Push, latest_end

Timing = float | Uniform


@dataclass(frozen=True)
class Disturbances:
    """What is drawn for every world, from the seed and the world's number.

    Where a distribution can stand, a number is short for a plain one: of a parameter `LogNormal`, of
    anything else `Normal`, with this standard deviation.

    Attributes:
        position, velocity: standard deviation of normal noise on every coordinate, and on every velocity, of
            the start. Of what rests half begins inside of what it rests on then, and is pushed out at once:
            `start` disturbs single components.
        start: the same for single components by their names, instead of these; a `Uniform` one stands in
            place of the start's number.
        follow: state name -> parameter of one number, or factors by the names of several: the start is moved
            by as much as a world's number is more than the scene's, times its factor, beside what `start`
            draws. {"box.y": "box.radius_1"} is a box of any height that stands on the ground. Worlds that
            are given (`Worlds.x0`) are moved, too.
        parameters: name -> distribution (a draw for each body, shape, contact or degree of freedom, or one
            for all of them, `shared`; mass and inertia of a body share theirs where both are named; "mass"
            alone changes no inertia); "block.mass" is of one part.
        torque: standard deviation of white noise on the controls, a number a step, added to what the policy
            sends within its limits.
        sensor: of white noise on the state that a policy sees, by state name, or one for all.
        delay: from a control to its action [s], to the nearest step; a number, or a `Uniform` of which every
            world has its own.
        hold: for how long a control is held [s], to the nearest step; 0: for one. As `delay`.
        before: controls until the first that a policy sends acts, one for each or one number for all; None:
            zero. Within a task's limits, as all controls.
        dropped: share of the steps, at random, in which all controls are zero.
        dropouts: times without controls.
        kick_times: when velocities are kicked [s].
        kick: standard deviation of a kick on every velocity [m/s, rad/s]; `kick_times` say when.
        kicks: the same for single velocities by their names, instead of it.
        pushes: forces on bodies for a while.
    """

    position: float = 0.0
    velocity: float = 0.0
    start: Mapping[str, Any] = field(default_factory=dict)
    follow: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    torque: float = 0.0
    sensor: Any = 0.0
    delay: Timing = 0.0
    hold: Timing = 0.0
    before: float | tuple[float, ...] | None = None
    dropped: float = 0.0
    dropouts: tuple[Dropout, ...] = ()
    kick_times: tuple[float, ...] = ()
    kick: float = 0.0
    kicks: Mapping[str, Any] = field(default_factory=dict)
    pushes: tuple[Push, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        for name in ("position", "velocity", "torque", "kick"):
            put(self, name, number(f"Disturbances.{name}", getattr(self, name), 0.0))
        for name in ("delay", "hold"):
            drawn = fixed_or_drawn(f"Disturbances.{name}", getattr(self, name), 0.0)
            if not isinstance(drawn, float | Uniform):
                raise ArgumentError(f"Disturbances.{name} is {shown(drawn)}; a number or a Uniform is needed")
            put(self, name, drawn)
        self._put_before()
        put(self, "dropped", number("Disturbances.dropped", self.dropped, 0.0, 1.0))
        for name, plain in (("start", Normal), ("parameters", LogNormal), ("kicks", Normal)):
            put(self, name, self._drawn(name, plain))
        put(self, "follow", follows.checked(self.follow))
        for key, drawn in self.parameters.items():
            laws.check_parameters(key, drawn)
        if isinstance(self.sensor, Mapping):
            put(self, "sensor", {key: number(f"Disturbances.sensor[{key!r}]", sd, 0.0)
                                 for key, sd in self._named("sensor").items()})  # fmt: skip
        else:
            put(self, "sensor", number("Disturbances.sensor", self.sensor, 0.0))
        for name, kind in (("pushes", Push), ("dropouts", Dropout)):
            given = getattr(self, name)
            if not isinstance(given, list | tuple) or not all(isinstance(each, kind) for each in given):
                raise ArgumentError(
                    f"Disturbances.{name} is {shown(given)}; slcp_warp.{kind.__name__}, in a tuple, is needed"
                )
            put(self, name, tuple(given))
        if not isinstance(self.kick_times, list | tuple):
            raise ArgumentError(f"Disturbances.kick_times is {shown(self.kick_times)}; a tuple is needed")
        times = tuple(number("Disturbances.kick_times", time, 0.0) for time in self.kick_times)
        put(self, "kick_times", tuple(sorted(times)))
        if not times and (self.kick or self.kicks):
            name = "kick" if self.kick else "kicks"
            raise ArgumentError(f"Disturbances.{name} is {shown(getattr(self, name))}, but there are no "
                                "kick_times; when velocities are kicked is needed")  # fmt: skip

    def _put_before(self) -> None:
        """Controls as numbers, which compare."""
        if self.before is None:
            return
        given = array("Disturbances.before", self.before)
        if given.ndim > 1:
            raise ArgumentError(f"Disturbances.before has shape {given.shape}; a number or (nu,) is needed")
        if not self.delay:
            raise ArgumentError(
                f"Disturbances.before is {shown(self.before)}, but there is no delay that it could act in"
            )
        object.__setattr__(self, "before", tuple(given.tolist()) if given.ndim else float(given))

    def _named(self, name: str) -> Mapping[str, Any]:
        given = instance(f"Disturbances.{name}", getattr(self, name), Mapping, "a dict of numbers by name")
        for key in given:
            if not isinstance(key, str):
                raise ArgumentError(f"Disturbances.{name} has the name {shown(key)}; a text is needed")
        found: Mapping[str, Any] = given
        return found

    def _drawn(self, name: str, plain: Any) -> dict[str, Distribution]:
        for key, value in self._named(name).items():
            if isinstance(value, UniformFactor) and plain is Normal:
                raise ArgumentError(
                    f"Disturbances.{name}[{key!r}] is {shown(value)}; factors are of parameters"
                )
        return {key: of(f"Disturbances.{name}[{key!r}]", value, plain)
                for key, value in self._named(name).items()}  # fmt: skip

    def check(self, scene: Scene, duration: float) -> None:
        """Raise ArgumentError for names that the scene has not got, and for what comes after a run's end."""
        laws.parameter_laws(scene, np.zeros(layout(scene.structure).width), self.parameters)
        self.start_laws(scene, scene.x0), self.kick_laws(scene), follows.columns(scene, self.follow)
        if isinstance(self.sensor, Mapping):
            for name in self.sensor:
                scene.state_index(name)
        bodies = [body.name for body in scene.bodies]
        for n, push in enumerate(self.pushes):
            if push.body not in bodies:
                raise ArgumentError(f"pushes[{n}].body is {shown(push.body)}; there are {', '.join(bodies)}")
        if self.before is not None and np.shape(self.before) not in ((), (scene.nu,)):
            found = f"Disturbances.before has {np.size(self.before)} controls"
            raise ArgumentError(f"{found}; scene {scene.name!r} has {scene.nu}")
        late = [("kick_times", time) for time in self.kick_times if time >= duration]
        delay = self.delay.low if isinstance(self.delay, Uniform) else self.delay
        late += [("delay", delay)] if not isinstance(delay, Distribution) and delay >= duration else []
        for name in ("pushes", "dropouts"):
            for n, event in enumerate(getattr(self, name)):
                start = event.start.low if isinstance(event.start, Uniform) else event.start
                if not isinstance(start, Distribution) and start >= duration:
                    late.append((f"{name}[{n}].start", start))
                if latest_end(event) <= 0.0:
                    raise ArgumentError(f"{name}[{n}] ends before a run begins, at {latest_end(event):g} s")
                if event.duration == 0.0:
                    raise ArgumentError(f"{name}[{n}].duration is 0; a positive one is needed to act at all")
        if late:
            raise ArgumentError(
                f"{late[0][0]} holds {late[0][1]}; times before the end of a run, "
                f"Task.duration = {duration:g} s, are needed"
            )
        self.check_kicks(scene.step_size, duration)

    def check_kicks(self, step_size: float, duration: float) -> None:
        """Raise ArgumentError for a kick that no step feels: the nearest to it would begin at the end."""
        last = duration - 0.5 * step_size
        if self.kick_times and self.kick_times[-1] > last * (1.0 + 1e-12):
            raise ArgumentError(
                f"Disturbances.kick_times holds {self.kick_times[-1]}; of a run of {duration} s in steps of "
                f"{step_size} s the last begins at {duration - step_size:g}: kicks up to {last:g} are felt"
            )

    def start_laws(self, scene: Scene, starts: Any) -> laws.Laws:
        """How the components of starts (M, nx) are drawn.

        Raises:
            ArgumentError: a name that the scene has not got.
        """
        spread = np.repeat([self.position, self.velocity], scene.nv)
        return laws.start_laws(scene, starts, spread, self.start)

    def deviation(self, scene: Scene) -> np.ndarray:
        """(nx,) how far the start's components lie around it: standard deviations."""
        drawn = self.start_laws(scene, scene.x0)
        even = drawn.law == LAWS.index(Uniform.law)
        return np.where(even, (drawn.second - drawn.first) / np.sqrt(12.0), drawn.first)

    def first_states(self, scene: Scene, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (M, nx) and standard deviation (nx,) of what is drawn around starts (M, nx)."""
        drawn = self.start_laws(scene, starts)
        even = drawn.law == LAWS.index(Uniform.law)
        middle = 0.5 * (drawn.first + drawn.second)
        return np.where(even, middle, np.broadcast_to(drawn.base, starts.shape)), self.deviation(scene)

    def kick_laws(self, scene: Scene) -> laws.Laws:
        """How kicks (K nv) are drawn.

        Raises:
            ArgumentError: a name that is no velocity's.
        """
        return laws.kick_laws(scene, self.kick_times, self.kick, self.kicks)

    def push_laws(self) -> laws.Laws:
        """How pushes are drawn."""
        events = [push.numbers() for push in self.pushes]
        return laws.event_laws("push", kernels.PUSH_FIELDS, kernels.PUSH, events)

    def dropout_laws(self) -> laws.Laws:
        """How dropouts are drawn."""
        events = [dropout.numbers() for dropout in self.dropouts]
        return laws.event_laws("dropout", kernels.DROPOUT_FIELDS, kernels.DROPOUT, events)

    @property
    def timed(self) -> bool:
        """Whether worlds have delays or holds of their own."""
        return isinstance(self.delay, Distribution) or isinstance(self.hold, Distribution)

    def fixed(self) -> "Disturbances":
        """What acts in undisturbed worlds, too: a delay and a hold that are numbers."""
        spans = {name: getattr(self, name) for name in kernels.TIMING_FIELDS}
        own = {name: v for name, v in spans.items() if not isinstance(v, Distribution)}
        return Disturbances(**own, before=self.before if own.get("delay") else None)

    def left_out(self) -> tuple[str, ...]:
        """Names of what does not act in undisturbed worlds."""
        fixed = self.fixed()
        return tuple(
            each.name
            for each in fields(self)
            if each.name != "follow" and getattr(self, each.name) != getattr(fixed, each.name)
        )

    def timing_laws(self) -> laws.Laws:
        """How delay and hold are drawn; no columns where all worlds have the same."""
        events = [(self.delay, self.hold)] if self.timed else []
        drawn = laws.event_laws("", kernels.TIMING_FIELDS, kernels.TIMING, events)
        return drawn._replace(names=kernels.TIMING_FIELDS[: len(drawn.names)])

    def numbers(self, nv: int) -> int:
        """How many numbers say what happens to a world of so many degrees of freedom while it runs."""
        pushed, dropped = len(kernels.PUSH_FIELDS), len(kernels.DROPOUT_FIELDS)
        timed = len(kernels.TIMING_FIELDS) * self.timed
        return nv * len(self.kick_times) + pushed * len(self.pushes) + dropped * len(self.dropouts) + timed

    def any(self) -> bool:
        """Whether anything is disturbed; what follows nothing is not."""
        names = [each.name for each in fields(self) if each.name != "follow"]
        return any(getattr(self, name) != getattr(NONE, name) for name in names)


NONE = Disturbances()
