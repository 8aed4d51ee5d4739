"""Derivatives of costs and of user dynamics against formulas."""

import numpy as np
import pytest
import warp as wp
from ddp_examples import cart_pole, central_differences, make_finite_difference_cost

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.kernels.control.cost_terms import KINDS
from slcp_warp.kernels.control.costs import make_cost_kernel
from slcp_warp.kernels.control.solver_state import make_derivative_arrays
from slcp_warp.kernels.device.launch import launch


def evaluate(cost, xs, us, device, dtype=wp.float64):
    """All cost derivatives along trajectories, as a dict of NumPy arrays."""
    (B, N, nu), nx = us.shape, xs.shape[2]
    out = make_derivative_arrays(dtype)()
    shapes = {
        "lx": (B, N + 1, nx),
        "lu": us.shape,
        "lxx": (B, N + 1, nx, nx),
        "lux": (B, N, nu, nx),
        "luu": (B, N, nu, nu),
    }
    for name, shape in shapes.items():
        setattr(out, name, wp.zeros(shape, dtype=dtype, device=device))
    functions = cost.functions(dtype, nx, nu)
    inner = dtype if functions.running_derivatives is not None else wp.float64
    weights = wp.array(cost.rows(B), dtype=inner, device=device)
    kernel = make_cost_kernel(cost.functions(inner, nx, nu), nx, nu, dtype)
    arrays = [wp.array(a, dtype=dtype, device=device) for a in (xs, us)]
    mask = wp.ones(B, dtype=wp.int32, device=device)
    launch(kernel, B * (N + 1), [*arrays, weights, mask, out], device)
    return {name: getattr(out, name).numpy() for name in shapes}


def test_differences_of_a_cost_in_double_precision(device, dtype):
    rng = np.random.default_rng(0)
    xs, us = rng.normal(size=(2, 4, 2)), rng.normal(size=(2, 3, 1))
    if dtype == wp.float32:
        xs, us = (a.astype(np.float32).astype(float) for a in (xs, us))
    out = evaluate(ddp.costs.plain(make_finite_difference_cost), xs, us, device, dtype)
    relax = 1.0 if dtype == wp.float64 else 1e4
    tolerance_1, tolerance_2 = (max(t, 2e-7 if relax > 1.0 else 0.0) for t in (3e-12, 2e-9))
    x, y, u, t = xs[:, :3, 0], xs[:, :3, 1], us[:, :, 0], 0.1 * np.arange(3)
    s = np.exp(0.5 * np.sin(x))
    ds, dds = 0.5 * np.cos(x) * s, (0.25 * np.cos(x) ** 2 - 0.5 * np.sin(x)) * s
    expected = {
        "lx": [ds * (1 + u * u), u * u - np.sin(y + t) * u],
        "lu": [2 * u * s + np.cos(y + t) + 2 * u * y],
        "luu": [2 * s + 2 * y],
        "lux": [2 * u * ds, 2 * u - np.sin(y + t)],
        "lxx": [dds * (1 + u * u), np.zeros_like(x), np.zeros_like(x), -np.cos(y + t) * u],
    }
    for name, parts in expected.items():
        got = out[name][:, :3].reshape(2, 3, -1)
        tolerance = tolerance_1 if name in ("lx", "lu") else tolerance_2
        np.testing.assert_allclose(got, np.stack(parts, -1), rtol=tolerance, atol=4 * tolerance, err_msg=name)
    x, y = xs[:, 3, 0], xs[:, 3, 1]
    slope = np.stack([np.cos(x) * y * y, 2 * np.sin(x) * y], -1)
    bend = np.stack([-np.sin(x) * y * y, 2 * np.cos(x) * y, 2 * np.cos(x) * y, 2 * np.sin(x)], -1)
    np.testing.assert_allclose(out["lx"][:, 3], slope, rtol=tolerance_1, atol=4 * tolerance_1)
    np.testing.assert_allclose(out["lxx"][:, 3].reshape(2, 4), bend, rtol=tolerance_2, atol=4 * tolerance_2)


GOAL = 1.0


def make_globally(dtype, VX, VU):
    """To GOAL, as it is when the functions are made."""
    goal = dtype(GOAL)

    @wp.func
    def running(x: VX, u: VU, k: int):
        return dtype(0.01) * u[0] * u[0]

    @wp.func
    def final(x: VX):
        return (x[0] - goal) * (x[0] - goal)

    return running, final


