"""Hard contact integrated from event to event: smooth motion by Runge-Kutta of order 8, impacts by modes.

For revolute bodies with one pair of ellipses, Coulomb friction and joint limits (`flow.py`). An event is
a gap that closes, a force that vanishes, a slip that halts or a stick that leaves its cone; there the state
is projected on gap 0 and relative velocity 0 of the rows that push. An impact is inelastic and takes all
touching rows at once. This is the limit h -> 0 of implicit time stepping if splitting an impact in two does
not change it: a step in which a gap closes stops a part of the approach, the next one the rest, and where
friction reverses the slip the outcome depends on the parts, whatever h. `Motion.doubt` measures it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..shared.optional import scipy_module
from .flow import TOUCHING, Flow, Modes
from .mechanics import Array, Mechanism
from .modes import BACKWARD, FORWARD, OFF, STICK, ModeError

SAMPLES = 6  # points of a step at which events are looked for
MAX_EVENTS = 500
SHARES = (0.1, 0.5, 0.9)  # of an approach: where an impact is split


class Event(NamedTuple):
    """When, what ("hits", "releases", "halts", "slips", "impact") and to which modes; energy lost [J]."""

    time: float
    what: str
    row: int
    modes: Modes
    lost: float = 0.0


class Piece(NamedTuple):
    """A stretch of smooth motion: its modes and states y = (q, v, energy lost) as a function of time."""

    start: float
    end: float
    modes: Modes
    at: Callable[[float], Array]


@dataclass
class Motion:
    """An exact motion.

    Attributes:
        end: state at the end (nx,).
        lost: energy lost [J].
        events, pieces: what happened.
        drift: largest correction by a projection.
        doubt: largest change of a velocity after an impact if that is split in two, or if its modes are not
            unique; 0: no doubt.
        graze: smallest speed of approach at an impact [m/s, rad/s].
        near: smallest gap or force at which an event was missed (a local minimum in time) [m, rad, N, N m].
    """

    end: Array
    lost: float = 0.0
    events: list[Event] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)
    drift: float = 0.0
    doubt: float = 0.0
    graze: float = np.inf
    near: float = np.inf


def integrate(
    mechanism: Mechanism, x0: Array, duration: float, tolerance: float = 1e-12, max_step: float = 0.02
) -> Motion:
    """The exact motion from a state (nx,) whose gaps are open or closed, for `duration` [s].

    Args:
        mechanism: what moves.
        tolerance: relative, of the Runge-Kutta steps.
        max_step: [s], bounds how far apart events are looked for.

    Raises:
        ModeError: no motion satisfies the contact law (Painleve's paradox).
    """
    flow, options = Flow(mechanism), {"rtol": tolerance, "atol": tolerance, "max_step": max_step}
    y = np.append(np.asarray(x0, float), 0.0)
    motion = Motion(np.array(x0))
    y, modes = _land(flow, motion, 0.0, y)
    now = 0.0
    while now < duration:
        if len(motion.events) >= MAX_EVENTS:
            raise ModeError(f"{MAX_EVENTS} events before t = {now:.6f}: {motion.events[-3:]}")
        now, y, end = _run(flow, motion, now, y, modes, duration, options)
        if end is None:
            break
        y, modes = _after(flow, motion, now, y, modes, *end)
    motion.end, motion.lost = y[:-1], float(y[-1])
    return motion


class _Step(NamedTuple):
    """A Runge-Kutta step in one set of modes: its span, interpolant and options."""

    start: float
    end: float
    modes: Modes
    at: Callable[[float], Array]
    options: dict[str, float]


def _run(
    flow: Flow,
    motion: Motion,
    start: float,
    y: Array,
    modes: Modes,
    duration: float,
    options: dict[str, float],
) -> tuple[float, Array, tuple[int, int] | None]:
    """Smooth motion until a guard falls through zero: time, state, and which guard (None: the end)."""
    rk: Any = scipy_module("integrate").DOP853
    solver = rk(lambda t, z: flow.derivative(z, modes), start, y, duration, **options)
    last = flow.guards(y, modes)
    armed, falling = last > TOUCHING, np.zeros(last.shape, bool)
    while solver.status == "running":
        message = solver.step()
        if solver.status == "failed":
            raise ModeError(f"the integrator failed at t = {solver.t}: {message}")
        step = _Step(solver.t_old, solver.t, modes, solver.dense_output(), options)
        times = np.linspace(step.start, step.end, SAMPLES + 1)
        for low, high in zip(times[:-1], times[1:]):
            guards = flow.guards(step.at(high), modes)
            if (~armed & (guards < -1e3 * TOUCHING)).any():
                raise ModeError(f"modes {modes} at t = {start:.9f} are wrong: guards {guards.tolist()}")
            fallen = [(int(i), int(j)) for i, j in np.argwhere(armed & (guards < 0.0))]
            if fallen:
                time, place = min((_root(flow, step, k, low, high), k) for k in fallen)
                time, y = _exactly(flow, step, place, time)
                motion.pieces.append(Piece(step.start, time, modes, step.at))
                return time, y, place
            dips = armed & falling & (guards > last)
            motion.near = min(motion.near, float(last[dips].min(initial=np.inf)))
            armed, falling, last = armed | (guards > TOUCHING), guards < last, guards
        motion.pieces.append(Piece(step.start, step.end, modes, step.at))
    return duration, solver.y, None


def _root(flow: Flow, step: _Step, place: tuple[int, int], low: float, high: float) -> float:
    """When the guard vanishes on the interpolated step."""
    brentq = scipy_module("optimize").brentq
    return float(
        brentq(lambda t: flow.guards(step.at(t), step.modes)[place], low, high, xtol=1e-14, rtol=1e-14)
    )


def _exactly(flow: Flow, step: _Step, place: tuple[int, int], time: float) -> tuple[float, Array]:
    """Time and state of an event by integrating up to it: interpolation is less exact than a step."""
    solve_ivp, span = scipy_module("integrate").solve_ivp, 1e-4 * (step.end - step.start)

    def guard(z: Array) -> float:
        return float(flow.guards(z, step.modes)[place])

    def state(t: float) -> Array:
        y = step.at(step.start)
        if t <= step.start:
            return y
        run = solve_ivp(lambda _, z: flow.derivative(z, step.modes), (step.start, t), y, method="DOP853",
                        **step.options)  # fmt: skip
        return run.y[:, -1]

    fall = (guard(step.at(time + span)) - guard(step.at(time - span))) / (2.0 * span)
    if fall < 0.0:
        time -= guard(state(time)) / fall
    return time, state(time)


def _after(
    flow: Flow, motion: Motion, now: float, y: Array, modes: Modes, row: int, guard: int
) -> tuple[Array, Modes]:
    """State and modes after an event."""
    mode, changed = modes[row], list(modes)
    if guard == 0 and mode == OFF:
        return _land(flow, motion, now, y)
    if guard == 0:
        changed[row], what = OFF, "releases"
    elif mode == STICK:
        tangential = flow.solve(y, modes)[1][row, 1]
        changed[row], what = FORWARD if tangential < 0.0 else BACKWARD, "slips"
    else:
        changed[row] = STICK
        y, drift = flow.project(y, tuple(changed))
        motion.drift = max(motion.drift, drift)
        changed, what = list(flow.settle(y)), "halts"
    y, drift = flow.project(y, tuple(changed))
    motion.drift = max(motion.drift, drift)
    motion.events.append(Event(now, what, row, tuple(changed)))
    return y, tuple(changed)


def _land(flow: Flow, motion: Motion, now: float, y: Array) -> tuple[Array, Modes]:
    """State and modes after an impact of all rows that touch, at the start or when a gap closes."""
    nv = flow.nv
    before = flow.m.energy(y[:nv], y[nv : 2 * nv])
    after = y.copy()
    answers, approach = flow.impact(y)
    after[nv : 2 * nv] = answers[0]
    if approach > TOUCHING:
        motion.graze = min(motion.graze, approach)
        for share in SHARES:
            part = y.copy()
            part[nv : 2 * nv] = flow.impact(y, share)[0][0]
            answers += flow.impact(part)[0]
        motion.doubt = max(motion.doubt, *(float(np.abs(v - answers[0]).max()) for v in answers))
    modes = flow.settle(after)
    after, drift = flow.project(after, modes)
    motion.drift = max(motion.drift, drift)
    lost = before - flow.m.energy(after[:nv], after[nv : 2 * nv])
    motion.events.append(Event(now, "impact" if approach > TOUCHING else "starts", -1, modes, lost))
    after[-1] += lost
    return after, modes
