"""The backward pass against dense linear algebra, differences of the cost-to-go and optimality conditions."""

import numpy as np
import pytest
import warp as wp
from ddp_examples import cart_pole, cart_pole_cost, central_differences, condense, random_linear_problem

from slcp_warp import ddp

N = 15
UNREGULARIZED = ddp.Regularization(initial=0.0)


@pytest.mark.parametrize("method", ["second-order", "gauss-newton"])
def test_linear_quadratic_problem_is_solved_in_one_pass(device, method):
    problem, data = random_linear_problem(0, horizon=N, device=device)
    result = ddp.solve(
        problem, data["x0"], np.ones((N, 2)), ddp.Options(method=method, regularization=UNREGULARIZED)
    )
    H, g, constant = condense(data, N)
    U = np.linalg.solve(H, -g)
    assert result.status == ddp.Status.CONVERGED
    assert result.iterations == 1
    np.testing.assert_allclose(result.us.ravel(), U, atol=1e-10)
    np.testing.assert_allclose(result.cost, 0.5 * g @ U + constant, rtol=1e-12)
    np.testing.assert_allclose(result.trace.reduction_ratio[0], 1.0, atol=1e-10)


def test_the_pivot_of_the_first_order_method_is_without_regularisation(device):
    """Q_uu is l_uu there; what is added for the direction is not in its pivot, nor in what is expected."""
    problem, data = random_linear_problem(0, horizon=N, device=device)
    least = np.diag(np.linalg.cholesky(data["R"])).min() ** 2
    for initial in (0.5, 2.0):
        regularization = ddp.Regularization(initial=initial)
        options = ddp.Options(method="first-order", max_iterations=1, regularization=regularization)
        trace = ddp.solve(problem, data["x0"], np.ones((N, 2)), options).trace
        assert trace.regularization[0] == initial
        np.testing.assert_allclose(trace.min_pivot[0], least, rtol=1e-12)


def test_linear_quadratic_problem_in_float32(device):
    problem, data = random_linear_problem(0, horizon=N, device=device, dtype="float32")
    result = ddp.solve(problem, data["x0"], np.ones((N, 2)), ddp.Options(regularization=UNREGULARIZED))
    H, g, _ = condense(data, N)
    assert result.us.dtype == np.float32
    np.testing.assert_allclose(result.us.ravel(), np.linalg.solve(H, -g), atol=1e-4)


def test_value_of_a_linear_quadratic_problem_is_exact(device):
    problem, data = random_linear_problem(1, horizon=N, device=device)
    result = ddp.solve(problem, data["x0"], np.zeros((N, 2)), ddp.Options(regularization=UNREGULARIZED))

    def optimal_cost(x0):
        H, g, constant = condense({**data, "x0": x0}, N)
        return constant - 0.5 * g @ np.linalg.solve(H, g)

    gradient = central_differences(optimal_cost, data["x0"], 1.0)  # quadratic: exact for any step
    np.testing.assert_allclose(result.Vx[0], gradient, atol=1e-10 * abs(gradient).max())
    for i, e in enumerate(np.eye(4)):
        row = (
            central_differences(optimal_cost, data["x0"] + e, 1.0)
            - central_differences(optimal_cost, data["x0"] - e, 1.0)
        ) / 2.0
        np.testing.assert_allclose(result.Vxx[0, i], row, atol=1e-9 * abs(result.Vxx[0]).max())


def dense_backward_pass(data, xs, us, mu_x, mu_u):
    """The regularised backward pass of a linear-quadratic problem: K, k, V_x, V_xx."""
    A, B, Q, R = data["A"], data["B"], data["Q"], data["R"]
    Vxx, Vx = data["Qf"], data["Qf"] @ (xs[-1] - data["target"][-1])
    out = [], [], [Vx], [Vxx]
    for k in reversed(range(len(us))):
        Qx, Qu = Q @ (xs[k] - data["target"][k]) + A.T @ Vx, R @ us[k] + B.T @ Vx
        Qxx, Qux, Quu = Q + A.T @ Vxx @ A, B.T @ Vxx @ A, R + B.T @ Vxx @ B
        regular = Quu + mu_x * B.T @ B + mu_u * np.eye(2)
        K, step = -np.linalg.solve(regular, Qux + mu_x * B.T @ A), -np.linalg.solve(regular, Qu)
        Vx = Qx + K.T @ Quu @ step + K.T @ Qu + Qux.T @ step
        Vxx = Qxx + K.T @ Quu @ K + K.T @ Qux + Qux.T @ K
        for values, value in zip(out, (K, step, Vx, Vxx)):
            values.append(value)
    return [np.array(values[::-1]) for values in out]


@pytest.mark.parametrize(("state_weight", "control_weight"), [(0.5, 0.0), (0.0, 0.3), (0.5, 0.3)])
def test_regularised_backward_pass_far_from_the_optimum(device, state_weight, control_weight):
    problem, data = random_linear_problem(4, horizon=N, device=device)
    schedule = ddp.Regularization(initial=2.0, state_weight=state_weight, control_weight=control_weight)
    us = np.random.default_rng(0).normal(size=(N, 2))
    result = ddp.solve(problem, data["x0"], us, ddp.Options(max_iterations=0, regularization=schedule))
    expected = dense_backward_pass(data, result.xs, us, 2.0 * state_weight, 2.0 * control_weight)
    for name, value in zip(("K", "k", "Vx", "Vxx"), expected):
        scale = abs(value).max()
        np.testing.assert_allclose(getattr(result, name), value, atol=1e-12 * scale, err_msg=name)