def make_drift(dtype, VX, VU):
    """By GOAL a step."""
    drift = dtype(GOAL)

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        return VX(x[0] + u[0] + drift)

    return step


def test_a_maker_sees_a_global_that_has_changed(device, monkeypatch):
    """As in a notebook whose cells are run again; costs, samples and dynamics kept the first value."""
    moves = ddp.linear_system([[1.0]], [[1.0]], device=device)
    cost = ddp.costs.plain(make_globally)
    for goal in (1.0, 4.0, 1.0):
        monkeypatch.setitem(globals(), "GOAL", goal)
        plan = ddp.solve(ddp.Problem(moves, cost, 3), np.zeros(1), np.zeros((3, 1)))
        assert plan.xs[-1, 0] == pytest.approx(goal / (1.0 + 0.01 / 3.0), rel=1e-6)
        drifts = ddp.Problem(ddp.WarpDynamics(make_drift, 1, 1, device=device), cost, 3)
        still = ddp.solve(drifts, np.zeros(1), np.zeros((3, 1)), ddp.Options(max_iterations=0))
        assert still.xs[-1, 0] == 3.0 * goal


@pytest.mark.parametrize("style", ["values", "functions"])
def test_costs_that_differ_by_what_a_loop_looks_up_are_told_apart(device, style):
    """The same source with other `wp.static` values: Warp's own hash is the same, the kernel must not be."""

    def make_cost(weights):
        def make(dtype, VX, VU):
            def make_term(weight):
                @wp.func
                def term(y: dtype):
                    return dtype(weight) * y * y

                return term

            values, terms = tuple(dtype(w) for w in weights), tuple(make_term(w) for w in weights)

            @wp.func
            def running(x: VX, u: VU, k: int):
                total = u[0] * u[0]
                for i in range(2):
                    if wp.static(style == "values"):
                        total += wp.static(values[i]) * x[i] * x[i]
                    else:
                        total += wp.static(terms[i])(x[i])
                return total

            return running, None

        return ddp.costs.plain(make)

    rng = np.random.default_rng(2)
    xs, us = rng.normal(size=(1, 3, 2)), rng.normal(size=(1, 2, 1))
    for weights in ((1.0, 2.0), (1.0, 3.0), (4.0, 3.0)):
        lx = evaluate(make_cost(weights), xs, us, device)["lx"]
        np.testing.assert_allclose(lx[:, :2], 2.0 * np.array(weights) * xs[:, :2], rtol=1e-10)


def test_flicking_finger_cost_of_section_v(device, dtype):
    rng = np.random.default_rng(1)
    xs, us = rng.normal(size=(1, 3, 6)), rng.normal(size=(1, 2, 2))
    out = evaluate(slcp.tasks.flicking_finger(2.0, 0.3).cost, xs, us, device, dtype)
    np.testing.assert_allclose(out["lx"][0, :2], [[0, 0, -2.0, 0, 0, 0]] * 2, rtol=1e-6)
    np.testing.assert_allclose(out["lu"], 0.6 * us, rtol=1e-6)
    np.testing.assert_allclose(out["luu"][0], [0.6 * np.eye(2)] * 2, rtol=1e-6)
    for name in ("lxx", "lux"):
        assert not out[name].any()
    assert not out["lx"][0, 2].any()


def test_costs_of_named_tasks_go_on_by_their_names_of_before():
    with pytest.warns(DeprecationWarning, match="is slcp_warp.tasks.flicking_finger.*cost now"):
        cost = ddp.costs.flicking_finger(2.0, c_u=0.3)
    same = slcp.tasks.flicking_finger(2.0, 0.3).cost
    assert cost.make is same.make and np.array_equal(cost.weights, same.weights)
    with pytest.warns(DeprecationWarning):
        assert ddp.costs.catch().nx == 10
    with pytest.raises(AttributeError, match="no attribute 'catches'"):
        ddp.costs.catches  # noqa: B018


def test_flicking_finger_cost_value(device):
    dynamics = ddp.linear_system(np.eye(6) + np.diag([0.05] * 3, 3), np.zeros((6, 2)), device=device)
    problem = ddp.Problem(dynamics, slcp.tasks.flicking_finger().cost, 10)
    u0 = np.full((10, 2), 0.5)
    result = ddp.solve(
        problem, [0, 0, 1.0, 0, 0, 2.0], u0, ddp.Options(max_iterations=0, method="first-order")
    )
    theta_3 = 1.0 + 0.1 * np.arange(10)  # the last state costs nothing
    np.testing.assert_allclose(result.cost, -theta_3.sum() + 0.05 * 10 * 0.5, rtol=1e-13)


