"""Derivatives of users' functions by Warp's adjoint where it is right, and by differences where it is not."""

import numpy as np
import pytest
import warp as wp
from ddp_examples import central_differences

from slcp_warp import ddp
from slcp_warp.ddp.dynamics.user import WarpDynamics
from slcp_warp.gradients import adjoint_check
from slcp_warp.kernels.control.user_dynamics import make_component
from slcp_warp.scripts.studies.published import models


def derivatives(dynamics, xs, us):
    """f_x and f_u side by side (N, nx, nz), and second derivatives (N, nx, nz, nz), of one problem."""
    N, nx, nu = len(us), xs.shape[1], us.shape[1]
    arrays = [wp.array(a[None], dtype=wp.float64, device="cpu") for a in (xs, us)]
    shapes = [(1, N, nx, nx), (1, N, nx, nu), (N, nx, nx + nu, nx + nu)]
    fx, fu, second = (wp.zeros(s, dtype=wp.float64, device="cpu") for s in shapes)
    status, mask = wp.zeros((1, N), dtype=wp.int32, device="cpu"), wp.ones(1, dtype=wp.int32, device="cpu")
    params = dynamics.parameter_array(dynamics.params, 1)
    dynamics.linearize_into(*arrays, params, fx, fu, second, status, mask)
    assert not status.numpy().any()
    return np.concatenate([fx.numpy()[0], fu.numpy()[0]], 2), second.numpy()


def is_right(make, nx, nu):
    """What the check says of a step without parameters."""
    component = make_component(WarpDynamics(make, nx, nu).functions(wp.float64).step, nx, nu)
    numbers = wp.zeros((1, 1), dtype=wp.float64, device="cpu")
    return adjoint_check.adjoint_is_right(component, nx + nu, nx, numbers)


def car_jacobian(x, u):
    """Of the published car, by hand."""
    h, d = 0.03, 2.0
    f, (sw, cw), (s, c) = h * x[3], (np.sin(u[0]), np.cos(u[0])), (np.sin(x[2]), np.cos(x[2]))
    root = np.sqrt(d**2 - (f * sw) ** 2)
    b = d + f * cw - root
    b_v, b_w = h * (cw + f * sw**2 / root), -f * sw + f**2 * sw * cw / root
    out = np.eye(4, 6)
    out[0, [2, 3, 4]] = -b * s, b_v * c, b_w * c
    out[1, [2, 3, 4]] = b * c, b_v * s, b_w * s
    out[2, [3, 4]] = h * sw / root, f * cw / root
    out[3, 5] = h
    return out


def test_jacobians_are_exact():
    """To rounding, which fourth-order differences miss by a factor of twenty; and their curvature."""
    rng = np.random.default_rng(4)
    xs, us = rng.normal(size=(41, 4)) * [1.0, 1.0, 2.0, 8.0], rng.normal(size=(40, 2)) * [0.5, 2.0]
    J, S = derivatives(models.car("cpu").problem.dynamics, xs, us)
    exact = np.array([car_jacobian(x, u) for x, u in zip(xs, us)])
    np.testing.assert_allclose(J, exact, rtol=0, atol=2e-14)
    for k in range(5):
        z = np.concatenate([xs[k], us[k]])
        for i in range(4):
            for j in range(6):
                row = central_differences(lambda y, i=i, j=j: car_jacobian(y[:4], y[4:])[i, j], z, 1e-3)
                np.testing.assert_allclose(S[k, i, j], row, rtol=0, atol=5e-10)
    np.testing.assert_array_equal(S, S.transpose(0, 1, 3, 2))


def acrobot_step(z):
    """The published acrobot in NumPy."""
    x, u, h, g = z[:4], z[4], 0.1, 9.8
    c, s = np.cos(x[1]), np.sin(x[1])
    d1, d2 = 3.5 + c, 1.25 + 0.5 * c
    phi2 = 0.5 * g * np.cos(x[0] + x[1] - np.pi / 2.0)
    phi1 = 1.5 * g * np.cos(x[0] - np.pi / 2.0) + phi2 - 0.5 * x[3] ** 2 * s - x[3] * x[2] * s
    second = (u + d2 / d1 * phi1 - 0.5 * x[2] ** 2 * s - phi2) / (1.25 - d2**2 / d1)
    return x + h * np.array([x[2], x[3], -(d2 * second + phi1) / d1, second])


