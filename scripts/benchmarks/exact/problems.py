"""Problems of the work-precision diagrams, with exact solutions of hard contact.

Impacts are inelastic and friction is Coulomb's. Closed forms are in this file; smooth motions come from
Runge-Kutta at 1e-13 (scipy), the finger's impacts from `events.py`. Nothing here follows the kernels.
"""

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import Body, Scene, Shape, box, touching

from ..shared.optional import scipy_module
from .events import integrate
from .mechanics import Mechanism
from .plate import PLATE, SPRING, bounce, sprung_plate

G = 9.81
STARTS = 32
STEP_SIZES = (0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
Array = np.ndarray


@dataclass(frozen=True)
class Problem:
    """A motion whose end is known.

    Attributes:
        name: of the chart.
        scene: the model with all its numbers.
        starts: (B, nx) initial states [SI units].
        duration: T [s], a multiple of every one of STEP_SIZES.
        exact: (B, nx) states at T of hard contact with exact Coulomb friction.
        components: of the state; an error is the largest difference over them, in `unit`.
        contacts: whether anything can touch.
        average: of the starts' errors, "mean", or "median" where neighbouring motions part for good.
        note: on the exact states.
    """

    name: str
    scene: Scene
    starts: Array
    duration: float
    exact: Array
    components: tuple[int, ...]
    unit: str
    contacts: bool = True
    average: str = "mean"
    note: str = ""

    def errors(self, states: Array) -> Array:
        """Error (B,) of states at T (B, nx)."""
        chosen = list(self.components)
        return np.abs(np.asarray(states)[:, chosen] - self.exact[:, chosen]).max(axis=1)

    def typical(self, errors: Array) -> dict[str, Any]:
        """The columns of an error (B,) over the starts; infinite where a state was not finite."""
        middle = np.median(errors) if self.average == "median" else errors.mean()
        return {
            "error": float(middle), "error_p90": float(np.percentile(errors, 90)),
            "error_of": f"{self.average} over {len(errors)} starts at T = {self.duration:g} s [{self.unit}]",
        }  # fmt: skip


# -------------------------------------------------------------------- a block and a disc on a plane


def block(slope: float = 0.0, friction: float = 0.5) -> Scene:
    """A block (.4 m x .2 m, 1 kg) on two corner discs, radius .02 m, on a slope [rad]; at rest, gap 0."""
    ground = Shape("ground", None, "halfplane", angle=math.pi / 2 + slope)
    corners = box("corner", "block", 0.4, 0.2, corner_radius=0.02)[:2]
    return Scene(
        name="block",
        bodies=(Body("block", 1.0, (0.4**2 + 0.2**2) / 12.0, joint="free"),),
        shapes=(*corners, ground),
        contacts=touching(corners, (ground,), friction),
        gravity=(0.0, -G),
        initial_state=(-0.1 * math.sin(slope), 0.1 * math.cos(slope), slope, 0.0, 0.0, 0.0),
    )


def along_slope(start: Array, slope: float, distance: Array, speed: Array) -> Array:
    """States (B, 6) of a body that has moved uphill from `start` (6,) without turning."""
    c, s, zero = math.cos(slope), math.sin(slope), np.zeros(len(distance))
    return start + np.stack([c * distance, s * distance, zero, c * speed, s * speed, zero], axis=1)


def slid(speed: Array, slope: float, friction: float, duration: float) -> tuple[Array, Array]:
    """Distance and speed uphill (B,) after `duration` of a block that starts uphill at `speed` (B,).

    It brakes at g (friction cos + sin) uphill, g (friction cos - sin) downhill, and stays where it stops if
    friction >= tan(slope), else slides down.
    """
    pull, rub = G * math.sin(slope), G * friction * math.cos(slope)
    brake = np.where(speed > 0.0, -pull - rub, -pull + rub)
    halt = np.where(speed * brake < 0.0, -speed / brake, np.inf)
    first = np.minimum(halt, duration)
    after = duration - first
    down = min(rub - pull, 0.0)
    distance = speed * first + 0.5 * brake * first**2 + 0.5 * down * after**2
    return distance, np.where(after > 0.0, down * after, speed + brake * first)


def sliding(name: str, slope: float, friction: float, speeds: Array, duration: float) -> Problem:
    """A block that slides at `speeds` (B,) uphill along a slope."""
    scene = block(slope, friction)
    starts = along_slope(scene.x0, slope, np.zeros(len(speeds)), speeds)
    exact = along_slope(scene.x0, slope, *slid(speeds, slope, friction, duration))
    return Problem(name, scene, starts, duration, exact, (0, 1), "m")


def fallen(height: Array) -> tuple[Array, Array]:
    """Time and speed (B,) at the end of a fall from rest."""
    return np.sqrt(2.0 * height / G), np.sqrt(2.0 * G * height)


def block_lands() -> Problem:
    """A flat block that flies forward, lands and slides: the landing takes friction v_n of its speed."""
    friction, duration = 0.5, 1.0
    scene = block(0.0, friction)
    height = np.linspace(0.05, 0.15, STARTS)
    speed = np.linspace(3.0, 2.0, STARTS)[np.random.default_rng(2).permutation(STARTS)]
    time, impact = fallen(height)
    after, rest = speed - friction * impact, np.zeros(STARTS)
    slide = np.array([slid(v, 0.0, friction, duration - t) for v, t in zip(after[:, None], time)])[:, :, 0]
    starts = along_slope(scene.x0, 0.0, rest, speed)
    starts[:, 1] += height
    exact = along_slope(scene.x0, 0.0, speed * time + slide[:, 0], slide[:, 1])
    return Problem("block lands and stops", scene, starts, duration, exact, (0, 1), "m")


def ball_rests() -> Problem:
    """A ball that falls .2 to .6 m and stays."""
    scene = replace(slcp.scenes.ball_drop(), gravity=(0.0, -G))
    starts = np.tile(scene.x0, (STARTS, 1))
    starts[:, 1] = 0.1 + np.linspace(0.2, 0.6, STARTS)
    exact = np.tile([0.0, 0.1, 0.0, 0.0, 0.0, 0.0], (STARTS, 1))
    return Problem("ball lands and rests", scene, starts, 1.0, exact, (1,), "m")


def rolling() -> Problem:
    """A disc that is set down sliding, without spin: it rolls from t = v0 / (3 mu g) on, at 2/3 of v0."""
    friction, radius, duration = 0.3, 0.1, 1.0
    scene = replace(slcp.scenes.rolling_disc(friction=friction, radius=radius), gravity=(0.0, -G),
                    initial_state=(0.0, radius, 0.0, 1.0, 0.0, 0.0))  # fmt: skip
    speed = np.linspace(1.0, 3.0, STARTS)
    starts = np.tile(scene.x0, (STARTS, 1))
    starts[:, 3] = speed
    slip = speed / (3.0 * friction * G)
    x = speed * slip - 0.5 * friction * G * slip**2 + 2.0 / 3.0 * speed * (duration - slip)
    turn = -friction * G / radius * slip**2 - 2.0 / 3.0 * speed / radius * (duration - slip)
    exact = np.stack([x, 0 * x + radius, turn, 2 / 3 * speed, 0 * x, -2 / 3 * speed / radius], axis=1)
    return Problem("rolling disc", scene, starts, duration, exact, (0, 1), "m")


def bouncing() -> Problem:
    """A ball falls on a sprung plate that swings a little, from .3 to .4 m."""
    scene, duration = sprung_plate(), 1.5
    phase = 2.0 * math.pi * np.arange(STARTS) / STARTS
    starts = np.tile(scene.x0, (STARTS, 1))
    starts[:, 0] += 0.01 * np.cos(phase)
    starts[:, 2] = 0.01 * math.sqrt(SPRING / PLATE) * np.sin(phase)
    starts[:, 1] = np.linspace(0.3, 0.4, STARTS)[np.random.default_rng(1).permutation(STARTS)]
    exact = np.array([bounce(start, duration)[0] for start in starts])
    return Problem("ball bounces on a sprung plate", scene, starts, duration, exact, (0, 1), "m")


# -------------------------------------------------------------------- smooth motions


def swung(name: str, scene: Scene, starts: Array, duration: float, components: tuple[int, ...]) -> Problem:
    """A motion without contact, by Runge-Kutta of order 8 at 1e-13."""
    solve_ivp, mechanism = scipy_module("integrate").solve_ivp, Mechanism(scene)
    exact = [
        solve_ivp(mechanism.derivative, (0.0, duration), x, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        for x in starts
    ]
    return Problem(name, scene, starts, duration, np.array(exact), components, "rad, rad/s", contacts=False)


def chain() -> Problem:
    """Three rods that hang from a pivot and swing from about half a radian."""
    starts = np.zeros((4, 6))
    starts[:, 0] = -math.pi / 2 + np.linspace(0.4, 0.6, 4)
    return swung("pendulum chain", slcp.scenes.pendulum_chain(), starts, 1.0, tuple(range(6)))


def finger_swing() -> Problem:
    """The finger alone without damping or limits, and the ellipse spinning."""
    scene = slcp.scenes.flicking_finger()
    free = tuple(replace(body, damping=0.0, lower=None, upper=None) for body in scene.bodies)
    scene = replace(scene, name="finger_swing", bodies=free, contacts=())
    start = np.array([[-0.6, -0.8, 0.3, 0.0, 0.0, 1.0]])
    return swung("finger swing", scene, start, 2.0, tuple(range(6)))


def finger_impact() -> Problem:
    """The finger strikes the ellipse, slides on it, sticks and slides again; from event to event."""
    scene = slcp.scenes.flicking_finger()
    middle = np.array([-2.2, -0.6, 0.4, 1.0, -1.0, 0.0])
    starts = middle + 0.01 * np.random.default_rng(0).uniform(-1.0, 1.0, (STARTS, 6))
    mechanism = Mechanism(scene)
    exact = np.array([integrate(mechanism, start, 2.0).end for start in starts])
    return Problem("finger impact", scene, starts, 2.0, exact, tuple(range(6)), "rad, rad/s")


# -------------------------------------------------------------------- all


def sliding_stop() -> Problem:
    """A block that friction stops."""
    return sliding("sliding stop", 0.0, 0.5, np.linspace(1.0, 3.0, STARTS), 1.0)


def slope_sticks() -> Problem:
    """A block on a slope below the friction angle, set off downhill or uphill: it stops and stays."""
    speeds = np.concatenate([-np.linspace(0.4, 1.4, STARTS // 2), np.linspace(0.4, 2.0, STARTS // 2)])
    return sliding("slope sticks", 0.3, 0.4, speeds, 2.0)


def slope_slips() -> Problem:
    """A block on a slope above the friction angle, set off uphill: it turns and slides down."""
    return sliding("slope slips", 0.3, 0.2, np.linspace(0.5, 2.0, STARTS), 1.0)


MAKERS = {
    "sliding stop": sliding_stop,
    "ball lands and rests": ball_rests,
    "block lands and stops": block_lands,
    "ball bounces on a sprung plate": bouncing,
    "slope sticks": slope_sticks,
    "slope slips": slope_slips,
    "rolling disc": rolling,
    "pendulum chain": chain,
    "finger swing": finger_swing,
    "finger impact": finger_impact,
}


@functools.cache
def problem(name: str) -> Problem:
    """One of MAKERS, with its exact solution (finger impact: ten seconds)."""
    return MAKERS[name]()


def problems() -> tuple[Problem, ...]:
    """All problems."""
    return tuple(problem(name) for name in MAKERS)
