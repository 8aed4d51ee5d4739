"""A ball that lands on a sprung plate, swings with it and leaves it: exact, piece by piece.

In flight the ball is ballistic and the plate harmonic; together they are one harmonic mass. The times of the
events are roots of these closed forms, by scipy's Brent.
"""

import math
from collections.abc import Callable

import numpy as np

from slcp_warp import Body, Contact, Scene, Shape

from ..shared.optional import scipy_module

G = 9.81
PLATE, BALL, SPRING = 0.5, 2.0, 200.0  # [kg, kg, N/m]
SCAN = 1e-3  # grid on which an event is looked for before it is refined [s]

Array = np.ndarray
Motion = Callable[[float], tuple[float, float]]  # time -> height, speed


def sprung_plate() -> Scene:
    """A ball above a plate (the top of a disc) on a spring; both can only move up and down.

    State: heights of the plate's top and of the ball's lowest point [m], then rates; the spring is relaxed
    at height 0. No damping, no friction.
    """
    up, radius = (0.0, 1.0), 0.1
    return Scene(
        name="sprung_plate",
        bodies=(
            Body("plate", PLATE, 1e-3, joint="prismatic", axis=up, stiffness=SPRING),
            Body("ball", BALL, 1e-2, joint="prismatic", axis=up),
        ),
        shapes=(
            Shape("plate", "plate", "disc", radius, offset=(0.0, -radius)),
            Shape("ball", "ball", "disc", radius, offset=(0.0, radius)),
        ),
        contacts=(Contact("plate", "ball"),),
        gravity=(0.0, -G),
        initial_state=(-PLATE * G / SPRING, 0.3, 0.0, 0.0),
    )


def harmonic(mass: float, height: float, speed: float) -> Motion:
    """Motion of a mass on the spring."""
    rate, middle = math.sqrt(SPRING / mass), -mass * G / SPRING

    def motion(t: float) -> tuple[float, float]:
        c, s = math.cos(rate * t), math.sin(rate * t)
        off = height - middle
        return middle + off * c + speed / rate * s, speed * c - rate * off * s

    return motion


def ballistic(height: float, speed: float) -> Motion:
    """Motion of a free mass."""
    return lambda t: (height + speed * t - 0.5 * G * t * t, speed - G * t)


def first_fall(function: Callable[[float], float], end: float) -> float:
    """The first time in (0, end] at which the function falls through zero; inf if it does not."""
    times = np.append(np.arange(SCAN, end, SCAN), end)
    values = np.array([function(t) for t in times])
    cross = np.nonzero((values[:-1] > 0.0) & (values[1:] <= 0.0))[0]
    if not len(cross):
        return math.inf
    low, high = times[cross[0]], times[cross[0] + 1]
    return float(scipy_module("optimize").brentq(function, low, high, xtol=1e-15, rtol=1e-14))


def bounce(start: Array, duration: float) -> tuple[Array, list[tuple[str, float]]]:
    """State (4,) after `duration` from a start (4,) in flight, and the events (what, when [s]).

    An inelastic landing keeps the momentum. Plate and ball then swing as one mass, and part where their force
    vanishes: going up through the height where the spring is relaxed, or at once if they meet above it.
    """
    events: list[tuple[str, float]] = []
    now, state = 0.0, start.astype(float)
    while True:
        after, state = _flight(state, duration - now)
        now += after
        if now >= duration:
            return state, events
        speed = (PLATE * state[2] + BALL * state[3]) / (PLATE + BALL)
        state = np.array([state[0], state[0], speed, speed])
        events.append(("lands", now))
        if state[0] < 0.0:
            after, state = _together(state, duration - now)
            now += after
            if now >= duration:
                return state, events
            events.append(("leaves", now))


def _flight(state: Array, left: float) -> tuple[float, Array]:
    """Time until the ball lands, `left` at most, and the state then, before the impact."""
    plate = harmonic(PLATE, state[0], state[2])
    ball = ballistic(state[1], state[3])
    time = min(first_fall(lambda t: ball(t)[0] - plate(t)[0], left), left)
    return time, np.array([*zip(plate(time), ball(time))]).ravel()


def _together(state: Array, left: float) -> tuple[float, Array]:
    """Time until plate and ball part, `left` at most, and the state then."""
    both = harmonic(PLATE + BALL, state[0], state[2])
    time = min(first_fall(lambda t: -both(t)[0], left), left)
    height, speed = both(time)
    return time, np.array([height, height, speed, speed])
