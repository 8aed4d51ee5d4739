"""Dynamics and costs with known answers that several tests use."""

import numpy as np
import scipy.linalg
import warp as wp

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest

FINGER = slcp.scenes.flicking_finger()


def make_cart_pole(dtype, VX, VU):
    """Cart (1 kg) with a pole (0.1 kg, 0.5 m), explicit Euler; x = (position, angle from upright, rates)."""
    half, one, gravity = dtype(0.5), dtype(1.0), dtype(9.81)
    pole, total, third = (
        dtype(0.1),
        dtype(1.1),
        dtype(4.0 / 3.0),
    )  # in a kernel 4.0 / 3.0 is divided in float32

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        h = params[row, 0]
        s, c = wp.sin(x[1]), wp.cos(x[1])
        push = (u[0] + pole * half * x[3] * x[3] * s) / total
        turn = (gravity * s - c * push) / (half * (third - pole * c * c / total))
        move = push - pole * half * turn * c / total
        return VX(x[0] + h * x[2], x[1] + h * x[3], x[2] + h * move, x[3] + h * turn) * one

    return step


def cart_pole(device="cpu", dtype="float64", horizon=40, limits=None):
    """Swing the pole up from hanging at rest; the problem, its start and its first controls."""
    dynamics = ddp.WarpDynamics(make_cart_pole, 4, 1, {"step_size": 0.05}, device, dtype)
    cost = ddp.costs.quadratic(np.diag([0.1, 0.1, 0.01, 0.01]), [[0.01]], np.diag([10.0, 50.0, 1.0, 5.0]))
    problem = ddp.Problem(dynamics, cost, horizon, control_limits=limits)
    return problem, np.array([0.0, np.pi, 0.0, 0.0]), 0.5 * np.ones((horizon, 1))


def make_finite_difference_cost(dtype, VX, VU):
    """A smooth cost, neither quadratic nor separable, and dependent on time."""
    one, half = dtype(1.0), dtype(0.5)

    @wp.func
    def running(x: VX, u: VU, k: int):
        time = dtype(k) * dtype(0.1)
        return (
            wp.exp(half * wp.sin(x[0])) * (one + u[0] * u[0])
            + wp.cos(x[1] + time) * u[0]
            + u[0] * u[0] * x[1]
        )

    @wp.func
    def final(x: VX):
        return wp.sin(x[0]) * x[1] * x[1]

    return running, final


def random_linear_problem(
    seed, nx=4, nu=2, horizon=15, batch=None, device="cpu", dtype="float64", limits=None
):
    """A random controllable linear-quadratic problem with an offset, and the matrices it is made of."""
    rng = np.random.default_rng(seed)
    data = {
        "A": np.eye(nx) + 0.2 * rng.normal(size=(nx, nx)),
        "B": rng.normal(size=(nx, nu)),
        "c": 0.1 * rng.normal(size=nx),
        "Q": random_spd(rng, nx),
        "R": random_spd(rng, nu),
        "Qf": 3.0 * random_spd(rng, nx),
        "target": rng.normal(size=(horizon + 1, nx)),
        "x0": rng.normal(size=nx if batch is None else (batch, nx)),
    }
    dynamics = ddp.linear_system(data["A"], data["B"], data["c"], device, dtype)
    cost = ddp.costs.quadratic(data["Q"], data["R"], data["Qf"], data["target"])
    return ddp.Problem(dynamics, cost, horizon, control_limits=limits), data


def random_spd(rng, n):
    """A well-conditioned symmetric positive definite matrix."""
    root = rng.normal(size=(n, n))
    return root @ root.T / n + 0.5 * np.eye(n)


def condense(data, horizon):
    """Dense quadratic program in the stacked controls: J = U' H U / 2 + g' U + constant, X = S U + offset."""
    A, B, c, x0 = data["A"], data["B"], data["c"], data["x0"]
    nx, nu = B.shape
    S, offset = np.zeros(((horizon + 1) * nx, horizon * nu)), np.zeros((horizon + 1, nx))
    offset[0] = x0
    for k in range(horizon):
        rows, last = slice((k + 1) * nx, (k + 2) * nx), slice(k * nx, (k + 1) * nx)
        S[rows] = A @ S[last]
        S[rows, k * nu : (k + 1) * nu] += B
        offset[k + 1] = A @ offset[k] + c
    W = scipy.linalg.block_diag(*[data["Q"]] * horizon, data["Qf"])
    error = offset.ravel() - data["target"].ravel()
    H = S.T @ W @ S + np.kron(np.eye(horizon), data["R"])
    return H, S.T @ W @ error, 0.5 * error @ W @ error


def cart_pole_cost(x0, us, h=0.05):
    """Cost of `cart_pole` under open-loop controls, written independently of the kernels."""
    x, total = np.array(x0, dtype=float), 0.0
    Q, Qf = np.array([0.1, 0.1, 0.01, 0.01]), np.array([10.0, 50.0, 1.0, 5.0])
    for u in np.ravel(us):
        total += 0.5 * (Q @ x**2 + 0.01 * u * u)
        s, c = np.sin(x[1]), np.cos(x[1])
        push = (u + 0.1 * 0.5 * x[3] ** 2 * s) / 1.1
        turn = (9.81 * s - c * push) / (0.5 * (4.0 / 3.0 - 0.1 * c * c / 1.1))
        move = push - 0.1 * 0.5 * turn * c / 1.1
        x = x + h * np.array([x[2], x[3], move, turn])
    return total + 0.5 * Qf @ x**2


def central_differences(function, z, step=1e-5):
    """Gradient of a scalar function by central differences with one Richardson extrapolation."""
    z = np.asarray(z, dtype=float)
    out = np.zeros_like(z)
    for index in np.ndindex(z.shape):
        estimates = []
        for h in (step, 2.0 * step):
            e = np.zeros_like(z)
            e[index] = h
            estimates.append((function(z + e) - function(z - e)) / (2.0 * h))
        out[index] = (4.0 * estimates[0] - estimates[1]) / 3.0
    return out


def made_library(x, **changes):
    """A library whose entry i says so: u_i = (i, -i), without feedback."""
    count = len(x)
    order = np.arange(count)
    values = {"x": x, "u": np.stack([order, -order], axis=1).astype(float), "K": np.zeros((count, 2, 6)),
              "cost": np.zeros(count), "gain": order.astype(float), "age": 0 * order, "chain": 0 * order,
              "plan": order, "period": FINGER.state_period,
              "header": {"scene": FINGER.name, "digest": scene_digest(FINGER)}}  # fmt: skip
    return ddp.Library(**{**values, **changes})


def make_fragile(dtype, VX, VU):
    """An integrator that breaks, and says nothing, when it leaves |x| < 4."""
    limit, h = dtype(4.0), dtype(0.1)

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        y = VX(x[0] + h * x[1], x[1] + h * u[0])
        if wp.abs(y[0]) > limit:
            y = VX(wp.log(-limit), y[1])
        return y

    return step


def fragile_problem(device):
    dynamics = ddp.WarpDynamics(make_fragile, 2, 1, device=device)
    cost = ddp.costs.quadratic(np.eye(2), [[0.1]], 10.0 * np.eye(2))
    return ddp.Problem(dynamics, cost, 20)
