"""Published problems of optimal control, with the costs that are known for them."""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from slcp_warp import ddp


class Published(NamedTuple):
    """A problem, its first state, the lowest cost known, and where it is from."""

    problem: ddp.Problem
    x0: np.ndarray
    known: float
    source: str


def rendezvous(device: Any = None) -> Published:
    """Two vehicles meet; linear-quadratic, with velocities that grow by a tenth a step, as published."""
    A, B = np.eye(8), np.zeros((8, 4))
    A[:4, 4:], A[4:, 4:] = 0.1 * np.eye(4), (1.0 + 0.1 * (1.0 - 0.01)) * np.eye(4)
    B[4:] = 0.01 * np.eye(4)
    Q = np.eye(8)
    Q[0, 2] = Q[2, 0] = Q[1, 3] = Q[3, 1] = -1.0
    cost = ddp.costs.quadratic(2.0 * Q, 0.2 * np.eye(4), 2.0 * Q)
    problem = ddp.Problem(ddp.linear_system(A, B, device=device), cost, 200)
    x0 = np.array([0.0, 0.0, 10.0, 10.0, 0.0, -5.0, 5.0, 0.0])
    return Published(problem, x0, 23370.774, "anassinator/ilqr, rendezvous")


def make_acrobot(dtype: Any, VX: Any, VU: Any) -> Any:
    """Sutton's acrobot, torque at the elbow, hanging at angle 0; explicit Euler."""
    h, g = dtype(0.1), dtype(9.8)
    quarter, half, one, two = dtype(0.25), dtype(0.5), dtype(1.0), dtype(2.0)
    right = dtype(math.pi / 2.0)

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        c, s = wp.cos(x[1]), wp.sin(x[1])
        d1 = quarter + one + quarter + c + two
        d2 = quarter + half * c + one
        phi2 = half * g * wp.cos(x[0] + x[1] - right)
        phi1 = (half + one) * g * wp.cos(x[0] - right) + phi2 - half * x[3] * x[3] * s - x[3] * x[2] * s
        second = (u[0] + d2 / d1 * phi1 - half * x[2] * x[2] * s - phi2) / (quarter + one - d2 * d2 / d1)
        first = -(d2 * second + phi1) / d1
        return VX(x[0] + h * x[2], x[1] + h * x[3], x[2] + h * first, x[3] + h * second)

    return step


def acrobot(device: Any = None) -> Published:
    """Swing up in 5 s."""
    goal, one = np.array([math.pi, 0.0, 0.0, 0.0]), np.eye(4)
    cost = ddp.costs.quadratic(0.1 * one, [[0.01]], 1000.0 * one, goal)
    problem = ddp.Problem(ddp.WarpDynamics(make_acrobot, 4, 1, device=device), cost, 50)
    return Published(problem, np.zeros(4), 44.5133, "trajax, optimizers_test: below 51")


def make_cart_pole(dtype: Any, VX: Any, VU: Any, order: int = 3) -> Any:
    """A cart of 1 kg with a point of .2 kg at .5 m, hanging at angle 0.

    The midpoint rule (order 2), Kutta's third-order rule, or the classical one of order 4.
    """
    h, cart, pole, length, g = (dtype(v) for v in (0.05, 1.0, 0.2, 0.5, 9.81))
    half, two, four, six = dtype(0.5), dtype(2.0), dtype(4.0), dtype(6.0)

    @wp.func
    def rate(x: VX, u: VU):
        s, c = wp.sin(x[1]), wp.cos(x[1])
        across = pole * length * c
        force = u[0] + pole * length * s * x[3] * x[3]
        torque = -pole * g * length * s
        inertia = pole * length * length
        det = (cart + pole) * inertia - across * across
        return VX(
            x[2],
            x[3],
            (inertia * force - across * torque) / det,
            ((cart + pole) * torque - across * force) / det,
        )

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        k1 = h * rate(x, u)
        k2 = h * rate(x + half * k1, u)
        if wp.static(order == 2):
            after = x + k2
        elif wp.static(order == 3):
            after = x + (k1 + four * k2 + h * rate(x - k1 + two * k2, u)) / six
        else:
            k3 = h * rate(x + half * k2, u)
            after = x + (k1 + two * k2 + two * k3 + h * rate(x + k3, u)) / six
        return after

    return step