def test_derivatives_of_the_acrobot():
    rng = np.random.default_rng(5)
    xs, us = rng.normal(size=(6, 4)), rng.normal(size=(5, 1))
    J, S = derivatives(models.acrobot("cpu").problem.dynamics, xs, us)
    for k in range(5):
        z = np.concatenate([xs[k], us[k]])
        for i in range(4):
            slope = central_differences(lambda y, i=i: acrobot_step(y)[i], z, 1e-3)
            np.testing.assert_allclose(J[k, i], slope, rtol=0, atol=1e-9)
            for j in range(5):
                bend = central_differences(
                    lambda y, i=i, j=j: central_differences(lambda w: acrobot_step(w)[i], y, 3e-3)[j], z, 3e-3
                )
                np.testing.assert_allclose(S[k, i, j], bend, rtol=0, atol=2e-7)


def make_recurrence(dtype, VX, VU):
    """sin(3 sin(3 x)) + u in a component that is assigned twice, and |(x, u)| by a loop of unknown length."""
    three, half, one = dtype(3.0), dtype(0.5), dtype(1.0)

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        y = VX(x[0], x[1])
        y[0] = wp.sin(three * y[0])
        y[0] = wp.sin(three * y[0]) + u[0]
        square = x[1] * x[1] + u[0] * u[0]
        root = one + square
        while wp.abs(root * root - square) > dtype(1e-14) * square:
            root = half * (root + square / root)
        y[1] = root
        return y

    return step


def test_a_step_whose_adjoint_is_wrong_has_differences():
    assert not is_right(make_recurrence, 2, 1)
    rng = np.random.default_rng(6)
    xs, us = rng.normal(size=(4, 2)), rng.normal(size=(3, 1))
    J, S = derivatives(ddp.WarpDynamics(make_recurrence, 2, 1, device="cpu"), xs, us)
    for k in range(3):
        (p, v), (u,) = xs[k], us[k]
        inner, r = 3.0 * np.sin(3.0 * p), np.hypot(v, u)
        slope = 9.0 * np.cos(inner) * np.cos(3.0 * p)
        np.testing.assert_allclose(J[k], [[slope, 0.0, 1.0], [0.0, v / r, u / r]], rtol=0, atol=1e-6)
        bend = -81.0 * np.sin(inner) * np.cos(3.0 * p) ** 2 - 27.0 * np.cos(inner) * np.sin(3.0 * p)
        assert S[k, 0, 0, 0] == pytest.approx(bend, abs=2e-4)
        assert S[k, 1, 1, 2] == pytest.approx(-u * v / r**3, rel=1e-4, abs=1e-5)


def make_drag(dtype, VX, VU):
    """Drag along v with the speed's size, of which Warp's adjoint is not a number at rest."""
    h = dtype(0.1)

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        speed = wp.sqrt(x[0] * x[0] + x[1] * x[1])
        return VX(x[0] + h * (u[0] - speed * x[0]), x[1] - h * speed * x[1])

    return step


def test_differences_stand_in_where_an_adjoint_is_not_finite():
    assert is_right(make_drag, 2, 1)
    xs = np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 0.0]])
    J, S = derivatives(ddp.WarpDynamics(make_drag, 2, 1, device="cpu"), xs, np.zeros((2, 1)))
    assert np.isfinite(S).all()
    np.testing.assert_allclose(J[0], [[1.0, 0.0, 0.1], [0.0, 1.0, 0.0]], rtol=0, atol=1e-3)
    exact = [
        [1.0 - 0.1 * (5.0 + 9.0 / 5.0), -0.1 * 12.0 / 5.0, 0.1],
        [-0.1 * 12.0 / 5.0, 1.0 - 0.1 * 8.2, 0.0],
    ]
    np.testing.assert_allclose(J[1], exact, rtol=0, atol=1e-14)


def make_hidden(dtype, VX, VU):
    """A component that is assigned twice, times a parameter."""
    three = dtype(3.0)

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        y = VX(x[0], x[1])
        y[0] = wp.sin(three * y[0])
        y[0] = wp.sin(three * y[0])
        return VX(x[0] + params[row, 1] * y[0], x[1] + params[row, 0] * u[0])

    return step


def test_a_wrong_adjoint_is_not_hidden_by_a_parameter_that_is_zero():
    component = make_component(WarpDynamics(make_hidden, 2, 1).functions(wp.float64).step, 2, 1)
    hiding = wp.array([[2.0, 0.0]], dtype=wp.float64, device="cpu")
    assert not adjoint_check.adjoint_is_right(component, 3, 2, hiding)


def test_a_verdict_is_found_once(monkeypatch):
    assert is_right(make_drag, 2, 1)
    monkeypatch.setattr(adjoint_check, "_looks_right", lambda *_: pytest.fail("looked at again"))
    derivatives(ddp.WarpDynamics(make_drag, 2, 1, device="cpu"), np.ones((2, 2)), np.ones((1, 1)))
