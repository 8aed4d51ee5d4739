"""Cases of one body: stiff damping, stiff springs, and a guide nearly along the surface that it meets."""

import math

import numpy as np

from slcp_warp.kernels.method import Method
from slcp_warp.options import Status

from . import scenes
from .case import Array, Case, Grid, Run, Start, friction, ground_angle, states

TILT = math.pi / 2 - math.atan2(1.0, 0.0735)  # of the surface towards the guide [rad]
DISC, DEEP, SPEED = 0.1, 1e-3, 1.0
STIFF = (0.1, 1.0, 1.9, 2.1, 10.0, 1e2, 1e3, 1e4)  # c h/m; explicit damping diverges above 2
RINGS = (0.1, 0.5, 1.0, 1.9, 2.1, 10.0, 1e2, 1e3, 1e4)  # h omega; explicit springs diverge above 2
JAMS = (0.5, 0.9, 0.999, 1.001, 1.1, 2.0, 10.0)  # mu, relative to tan(TILT), where friction holds the slider


def _damped(grid: Grid, steps: int) -> Start:
    damping = grid.variant[:, None] / grid.h
    return Start(states(grid, 1, v0=0.01), {"damping": damping})


def _swings(run: Run) -> Array:
    """How far a speed is from decaying without a change of sign, relative to the first."""
    v = run.states[:, :, 1]
    risen = np.maximum(v[:, 1:] - v[:, :-1], 0.0).max(1)
    return np.maximum(risen, np.maximum(-v, 0.0).max(1)) / v[:, 0]


def _sprung(grid: Grid, steps: int) -> Start:
    stiffness = (grid.variant / grid.h)[:, None] ** 2
    return Start(states(grid, 1, q0=0.01), {"stiffness": stiffness})


def _swing(run: Run) -> Array:
    """The largest stretch, relative to the first."""
    stretch = np.abs(run.states[:, :, 0])
    return stretch.max(1) / stretch[:, 0]


def _tied(grid: Grid, steps: int) -> Start:
    stiffness = (grid.variant / grid.h)[:, None] ** 2
    return Start(states(grid, 3, q0=0.4, q1=0.35, v0=0.3), {"spring_stiffness": stiffness})


def _stretched(run: Run) -> Array:
    """The largest length beyond the first, relative to the spring's length at rest."""
    length = np.hypot(run.states[:, :, 0], run.states[:, :, 1])
    return (length.max(1) - length[:, 0]) / 0.5


def _guide(grid: Grid, tilt: Array, mu: Array, gap: float, speed: float) -> Start:
    """The disc `gap` away from (or inside) the surface, `speed` along the guide towards it."""
    x0 = states(grid, 1, q0=-(DISC + gap) / np.sin(tilt), v0=speed)
    numbers = {
        "shape_angle": ground_angle(grid, 2, tilt),
        "friction": friction(grid, 1, mu),
        "radius": np.full((grid.size, 2, 2), DISC),
    }
    return Start(x0, numbers)


def _strikes(grid: Grid, steps: int) -> Start:
    return _guide(grid, np.full(grid.size, TILT), grid.variant * math.tan(TILT), DEEP, SPEED)


def _leaves(grid: Grid, steps: int) -> Start:
    return _guide(grid, np.full(grid.size, TILT), grid.variant * math.tan(TILT), -DEEP, 0.0)


def _along(grid: Grid, steps: int) -> Start:
    tilt = grid.variant
    return _guide(grid, tilt, 0.5 * np.tan(tilt), 1e-6, SPEED)


def _entered(run: Run) -> Array:
    """Deepest penetration after any step [m]."""
    return np.maximum(-run.gap, 0.0).max(1)


def _nothing(run: Run) -> Array:
    return np.zeros(run.grid.size)


def _layer(grid: Grid) -> Array:
    """Nothing enters; expected residual minimisation may, by a part of its layer."""
    return 1e-9 + (0.0 if not grid.method.erm else 1.0) * grid.layer


def _relaxed(method: Method) -> bool:
    return not method.coulomb


GUIDE_CASES = (
    Case("stiff damping", "a damped slider slows down and never turns", scenes.damped, _damped, _swings,
         1e-12, "", steps=20, single=1e-6, label="c h/m", variants=STIFF, quick=True),
    Case("stiff joint spring", "it swings no further than 2^.5 times the first stretch", scenes.sprung,
         _sprung, _swing, 2.0**0.5 + 1e-9, "", steps=200, single=1e-5, label="h omega", variants=RINGS,
         quick=True),
    Case("stiff spring", "a disc tied by a spring between points stays near it", scenes.tied, _tied,
         _stretched, 1.0, "", steps=200, single=1e-5, label="h omega", variants=RINGS, generic=True,
         quick=True),
    Case("slider strikes", "a guided disc meets a surface nearly along its guide", scenes.guide, _strikes,
         _entered, _layer, steps=20, single=1e-5, label="mu/jam", variants=JAMS, quick=True),
    Case("slider leaves", "it starts 1 mm inside, with less friction than holds it", scenes.guide, _leaves,
         _entered, _layer, steps=3, single=1e-5, label="mu/jam", variants=(0.5, 0.9, 0.999), quick=True),
    Case("slider jams", "the same with more: no impulse opens it (Coulomb)", scenes.guide, _leaves, _nothing,
         0.0, "", steps=3, label="mu/jam", variants=(1.001, 1.1, 2.0, 10.0), expect=Status.JAMMED,
         only=lambda method: method.coulomb, quick=True),
    Case("slider wedged", "the same: no velocity opens both rows (Anitescu)", scenes.guide, _leaves, _nothing,
         0.0, "", steps=3, label="mu/jam", variants=(1.001, 1.1, 2.0, 10.0), expect=Status.INFEASIBLE,
         only=_relaxed, quick=True),
    Case("guide along", "a guide ever more along the surface", scenes.guide, _along, _entered, _layer,
         steps=20, single=1e-5, label="tilt", variants=(1e-1, 1e-2, 1e-3, 1e-4, 1e-6), quick=True),
)  # fmt: skip