def test_quadratic_cost_with_a_moving_target(device):
    rng = np.random.default_rng(2)
    Q, R, Qf = np.diag([1.0, 2.0]), np.array([[3.0]]), np.array([[2.0, 0.5], [0.5, 1.0]])
    target = rng.normal(size=(4, 2))
    xs, us = rng.normal(size=(1, 4, 2)), rng.normal(size=(1, 3, 1))
    out = evaluate(ddp.costs.quadratic(Q, R, Qf, target), xs, us, device)
    np.testing.assert_allclose(out["lx"][0, :3], (xs[0, :3] - target[:3]) @ Q, atol=1e-14)
    np.testing.assert_allclose(out["lx"][0, 3], (xs[0, 3] - target[3]) @ Qf, atol=1e-14)
    np.testing.assert_allclose(out["lu"], 3.0 * us, atol=1e-14)
    np.testing.assert_array_equal(out["lxx"][0, 3], Qf)


def test_differences_of_user_dynamics(device, dtype):
    problem, _, _ = cart_pole(device, dtype)
    rng = np.random.default_rng(3)
    xs, us = rng.normal(size=(2, 3, 4)), rng.normal(size=(2, 2, 1))
    if dtype == wp.float32:
        xs, us = (a.astype(np.float32).astype(float) for a in (xs, us))
    d = problem.dynamics
    shapes = [(2, 2, 4, 4), (2, 2, 4, 1), (4, 4, 5, 5)]
    fx, fu, second = (wp.zeros(s, dtype=dtype, device=device) for s in shapes)
    arrays = [wp.array(a, dtype=dtype, device=device) for a in (xs, us)]
    status = wp.full((2, 2), -1, dtype=wp.int32, device=device)
    mask = wp.array([1, 0], dtype=wp.int32, device=device)
    d.linearize_into(*arrays, problem.params.array(2), fx, fu, second, status, mask)
    assert not status.numpy()[0].any()
    assert (status.numpy()[1] == -1).all() and not fx.numpy()[1].any()  # masked

    def step(z):
        x, (u,), h = z[:4], z[4:], float(np.float32(0.05)) if dtype == wp.float32 else 0.05
        s, c = np.sin(x[1]), np.cos(x[1])
        push = (u + 0.05 * x[3] ** 2 * s) / 1.1
        turn = (9.81 * s - c * push) / (0.5 * (4.0 / 3.0 - 0.1 * c * c / 1.1))
        return x + h * np.array([x[2], x[3], push - 0.05 * turn * c / 1.1, turn])

    rough = 1e-6 if dtype == wp.float32 else 0.0
    for k in range(2):
        z = np.concatenate([xs[0, k], us[0, k]])
        for i in range(4):
            gradient = central_differences(lambda y, i=i: step(y)[i], z, 1e-3)
            np.testing.assert_allclose(
                np.append(fx.numpy()[0, k, i], fu.numpy()[0, k, i]), gradient, atol=1e-10 + rough
            )
            hessian = [
                central_differences(
                    lambda y, i=i, j=j: central_differences(lambda w: step(w)[i], y, 3e-3)[j], z, 3e-3
                )
                for j in range(5)
            ]
            np.testing.assert_allclose(second.numpy()[k, i], hessian, atol=1e-8 + rough)


def test_numbers_of_user_dynamics_stay_on_the_device(device, monkeypatch):
    """Differences in double precision follow a problem's numbers in single; nothing waits for them."""
    problem, _, _ = cart_pole(device, "float32")
    rng = np.random.default_rng(3)
    xs, us = (
        wp.array(a, dtype=wp.float32, device=device)
        for a in (rng.normal(size=(1, 3, 4)), rng.normal(size=(1, 2, 1)))
    )
    shapes = [(1, 2, 4, 4), (1, 2, 4, 1), (2, 4, 5, 5)]
    fx, fu, second = (wp.zeros(s, dtype=wp.float32, device=device) for s in shapes)
    status, all_of_them = (wp.ones(s, dtype=wp.int32, device=device) for s in ((1, 2), 1))
    params = problem.params.array(1)
    run = problem.dynamics.prepare_linearize(xs, us, params, fx, fu, second, status, all_of_them)
    run()
    before = fu.numpy().copy()
    halved = wp.array(0.5 * params.numpy(), dtype=wp.float32, device=device)
    wp.copy(params, halved)
    with monkeypatch.context() as patch:
        for name in ("numpy", "assign"):
            patch.setattr(wp.array, name, lambda *_: pytest.fail("copied over the host"))
        run()
    np.testing.assert_allclose(fu.numpy()[..., 3, :], 0.5 * before[..., 3, :], rtol=1e-5)