def test_value_gradient_and_hessian_of_cart_pole(device):
    problem, x0, u0 = cart_pole(device)
    options = ddp.Options(gradient_tolerance=1e-11)
    result = ddp.solve(problem, x0, u0, options)
    assert result.status == ddp.Status.CONVERGED
    assert result.positive_definite
    np.testing.assert_allclose(result.cost, cart_pole_cost(x0, result.us), rtol=1e-12)
    gradient = central_differences(lambda x: cart_pole_cost(x, result.us), x0)
    np.testing.assert_allclose(result.Vx[0], gradient, rtol=1e-6, atol=1e-7)
    # V_xx is the change of V_x when the controls are optimised again
    e = 1e-3 * np.eye(4)
    starts = np.concatenate([x0 + e, x0 - e])
    again = ddp.Workspace(problem, 8, options).solve(starts, result.us, result.xs, result.K)
    assert (again.gradient < 1e-7).all()
    hessian = (again.Vx[:4, 0] - again.Vx[4:, 0]) / 2e-3
    np.testing.assert_allclose(result.Vxx[0], hessian, atol=1e-4 * abs(hessian).max())
    # the gains are how the optimal controls change with the state
    gains = (again.us[:4, 0] - again.us[4:, 0]).T / 2e-3
    np.testing.assert_allclose(result.K[0], gains, atol=1e-4 * abs(gains).max())


@pytest.mark.parametrize("bound", [0.3, 1.0])
def test_box_constrained_problem_meets_its_optimality_conditions(device, bound):
    limits = ([-bound, -2.0 * bound], [bound, np.inf])
    problem, data = random_linear_problem(2, horizon=N, device=device, limits=limits)
    result = ddp.solve(problem, data["x0"], np.zeros((N, 2)))
    assert result.status == ddp.Status.CONVERGED
    H, g, _ = condense(data, N)
    lower, upper = np.tile(limits[0], N), np.tile(limits[1], N)
    U = result.us.ravel()
    slope = H @ U + g
    assert (lower <= U).all() and (upper >= U).all()
    held = ((lower == U) & (slope > 0)) | ((upper == U) & (slope < 0))
    assert 0 < held.sum() < held.size  # limits act, and not everywhere
    assert abs(slope[~held]).max() < 1e-6  # with H positive definite this is the only minimum
    assert not result.K.reshape(-1, 4)[held].any()
    assert result.K.reshape(-1, 4)[~held].any(axis=1).all()


def make_double_well(dtype, VX, VU):
    one, quarter = dtype(1.0), dtype(0.25)

    @wp.func
    def running(x: VX, u: VU, k: int):
        well = u[0] * u[0] - one
        return well * well + quarter * quarter * x[0] * x[0]

    return running, None


@pytest.mark.parametrize(("state_weight", "control_weight"), [(1.0, 0.0), (0.0, 1.0), (0.5, 0.5)])
def test_indefinite_control_hessian_restarts_with_more_regularization(device, state_weight, control_weight):
    dynamics = ddp.linear_system([[0.9]], [[0.3]], device=device)
    problem = ddp.Problem(dynamics, ddp.costs.plain(make_double_well), 5)
    schedule = ddp.Regularization(initial=0.0, state_weight=state_weight, control_weight=control_weight)
    result = ddp.solve(problem, [0.5], np.full((5, 1), 0.1), ddp.Options(regularization=schedule))
    assert result.trace.restarts[0] > 0
    assert result.trace.regularization[0] > 0
    assert result.trace.min_pivot[0] < 0  # Q_uu without regularisation
    assert result.status == ddp.Status.CONVERGED
    assert result.min_pivot > 0
    np.testing.assert_allclose(abs(result.us), 1.0, atol=0.05)


def test_regularization_limit_is_reported(device):
    dynamics = ddp.linear_system([[0.9]], [[0.3]], device=device)
    problem = ddp.Problem(dynamics, ddp.costs.plain(make_double_well), 5)
    schedule = ddp.Regularization(initial=0.0, maximum=1e-3)
    result = ddp.solve(problem, [0.5], np.full((5, 1), 0.1), ddp.Options(regularization=schedule))
    assert result.status == ddp.Status.REGULARIZATION_LIMIT
    assert not result.K.any() and not result.k.any()
    assert np.isfinite(result.cost)


def test_first_order_gradient_is_exact(device):
    problem, x0, u0 = cart_pole(device)
    result = ddp.solve(problem, x0, u0, ddp.Options(method="first-order", max_iterations=0))
    gradient = central_differences(lambda u: cart_pole_cost(x0, u), u0)
    np.testing.assert_allclose(result.gradient, abs(gradient).max(), rtol=1e-8)
    # (9): the proposed control minimises l + V_x f with V_x fixed; here l_uu = 0.01
    expected = -(gradient + 0.0) / 0.01
    mu = ddp.Regularization().initial
    np.testing.assert_allclose(result.k, expected * 0.01 / (0.01 + mu), rtol=1e-6, atol=1e-8)
    assert not result.K.any()
