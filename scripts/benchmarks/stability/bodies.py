"""Cases of one extended body: a block on two corners, a rod, a tossed box, ellipses and a thin wall."""

import math
from typing import Any

import numpy as np

from slcp_warp.kernels.method import Method

from . import scenes
from .case import UP, Array, Case, G, Grid, Run, Start, friction, ground_angle, states
from .disc import MASSES, along


def cheap(method: Method) -> bool:
    """Expected residual minimisation is left out of scenes where its kernels take minutes to compile."""
    return not method.erm


TILT = 0.3  # of the slope a block must stick on at mu = .5: tan = .31
ROD = 0.5  # half length of the rod [m]
WALL, BALL = 0.025, 0.05  # half thickness of the wall, radius of what is thrown at it [m]


def _masses(grid: Grid, inertia: float) -> dict[str, Any]:
    mass = grid.variant[:, None]
    return {"mass": mass, "inertia": inertia * mass}


def _block(grid: Grid, steps: int) -> Start:
    x0 = states(grid, 3, q0=-0.1 * math.sin(TILT), q1=0.1 * math.cos(TILT), q2=TILT)
    return Start(x0, {"shape_angle": ground_angle(grid, 3, TILT), **_masses(grid, 1 / 60)})


def _block_moved(run: Run) -> Array:
    moved = along(run, TILT)
    return np.abs(moved - moved[:, :1]).max(1)


def _block_slides(grid: Grid, steps: int) -> Start:
    speed, lift = grid.variant, 0.0 if grid.method.coulomb else 0.5
    return Start(states(grid, 3, q1=0.1 + grid.h * lift * speed, v0=speed, v1=-(lift**2) * G * grid.h))


def _coincident(grid: Grid, steps: int) -> Start:
    offset = np.zeros((grid.size, 3, 2))
    offset[:, :2, 1] = -0.1
    return Start(states(grid, 3, q1=0.1), {"shape_offset": offset, **_masses(grid, 1 / 60)})


def _height(run: Run) -> Array:
    return np.abs(run.states[:, -1, 1] - 0.1)


def _rod(grid: Grid, steps: int) -> Start:
    """A rod whose lower end slides in the direction in which friction drives it into the ground."""
    angle, speed, mu = math.atan(2.0), 2.0, grid.variant
    lift = 0.0 if grid.method.coulomb else grid.h * mu * speed
    offset = np.zeros((grid.size, 3, 2))
    offset[:, 0, 0], offset[:, 1, 0] = -ROD, ROD
    x0 = states(grid, 3, q1=ROD * math.sin(angle) + lift, q2=angle, v0=-speed)
    numbers = {
        "shape_offset": offset,
        "inertia": np.full((grid.size, 1), ROD**2 / 3),
        "friction": friction(grid, 2, mu),
    }
    return Start(x0, numbers)


def energy_gain(run: Run) -> Array:
    """Largest energy above that of the start, relative to the moving energy plus the height's there."""
    start = run.energy[:, :1]
    return np.maximum((run.energy - start) / np.abs(start), 0.0).max(1)


def _toss(grid: Grid, steps: int) -> Start:
    return Start(states(grid, 3, q1=0.6, q2=0.2, v0=2.0, v2=grid.variant))


def _shapes(grid: Grid, radii: Any) -> Array:
    return np.broadcast_to(np.asarray(radii, float), (grid.size, 2, 2)).copy()


def _inside(grid: Grid, steps: int) -> Start:
    """0, 1: concentric, axes along each other and across; 2: shifted along an axis; 3: equal and across."""
    kind = grid.variant
    radii = _shapes(grid, [[0.5, 0.3], [0.2, 0.1]])
    radii[kind == 3] = 0.4, 0.2
    x0 = states(grid, 3, q0=np.where(kind == 2, 0.4, 0.0), q2=np.where(kind % 2 == 1, UP, 0.0))
    return Start(x0, {"radius": radii})


def _left_inside(run: Run) -> Array:
    return np.maximum(-run.gap[:, -1], 0.0)


def _throw(grid: Grid, steps: int) -> Start:
    """Straight at the middle of the wall, from a fraction of a step's travel away."""
    speed = grid.variant
    x0 = states(grid, 3, q0=-(WALL + BALL) - 0.37 * grid.h * speed - 0.2, v0=speed)
    return Start(x0, {"radius": _shapes(grid, [[WALL, 1.0], [BALL, BALL]])})


def _through(run: Run) -> Array:
    """How far the ball's centre came beyond where the wall stops it [m]."""
    return np.maximum(run.states[:, :, 0].max(1) + WALL + BALL, 0.0)


BODY_CASES = (
    Case("block sticks", "a block that must stick creeps in 10 s", scenes.two_points, _block, _block_moved,
         1e-3, duration=10.0, label="mass", variants=MASSES),
    Case("block stops", "a block sliding at 3 m/s stops at v^2/(2 mu g)", scenes.two_points, _block_slides,
         lambda r: np.abs(r.states[:, -1, 0] - r.grid.variant**2 / G), lambda g: g.h * g.variant,
         duration=2.0, label="speed", variants=(3.0,)),
    Case("two in one place", "a block on two points in one place", scenes.two_points, _coincident, _height,
         1e-3, duration=1.0, label="mass", variants=MASSES),
    Case("Painleve rod", "a sliding rod, critical at mu = 4/3, gains no energy", scenes.two_points, _rod,
         energy_gain, 1e-9, "", duration=0.3, single=1e-5, label="mu", variants=(1.2, 1.5)),
    Case("box toss", "a thrown, spinning box gains no energy", scenes.box, _toss, energy_gain, 1e-9, "",
         duration=2.0, single=1e-5, label="spin", only=cheap, variants=(3.0, 8.0, -15.0)),
    Case("ellipses inside", "concentric and axis-aligned ellipses part", scenes.ellipses, _inside,
         _left_inside, 1e-9, steps=5, single=1e-6, label="placing", only=cheap,
         variants=(0.0, 1.0, 2.0, 3.0)),
    Case("thin wall", "a ball does not pass a wall of 5 cm", scenes.ellipses, _throw, _through, 1e-3,
         steps=40, label="speed", only=cheap, variants=(10.0, 30.0, 100.0, 1000.0)),
)  # fmt: skip