def test_illegal_costs():
    with pytest.raises(ValueError, match=r"R must be a symmetric matrix \(1, 1\), got shape \(1, 2\)"):
        ddp.costs.quadratic(np.eye(3), [[1.0, 2.0]])
    with pytest.raises(ValueError, match=r"R must be symmetric, got R\[0, 1\] = 2 and R\[1, 0\] = 0"):
        ddp.costs.quadratic(np.eye(3), [[1.0, 2.0], [0.0, 1.0]])
    with pytest.raises(ValueError, match=r"target must have shape \(3,\) or \(N\+1, 3\), got \(2,\)"):
        ddp.costs.quadratic(np.eye(3), np.eye(2), target=[0.0, 1.0])
    with pytest.raises(ValueError, match="c_x is nan; a finite number is needed"):
        slcp.tasks.flicking_finger(c_x=float("nan"))
    with pytest.raises(ValueError, match="weights must be finite numbers"):
        slcp.tasks.flicking_finger().cost.with_weights([1.0, float("nan")])
    with pytest.raises(ValueError, match="weights must have 19 columns, got 3"):
        slcp.tasks.flicking_finger().cost.with_weights([1.0, 2.0, 3.0])
    cost = slcp.tasks.flicking_finger().cost
    with pytest.raises(ValueError, match=r"weights\[\.\.\., 0\] is .*; it says what other weights are of"):
        cost.with_weights(2.0 * cost.weights)  # places of states are among them
    twice = cost.with_weights(np.tile((2.0 - cost.fixed) * cost.weights, (3, 1)))
    assert twice.rows(3).shape == (3, 19)
    np.testing.assert_array_equal(twice.weights[1][~cost.fixed], 2.0 * cost.weights[~cost.fixed])
    with pytest.raises(TypeError, match="must return costs.CostFunctions, got tuple"):
        ddp.Cost(make_finite_difference_cost).functions(wp.float64, 2, 1)


def expected_term(term: slcp.costs.Term, s: float) -> float:
    """A term by its formula."""
    e = s - term.target
    value = {
        "linear": e,
        "square": e**2,
        "cosine": 1.0 - np.cos(e),
        "absolute": np.hypot(e, term.width) - term.width,
        "above": max(e, 0.0) ** 2,
        "below": min(e, 0.0) ** 2,
    }[term.kind]
    return term.weight * value


SHIFTED = {"weight": 1.3, "target": 0.2, "width": 0.4}
RUNNING = [slcp.costs.Term(kind, state="cart.shift", **SHIFTED) for kind in KINDS]
RUNNING += [slcp.costs.Term("cosine", 0.9, state="pole.angle", minus="cart.vshift", target=0.1)]
RUNNING += [slcp.costs.Term("above", 0.7, control="cart.shift", target=-0.5), slcp.costs.effort(0.05)]
RUNNING += [
    slcp.costs.Term(kind, 0.6, control="cart.shift", minus=less, target=0.1, width=0.3)
    for kind, less in (("square", "cart.shift"), ("absolute", "pole.angle"), ("cosine", "cart.shift"))
]
FINAL = [slcp.costs.Term("cosine", 3.0, state="pole.angle", target=1.0), RUNNING[3]]


def component(term: slcp.costs.Term, x: np.ndarray, u: np.ndarray) -> float:
    """What a term of the cart-pole is a function of."""
    places = {"cart.shift": 0, "pole.angle": 1, "cart.vshift": 2}
    value = u[0] if term.state is None else x[places[term.state]]
    return value - (0.0 if term.minus is None else x[places[term.minus]])


