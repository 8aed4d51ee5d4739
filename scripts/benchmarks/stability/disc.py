"""Cases of one disc on a half-plane: rest, creep, sliding, sticking, impact, and their closed forms."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from slcp_warp.kernels.method import Method

from . import scenes
from .case import Array, Case, G, Grid, Run, Start, ground_angle, states

MASSES = (1e-3, 1.0, 1e3)


def rest_slack(method: Method, a: Array, sigma: Array) -> Array:
    """w > 0 with a - s(a - w) = 0: what a row that carries `a` keeps open (REM; 0 in hard mode)."""
    if method.hard:
        return np.zeros(np.shape(a))
    if method.residual == "rem-logistic":
        return -sigma * np.log(-np.expm1(-np.minimum(a / sigma, 700.0)))
    low, high = -40.0 * sigma + 0.0 * a, 40.0 * sigma + a
    for _ in range(200):  # s(-w) = a - ... : E[min(a, w + noise)] = 0 rises with w
        w = 0.5 * (low + high)
        t = (w - a) / sigma
        phi = np.exp(-0.5 * t * t) / math.sqrt(2 * math.pi)
        mean = np.where(t > 0, a, w) - sigma * (
            phi - np.abs(t) * 0.5 * np.vectorize(math.erfc)(np.abs(t) / 2**0.5)
        )
        low, high = np.where(mean < 0, w, low), np.where(mean < 0, high, w)
    return 0.5 * (low + high)


def rem(method: Method) -> bool:
    """Methods that the closed forms of resting and creeping are for."""
    return (method.rem or method.hard) and method.integrator == "euler"


def row_load(grid: Grid, mass: Array, mu: float = 0.5) -> Array:
    """a = D lambda of each of the two rows that carry a resting disc."""
    lam = 0.5 * mass * G * grid.h
    return (1 + mu * mu) / mass * lam if grid.method.inertia_scaling else lam


def _rest(grid: Grid, steps: int) -> Start:
    mass = grid.variant
    gap = grid.h * rest_slack(grid.method, row_load(grid, mass), grid.sigma) if rem(grid.method) else 0.0
    return Start(states(grid, 3, q1=gap + grid.layer), {"mass": mass[:, None], "inertia": mass[:, None]})


def _rest_error(run: Run) -> Array:
    g, height = run.grid, run.states[:, -1, 1]
    return np.abs(height - g.h * rest_slack(g.method, row_load(g, g.variant), g.sigma))


def _slope_angle(slope: float) -> Callable[[Grid, int], Start]:
    def start(grid: Grid, steps: int) -> Start:
        mass = grid.variant[:, None]
        return Start(
            states(grid, 3), {"mass": mass, "inertia": mass, "shape_angle": ground_angle(grid, 2, slope)}
        )

    return start


def along(run: Run, slope: Any) -> Array:
    """Displacement (B, N + 1) along the slope, uphill positive."""
    slope = np.broadcast_to(slope, (run.grid.size,))[:, None]
    return np.cos(slope) * run.states[..., 0] + np.sin(slope) * run.states[..., 1]


def creep_speed(grid: Grid, slope: float, mu: float = 0.5) -> Array:
    """Downhill speed of a contact, REM-logistic, inertia scaling (docs/understand/stability.md)."""
    if grid.method.hard:
        return np.zeros(grid.size)
    weight = (1 + mu * mu) * G * grid.h / (2 * grid.sigma)
    load = [weight * (math.cos(slope) + s * math.sin(slope) / mu) for s in (1, -1)]
    ends = [np.log(-np.expm1(-np.minimum(x, 700.0))) for x in load]
    return grid.sigma / (2 * mu) * (ends[0] - ends[1])


def _creep_error(run: Run) -> Array:
    nv, slope = run.nv, 0.3
    speed = math.cos(slope) * run.states[:, -1, nv] + math.sin(slope) * run.states[:, -1, nv + 1]
    return np.abs(speed + creep_speed(run.grid, slope))


def _slide(grid: Grid, steps: int) -> Start:
    speed, mu = grid.variant, 0.5
    lift = 0.0 if grid.method.coulomb else mu
    x0 = states(grid, 3, q1=grid.h * lift * speed, v0=speed, v1=-(lift**2) * G * grid.h)
    return Start(x0, {"inertia": np.full((grid.size, 1), 1.0)})


def _stop_error(run: Run) -> Array:
    return np.abs(run.states[:, -1, 0] - run.grid.variant**2 / (2 * 0.5 * G))


def _hop(grid: Grid, steps: int) -> Start:
    return Start(states(grid, 3, v0=grid.variant))


def _threshold(grid: Grid, steps: int) -> Start:
    slope = np.arctan(0.5 * grid.variant)
    return Start(states(grid, 3), {"shape_angle": ground_angle(grid, 2, slope)})


def _threshold_error(run: Run) -> Array:
    """Distance along the slope against Coulomb's: 0 below the threshold, a t^2 / 2 above."""
    slope = np.arctan(0.5 * run.grid.variant)
    pull = np.maximum(G * (np.sin(slope) - 0.5 * np.cos(slope)), 0.0)
    time = run.grid.h * (run.states.shape[1] - 1)
    return np.abs(-along(run, slope)[:, -1] - 0.5 * pull * time**2)


def _threshold_limit(grid: Grid) -> Array:
    slope = np.arctan(0.5 * grid.variant)
    pull = np.maximum(G * (np.sin(slope) - 0.5 * np.cos(slope)), 0.0)
    time = 10.0
    return 1e-4 + 0.5 * pull * time * (grid.h + 0.02 * time)