def cart_pole(device: Any = None, order: int = 3, final: float = 100.0) -> Published:
    """Altro's swing-up in 5 s with at most 3 N, the goal as a final cost; a large one is Altro's constraint.

    Args:
        order: of the rule of integration.
        final: weight of the goal.
    """
    goal, one = np.array([0.0, math.pi, 0.0, 0.0]), np.eye(4)
    cost = ddp.costs.quadratic(5e-4 * one, [[5e-3]], final * one, goal)
    make = make_cart_pole if order == 3 else functools.partial(make_cart_pole, order=order)
    dynamics = ddp.WarpDynamics(make, 4, 1, device=device)
    problem = ddp.Problem(dynamics, cost, 100, control_limits=(-3.0, 3.0))
    return Published(problem, np.zeros(4), 1.4943, "Altro.jl, problems/cartpole.jl, RK3")


def balanced_pole(device: Any = None) -> Published:
    """The same pole a tenth of a radian from standing, without limits: a rollout under zeros falls over."""
    swing = cart_pole(device)
    problem = ddp.Problem(swing.problem.dynamics, swing.problem.cost, 100)
    return Published(problem, np.array([0.0, math.pi - 0.1, 0.0, 0.0]), math.nan, "unstable start")


def make_car(dtype: Any, VX: Any, VU: Any) -> Any:
    """Position, heading, speed of the front wheels; their angle and acceleration."""
    h, d = dtype(0.03), dtype(2.0)

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        f = h * x[3]
        side = f * wp.sin(u[0])
        b = d + f * wp.cos(u[0]) - wp.sqrt(d * d - side * side)
        heading = x[2] + wp.asin(side / d)
        return VX(x[0] + b * wp.cos(x[2]), x[1] + b * wp.sin(x[2]), heading, x[3] + h * u[1])

    return step


def make_parking(dtype: Any, VX: Any, VU: Any) -> Any:
    """Smooth absolute values of the state, and the controls' squares."""
    angle, push, near, wide = dtype(1e-2), dtype(1e-4), dtype(1e-3), dtype(0.1)
    place, heading, speed, tight, one = dtype(0.1), dtype(1.0), dtype(0.3), dtype(0.01), dtype(1.0)

    @wp.func
    def size(x: dtype, p: dtype):
        return wp.sqrt(x * x + p * p) - p

    @wp.func
    def running(x: VX, u: VU, k: int):
        return angle * u[0] * u[0] + push * u[1] * u[1] + near * (size(x[0], wide) + size(x[1], wide))

    @wp.func
    def final(x: VX):
        last = place * (size(x[0], tight) + size(x[1], tight)) + heading * size(x[2], tight)
        return last + speed * size(x[3], one) + near * (size(x[0], wide) + size(x[1], wide))

    return running, final


def car(device: Any = None) -> Published:
    """Parking with limits on the wheels' angle and the acceleration."""
    dynamics = ddp.WarpDynamics(make_car, 4, 2, device=device)
    limits = ([-0.5, -2.0], [0.5, 2.0])
    problem = ddp.Problem(dynamics, ddp.costs.plain(make_parking), 500, control_limits=limits)
    x0 = np.array([1.0, 1.0, 1.5 * math.pi, 0.0])
    return Published(problem, x0, 1.4361, "Tassa, Mansard & Todorov 2014, demo_car")


PROBLEMS: dict[str, Callable[..., Published]] = {
    "rendezvous": rendezvous,
    "acrobot": acrobot,
    "cart-pole": cart_pole,
    "balanced pole": balanced_pole,
    "car": car,
}
