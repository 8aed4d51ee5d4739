"""The cases of the stability battery as data: scene, numbers of every world, and a criterion in SI units.

A case is run over its own variants (masses, speeds, slopes ...) times noise levels at every step size; all
worlds of one step size are one launch of one kernel. `measure` turns a run into one number per world, which
passes up to `limit`. See docs/stability.md for what each case tests and what a miss means.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slcp_warp.kernels.method import Method
from slcp_warp.options import Status
from slcp_warp.scene import Scene

from . import stability_scenes as scenes

Array = np.ndarray
G = 9.81
SIGMAS = (0.1, 0.01, 1e-3, 1e-4)
STEP_SIZES = (1e-3, 0.01, 0.05, 0.1)
UP = math.pi / 2


@dataclass(frozen=True)
class Grid:
    """Worlds of one launch: step size h [s], noise level (B,) (nan: hard) and the case's variant (B,)."""

    h: float
    sigma: Array
    variant: Array
    method: Method

    @property
    def size(self) -> int:
        """Worlds."""
        return len(self.sigma)

    @property
    def layer(self) -> Array:
        """Thickness h sigma of the smoothing layer (B,), 0 in hard mode [m]."""
        return self.h * np.nan_to_num(self.sigma)


@dataclass(frozen=True)
class Start:
    """Initial states (B, nx), parameters by name and controls (B, N, nu) or None."""

    x0: Array
    numbers: dict[str, Any] = field(default_factory=dict)
    controls: Array | None = None


@dataclass(frozen=True)
class Run:
    """What a launch did: states (B, N + 1, nx), impulses (B, N, nr), and of the n checked steps the smallest
    gaps (B, n) and the energies (B, n + 1).
    """

    grid: Grid
    states: Array
    impulse: Array
    gap: Array
    energy: Array

    @property
    def nv(self) -> int:
        """Degrees of freedom."""
        return self.states.shape[-1] // 2


@dataclass(frozen=True)
class Case:
    """One scene and its criterion.

    Attributes:
        name, what: for tables. scene: maker. start: Grid, steps -> Start. measure: Run -> (B,).
        limit: largest number that passes, per world or for all. unit: of the number. duration: [s], or
        `steps`: the same number at every h. variants: of the case's own number, `label` names it.
        expect: the status that passes. only: methods that the case applies to. memory: kernels in memory.
    """

    name: str
    what: str
    scene: Callable[[], Scene]
    start: Callable[[Grid, int], Start]
    measure: Callable[[Run], Array]
    limit: Callable[[Grid], Any] | float
    unit: str = "m"
    duration: float = 1.0
    steps: int | None = None
    label: str = ""
    variants: tuple[float, ...] = (1.0,)
    sigmas: tuple[float, ...] = SIGMAS
    step_sizes: tuple[float, ...] = STEP_SIZES
    expect: Status = Status.SOLVED
    only: Callable[[Method], bool] = lambda method: True
    memory: bool = False
    quick: bool = False

    def bound(self, grid: Grid) -> Array:
        """The limit of every world (B,)."""
        limit = self.limit(grid) if callable(self.limit) else self.limit
        return np.broadcast_to(np.asarray(limit, float), (grid.size,))

    def count(self, h: float) -> int:
        """Steps of a run."""
        return self.steps or max(1, round(self.duration / h))


def states(grid: Grid, nv: int, **values: Any) -> Array:
    """(B, 2 nv) zeros with components set by place: q0=..., v2=..."""
    x = np.zeros((grid.size, 2 * nv))
    for key, value in values.items():
        x[:, int(key[1:]) + (nv if key[0] == "v" else 0)] = value
    return x


def friction(grid: Grid, pairs: int, mu: Any) -> Array:
    """(B, pairs) with one coefficient per world."""
    return np.repeat(np.broadcast_to(np.asarray(mu, float), (grid.size,))[:, None], pairs, 1)


def ground_angle(grid: Grid, shapes: int, slope: Any) -> Array:
    """Shape angles (B, shapes): zero but the last one's, a half-plane tilted by `slope`."""
    out = np.zeros((grid.size, shapes))
    out[:, -1] = UP + slope
    return out


# ---------------------------------------------------------------------------------------- closed forms


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


def _along(run: Run, slope: Any) -> Array:
    """Displacement (B, N + 1) along the slope, uphill positive."""
    slope = np.broadcast_to(slope, (run.grid.size,))[:, None]
    return np.cos(slope) * run.states[..., 0] + np.sin(slope) * run.states[..., 1]


def creep_speed(grid: Grid, slope: float, mu: float = 0.5) -> Array:
    """Downhill speed of a smoothed contact under REM-logistic and inertia scaling (docs/stability.md)."""
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
    return np.abs(-_along(run, slope)[:, -1] - 0.5 * pull * time**2)


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