def _impact(grid: Grid, steps: int) -> Start:
    sigma = np.where(np.isnan(grid.sigma), 0.01, grid.sigma)
    speed = grid.variant * sigma
    return Start(states(grid, 3, q1=2.37 * grid.h * speed, v1=-speed), {"gravity": np.zeros((grid.size, 2))})


def _rebound(run: Run) -> Array:
    """Fastest departure in units of sigma (of .01 in hard mode)."""
    return run.states[:, :, run.nv + 1].max(1) / np.where(np.isnan(run.grid.sigma), 0.01, run.grid.sigma)


def fastest_departure(share: float) -> float:
    """Limit of v'/sigma as REM-logistic rows push a body off from rest at gap 0; v' - v = share a / sigma.

    One frictionless row: share 1, 1.0352. Two friction rows: 2/(1 + mu^2) with inertia scaling, else 2/m.
    """
    speed = gap = 0.0
    for _ in range(60):
        low, high = 0.0, 100.0  # of a: exp(-a) + exp(-(gap + v')) = 1, whose left side falls with a
        for _ in range(80):
            a = 0.5 * (low + high)
            low, high = (a, high) if math.exp(-a) + math.exp(-gap - speed - share * a) > 1.0 else (low, a)
        speed += share * a
        gap += speed
    return speed


def _departure_limit(grid: Grid) -> float:
    return 1.01 * fastest_departure(2.0 / 1.25 if grid.method.inertia_scaling else 2.0)


def _fast(grid: Grid, steps: int) -> Start:
    x0 = states(grid, 3, q1=0.37 * grid.h * grid.variant, v1=-grid.variant)
    return Start(x0, {"gravity": np.zeros((grid.size, 2))})


def _fast_limit(grid: Grid) -> Array:
    noise = 0.0 if grid.method.hard else _departure_limit(grid) * grid.sigma
    return 1e-6 * grid.variant + noise


def _deep(grid: Grid, steps: int) -> Start:
    return Start(states(grid, 3, q1=-grid.variant), {"gravity": np.zeros((grid.size, 2))})


def _deep_rest(run: Run) -> Array:
    """Depth that is left after the first step [m]."""
    return np.maximum(-run.gap[:, 0], 0.0)


def _drift(run: Run) -> Array:
    """How far the disc has moved in the second half of the run, in x, y and angle."""
    half = run.states.shape[1] // 2
    return np.abs(run.states[:, half:, :3] - run.states[:, half, None, :3]).max((1, 2))


DISC_CASES = (
    Case("rest", "height of a resting disc against the closed form", scenes.disc, _rest, _rest_error,
         lambda g: 1e-6 + 1e-3 * g.layer, duration=3.0, label="mass", variants=MASSES, only=rem, quick=True),
    Case("sink", "a disc at rest stays on the ground", scenes.disc, _rest,
         lambda r: np.abs(r.states[:, -1, 1]), 1e-3, duration=3.0, label="mass", variants=MASSES),
    Case("creep", "creeping down a slope of .3 at mu = .5 against the closed form", scenes.disc,
         _slope_angle(0.3), _creep_error, lambda g: 1e-6 + 1e-2 * np.nan_to_num(g.sigma), "m/s", 10.0,
         label="mass", variants=MASSES,
         only=lambda m: m.hard or (m.residual == "rem-logistic" and m.inertia_scaling and rem(m)),
         quick=True),
    Case("stick", "a disc that must stick creeps in 10 s", scenes.disc, _slope_angle(0.3),
         lambda r: np.abs(along(r, 0.3)[:, -1]), 1e-3, duration=10.0, label="mass", variants=MASSES),
    Case("stop", "sliding at 3 m/s stops at v^2/(2 mu g)", scenes.disc, _slide, _stop_error,
         lambda g: g.h * g.variant, duration=2.0, label="speed", variants=(3.0,), quick=True),
    Case("hop", "sliding from gap 0 stays on the ground", scenes.disc, _hop,
         lambda r: r.states[:, :, 1].max(1), 1e-3, duration=1.0, label="speed", variants=(3.0,)),
    Case("threshold", "sticks at tan(slope) = .99 mu, slides at 1.01 mu", scenes.disc, _threshold,
         _threshold_error, _threshold_limit, duration=10.0, label="tan/mu", variants=(0.99, 1.01),
         quick=True),
    Case("impact", "no departure faster than the noise makes it", scenes.disc, _impact, _rebound,
         lambda g: 1e-9 if g.method.hard else _departure_limit(g), "sigma",
         steps=60, single=1e-3, label="v/sigma", variants=(0.5, 5.0, 50.0, 1000.0), quick=True),
    Case("rebound", "an impact in m/s: nothing leaves faster than the noise makes it", scenes.disc, _fast,
         lambda r: r.states[:, :, r.nv + 1].max(1), _fast_limit, "m/s", steps=40, label="speed",
         variants=(10.0, 100.0, 1000.0)),
    Case("deep", "deep penetration is resolved in a step", scenes.disc, _deep, _deep_rest, 1e-9,
         steps=20, single=1e-5, label="depth", variants=(1e-3, 0.1, 10.0)),
    Case("10^6 steps", "a disc at rest does not drift", scenes.disc, _rest, _drift, 1e-6, steps=1_000_000,
         sigmas=(0.01,), step_sizes=(0.01,), single=1e-4, label="mass"),
)  # fmt: skip
