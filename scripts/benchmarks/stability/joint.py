"""Cases of joint limits, and of a row whose Jacobian vanishes."""

import numpy as np

from slcp_warp.options import Status

from . import scenes
from .case import Array, Case, Grid, Run, Start, states


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


JOINT_CASES = (
    Case("opposing limits", "limits closer than the smoothing layer", scenes.slider, _opposing, _outside,
         lambda g: 1e-9, steps=200, single=1e-6, label="half width", variants=(1e-2, 1e-4, 1e-6, 0.0),
         quick=True),
    Case("jam", "crossed limits that no velocity opens", scenes.slider, _jam, _nothing, 0.0, "", steps=3,
         label="overlap", variants=(1e-3, 0.1, 10.0), expect=Status.INFEASIBLE, quick=True),
    Case("torque spike", "one step of a huge force between limits", scenes.slider, _spike, _outside_one, 1e-6,
         steps=40, single=1e-3, label="force", variants=(1e2, 1e4, 1e6), quick=True),
    Case("lever to 0", "a row whose Jacobian vanishes", scenes.lever, _lever, _spin, 1.0, "rad/s",
         steps=1, label="lever", variants=(1e-1, 1e-3, 1e-6, 1e-12, 0.0), quick=True),
)  # fmt: skip
