"""The racing car on a slippery hairpin: the optimal control problem, and the hard car in NumPy."""

from dataclasses import replace
from typing import Any

import numpy as np

from slcp_warp import ddp
from slcp_warp.kernels.control.racing_car import make_car, make_hairpin

STEP_SIZE, STEPS = 0.05, 220
GRAVITY, FRICTION = 9.81, 0.3
RADIUS, HALF_WIDTH = 10.0, 2.5  # [m]
START = np.array([-12.0, -RADIUS, 0.0, 5.0, 0.0])
LIMITS = (np.array([-2.0, -0.4]), np.array([1.0, 0.4]))  # thrust [m/s^2], curvature [1/m]
WALL, EFFORT = 200.0, (1e-3, 1e-1)


def car_problem(sigma: float, position_sd: float, device: Any = None) -> ddp.Problem:
    """To be as far back on the second leg as possible after STEPS steps.

    Args:
        sigma: scale of the noise on the lateral velocity [m/s].
        position_sd: of the noise that the walls see [m].
    """
    numbers = {"step_size": STEP_SIZE, "friction": FRICTION, "sigma": sigma, "gravity": GRAVITY}
    dynamics = ddp.WarpDynamics(make_car, 5, 2, numbers, device)
    cost = ddp.Cost(make_hairpin, (WALL, position_sd, *EFFORT, RADIUS, HALF_WIDTH), nx=5, nu=2)
    return ddp.Problem(dynamics, cost, STEPS, control_limits=LIMITS)


def with_noise(problem: ddp.Problem, sigma: float, position_sd: float) -> ddp.Problem:
    """The same problem at another noise; nothing is compiled."""
    weights = problem.cost.weights.copy()
    weights[1] = position_sd
    return replace(problem.with_params(sigma=sigma), cost=problem.cost.with_weights(weights))


def offset(x: np.ndarray) -> np.ndarray:
    """Distance [m] from the middle of the road, outwards positive; x (..., 5)."""
    radius = np.where(x[..., 0] > 0.0, np.hypot(x[..., 0], x[..., 1]), np.abs(x[..., 1]))
    return np.asarray(radius - RADIUS)


def slip(x: np.ndarray) -> np.ndarray:
    """Lateral velocity of the tyres [m/s]; x (..., 5)."""
    return np.asarray(np.cos(x[..., 2]) * x[..., 4] - np.sin(x[..., 2]) * x[..., 3])


def drive(x: np.ndarray, u: np.ndarray, friction: Any = FRICTION) -> np.ndarray:
    """One step of hard cars with Coulomb's friction, x (B, 5), u (B, 2);
    `kernels/control/racing_car.py` smooths it.
    """
    h = STEP_SIZE
    heading = x[:, 2] + h * u[:, 1] * (np.cos(x[:, 2]) * x[:, 3] + np.sin(x[:, 2]) * x[:, 4])
    c, s = np.cos(heading), np.sin(heading)
    vx, vy = x[:, 3] + h * u[:, 0] * c, x[:, 4] + h * u[:, 0] * s
    most = friction * GRAVITY * h
    p = np.clip(c * vy - s * vx, -most, most)
    vx, vy = vx + s * p, vy - c * p
    return np.stack([x[:, 0] + h * vx, x[:, 1] + h * vy, heading, vx, vy], 1)


def cautious_drive(speed: float = 4.0) -> np.ndarray:
    """Controls (STEPS, 2) of a slow hard car that steers after the road's middle: where DDP starts."""
    x, us = START[None], np.zeros((STEPS, 2))
    for k in range(STEPS):
        ahead = np.zeros(5)
        ahead[:2] = x[0, :2] + 2.0 * np.array([np.cos(x[0, 2]), np.sin(x[0, 2])])
        bend = 1.0 / RADIUS if ahead[0] > 0.0 else 0.0
        us[k] = np.clip([speed - np.hypot(*x[0, 3:]), bend + 0.1 * float(offset(ahead))], *LIMITS)
        x = drive(x, us[k : k + 1])
    return us