def _deep(grid: Grid, steps: int) -> Start:
    return Start(states(grid, 3, q1=-grid.variant), {"gravity": np.zeros((grid.size, 2))})


def _deep_rest(run: Run) -> Array:
    """Depth that is left after the first step [m]."""
    return np.maximum(-run.gap[:, 0], 0.0)


def _long(grid: Grid, steps: int) -> Start:
    return _rest(grid, steps)


# ---------------------------------------------------------------------------------------- limits and levers


def _opposing(grid: Grid, steps: int) -> Start:
    half = grid.variant[:, None]
    x0 = states(grid, 1, q0=0.3 * grid.variant, v0=1.0)
    return Start(x0, {"lower": -half, "upper": half}, np.zeros((grid.size, steps, 1)))


def _outside(run: Run) -> Array:
    return np.maximum(np.abs(run.states[:, 1:, 0]).max(1) - run.grid.variant, 0.0)


def _jam(grid: Grid, steps: int) -> Start:
    half = grid.variant[:, None]
    return Start(states(grid, 1), {"lower": half, "upper": -half}, np.zeros((grid.size, steps, 1)))


def _nothing(run: Run) -> Array:
    return np.zeros(run.grid.size)


def _spike(grid: Grid, steps: int) -> Start:
    controls = np.zeros((grid.size, steps, 1))
    controls[:, steps // 4] = grid.variant[:, None]
    controls[:, steps // 2] = -grid.variant[:, None]
    return Start(states(grid, 1), {}, controls)


def _outside_one(run: Run) -> Array:
    return np.maximum(np.abs(run.states[:, 1:, 0]).max(1) - 1.0, 0.0)


def _lever(grid: Grid, steps: int) -> Start:
    offset = np.zeros((grid.size, 2, 2))
    offset[:, 0, 0] = grid.variant
    offset[:, 1, 1] = -0.05 * grid.layer - 1e-3 * grid.h * np.isnan(grid.sigma)
    controls = np.full((grid.size, steps, 1), -1.0)
    return Start(states(grid, 1), {"shape_offset": offset}, controls)


def _spin(run: Run) -> Array:
    """Speed of turning after one step [rad/s]: nothing in the scene turns at more than sigma or h a."""
    return np.abs(run.states[:, 1:, run.nv]).max(1)


def _first(method: Method) -> bool:
    return method.friction == "anitescu"


MASSES = (1e-3, 1.0, 1e3)
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
         lambda r: np.abs(_along(r, 0.3)[:, -1]), 1e-3, duration=10.0, label="mass", variants=MASSES),
    Case("stop", "sliding at 3 m/s stops at v^2/(2 mu g)", scenes.disc, _slide, _stop_error,
         lambda g: g.h * g.variant, duration=2.0, label="speed", variants=(3.0,), quick=True),
    Case("hop", "sliding from gap 0 stays on the ground", scenes.disc, _hop,
         lambda r: r.states[:, :, 1].max(1), 1e-3, duration=1.0, label="speed", variants=(3.0,)),
    Case("threshold", "sticks at tan(slope) = .99 mu, slides at 1.01 mu", scenes.disc, _threshold,
         _threshold_error, _threshold_limit, duration=10.0, label="tan/mu", variants=(0.99, 1.01),
         quick=True),
    Case("impact", "no departure faster than the noise makes it", scenes.disc, _impact, _rebound,
         lambda g: 1e-9 if g.method.hard else _departure_limit(g), "sigma",
         steps=60, label="v/sigma", variants=(0.5, 5.0, 50.0, 1000.0), quick=True),
    Case("deep", "deep penetration is resolved in a step", scenes.disc, _deep, _deep_rest, 1e-9,
         steps=20, label="depth", variants=(1e-3, 0.1, 10.0)),
)  # fmt: skip
JOINT_CASES = (
    Case("opposing limits", "limits closer than the smoothing layer", scenes.slider, _opposing, _outside,
         lambda g: 1e-9, steps=200, label="half width", variants=(1e-2, 1e-4, 1e-6, 0.0), quick=True),
    Case("jam", "crossed limits that no velocity opens", scenes.slider, _jam, _nothing, 0.0, "", steps=3,
         label="overlap", variants=(1e-3, 0.1, 10.0), expect=Status.INFEASIBLE, quick=True),
    Case("torque spike", "one step of a huge force between limits", scenes.slider, _spike, _outside_one, 1e-6,
         steps=40, label="force", variants=(1e2, 1e4, 1e6), quick=True),
    Case("lever to 0", "a row whose Jacobian vanishes", scenes.lever, _lever, _spin, 1.0, "rad/s",
         steps=1, label="lever", variants=(1e-1, 1e-3, 1e-6, 1e-12, 0.0), quick=True),
)  # fmt: skip
CASES: tuple[Case, ...] = (*DISC_CASES, *JOINT_CASES)