def test_terms_are_their_formulas(device):
    """The cost of a plan, and its derivatives by differences of the formulas."""
    scene = slcp.scenes.cart_pole()
    cost = slcp.costs.terms(scene, RUNNING, FINAL)
    rng = np.random.default_rng(5)
    xs, us = rng.normal(size=(1, 9, 4)), rng.normal(size=(1, 8, 1))
    out = evaluate(cost, xs, us, device)

    def value(x, u, group):
        return sum(expected_term(t, component(t, x, u)) for t in group)

    for k in range(9):
        group, u = (FINAL, np.zeros(1)) if k == 8 else (RUNNING, us[0, k])
        for j in range(4):
            d = 1e-4 * np.eye(4)[j]
            low, middle, high = (value(xs[0, k] + s * d, u, group) for s in (-1.0, 0.0, 1.0))
            assert out["lx"][0, k, j] == pytest.approx((high - low) / 2e-4, abs=1e-7)
            assert out["lxx"][0, k, j, j] == pytest.approx((high - 2.0 * middle + low) / 1e-8, abs=1e-5)
            for i in range(j):
                e = 1e-4 * np.eye(4)[i]
                corners = (
                    a * b * value(xs[0, k] + a * d + b * e, u, group) for a in (-1, 1) for b in (-1, 1)
                )
                mixed = sum(corners) / 4e-8
                assert out["lxx"][0, k, i, j] == pytest.approx(mixed, abs=1e-5)
                assert out["lxx"][0, k, j, i] == out["lxx"][0, k, i, j]
        if k < 8:
            low, middle, high = (value(xs[0, k], u + s * 1e-4, group) for s in (-1.0, 0.0, 1.0))
            assert out["lu"][0, k, 0] == pytest.approx((high - low) / 2e-4, abs=1e-7)
            assert out["luu"][0, k, 0, 0] == pytest.approx((high - 2.0 * middle + low) / 1e-8, abs=1e-5)
            for j in range(4):
                d = 1e-4 * np.eye(4)[j]
                mixed = sum(
                    a * b * value(xs[0, k] + a * d, u + b * 1e-4, group) for a in (-1, 1) for b in (-1, 1)
                )
                assert out["lux"][0, k, 0, j] == pytest.approx(mixed / 4e-8, abs=1e-5)


def test_the_value_of_terms_is_their_sum_over_a_plan(device):
    dynamics = ddp.linear_system(np.eye(4) + np.diag([0.05] * 2, 2), np.zeros((4, 1)), device=device)
    cost = slcp.costs.terms(slcp.scenes.cart_pole(), RUNNING, FINAL)
    x0, us = np.array([0.4, -0.2, 1.0, 2.0]), np.linspace(-1.0, 1.0, 10)[:, None]
    options = ddp.Options(max_iterations=0, method="first-order")
    result = ddp.solve(ddp.Problem(dynamics, cost, 10), x0, us, options)
    expected = 0.0
    for k in range(10):
        x = np.array([0.4 + 0.05 * k * 1.0, -0.2 + 0.05 * k * 2.0, 1.0, 2.0])
        expected += sum(expected_term(t, component(t, x, us[k])) for t in RUNNING)
    expected += expected_term(FINAL[0], -0.2 + 1.0) + expected_term(FINAL[1], 0.9)
    np.testing.assert_allclose(result.cost, expected, rtol=1e-13)


@pytest.mark.parametrize(
    "make, text",
    [
        (lambda s: [slcp.costs.Term("cubic", 1.0, state=0)], "Term.kind is 'cubic'"),
        (lambda s: [slcp.costs.Term("square", 1.0)], "one of them is needed"),
        (lambda s: [slcp.costs.Term("square", 1.0, state=0, control=0)], "one of them is needed"),
        (lambda s: [slcp.costs.Term("square", float("nan"), state=0)], "Term.weight"),
        (lambda s: [slcp.costs.Term("absolute", 1.0, state=0, width=0.0)], "Term.width"),
        (lambda s: [slcp.costs.Term("square", 1.0, state="block.x")], r"running\[0\].state is 'block.x'"),
        (lambda s: [slcp.costs.Term("square", 1.0, control=1)], r"running\[0\].control is 1"),
        (lambda s: [slcp.costs.Term("square", 1.0, control="all", minus=0)], "minus is 0 of all controls"),
        (lambda s: [slcp.costs.Term("square", 1.0, control=0, minus="a")], r"running\[0\].minus is 'a'"),
        (lambda s: [slcp.costs.Term("square", 1.0, state=0, minus="a")], r"running\[0\].minus is 'a'"),
        (lambda s: [], "at least one is needed"),
        (lambda s: "square", "a list of costs.Term is needed"),
    ],
)
def test_terms_that_make_no_cost(make, text):
    with pytest.raises(slcp.InputError, match=text):
        slcp.costs.terms(slcp.scenes.cart_pole(), make(0))


def test_a_final_term_has_no_control():
    with pytest.raises(slcp.InputError, match="no control follows the last state"):
        slcp.costs.terms(slcp.scenes.cart_pole(), RUNNING, [slcp.costs.effort(1.0)])
