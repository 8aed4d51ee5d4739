"""The racing car: tyres that hold up to mu g, their mean under noise, and plans that keep a distance."""

import functools

import numpy as np
import pytest
import warp as wp

from slcp_warp import ddp
from slcp_warp.kernels.control.racing_car import make_car, make_hairpin
from slcp_warp.scripts.studies import car
from slcp_warp.scripts.studies.car_model import (
    FRICTION,
    GRAVITY,
    HALF_WIDTH,
    RADIUS,
    START,
    STEP_SIZE,
    car_problem,
    cautious_drive,
    drive,
    offset,
    slip,
    with_noise,
)

X = wp.types.vector(5, wp.float64)
U = wp.types.vector(2, wp.float64)
CAR = make_car(wp.float64, X, U).step
HAIRPIN = make_hairpin(wp.float64, X, U).running
MOST = FRICTION * GRAVITY * STEP_SIZE


@wp.kernel(enable_backward=False)
def step_and_cost(
    xs: wp.array2d(dtype=wp.float64),
    us: wp.array2d(dtype=wp.float64),
    params: wp.array2d(dtype=wp.float64),
    weights: wp.array2d(dtype=wp.float64),
    after: wp.array2d(dtype=wp.float64),
    cost: wp.array(dtype=wp.float64),
):
    i = wp.tid()
    x, u = X(), U()
    for j in range(5):
        x[j] = xs[i, j]
    for j in range(2):
        u[j] = us[i, j]
    y = CAR(params, 0, x, u)
    for j in range(5):
        after[i, j] = y[j]
    cost[i] = HAIRPIN(weights, 0, x, u, 0)


def smoothed(x, u, sigma, position_sd=0.1):
    """The Warp step of many cars, and the running cost where they were."""

    def put(a):
        return wp.array(np.ascontiguousarray(a, dtype=float), dtype=wp.float64, device="cpu")

    after, cost = put(np.zeros_like(x)), put(np.zeros(len(x)))
    params, weights = (
        [[STEP_SIZE, FRICTION, sigma, GRAVITY]],
        [[1.0, position_sd, 0.0, 0.0, RADIUS, HALF_WIDTH]],
    )
    wp.launch(step_and_cost, len(x), [put(x), put(u), put(params), put(weights), after, cost], device="cpu")
    return after.numpy(), cost.numpy()


def cars(count, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform([-20, -14, -3, -3, -3], [10, 14, 3, 3, 3], (count, 5))
    return x, rng.uniform([-2, -0.4], [1, 0.4], (count, 2))


def test_smoothed_tyres_tend_to_coulomb_and_never_exceed_their_grip():
    x, u = cars(200)
    sharp, _ = smoothed(x, u, 1e-5)
    np.testing.assert_allclose(sharp, drive(x, u), atol=2e-5)
    free = drive(x, u, friction=0.0)
    for sigma in (0.02, 0.5):
        after, _ = smoothed(x, u, sigma)
        assert np.linalg.norm(after[:, 3:] - free[:, 3:], axis=1).max() <= MOST * (1.0 + 1e-12)


def test_smoothed_impulse_is_the_mean_of_the_hard_one():
    """Against the distribution itself: v_n + noise at the quantiles of the logistic distribution."""
    across, sigma = np.array([-1.0, -0.1, 0.0, 0.05, 0.3, 2.0]), 0.2
    x, u = np.zeros((len(across), 5)), np.zeros((len(across), 2))
    x[:, 0], x[:, 4] = -5.0, across
    impulse = across - smoothed(x, u, sigma)[0][:, 4]
    share = (np.arange(400_000) + 0.5) / 400_000
    noise = sigma * np.log(share / (1.0 - share))
    mean = [np.clip(a + noise, -MOST, MOST).mean() for a in across]
    np.testing.assert_allclose(impulse, mean, atol=1e-7)


def test_wall_costs_the_mean_square_of_what_is_beyond_it():
    x = np.array([[-5.0, 12.3], [-5.0, -12.9], [7.2, 0.0], [0.0, 10.0], [6.0, 11.0]])
    x = np.hstack([x, np.zeros((5, 3))])
    _, cost = smoothed(x, np.zeros((5, 2)), 0.1, position_sd=0.3)
    noise = 0.3 * np.random.default_rng(0).standard_normal(1_000_000)
    beyond = np.abs(offset(x)[:, None] + noise) - HALF_WIDTH
    np.testing.assert_allclose(cost, (np.maximum(beyond, 0.0) ** 2).mean(1), rtol=1e-2, atol=1e-6)


def test_hard_car_rolls_below_the_limit_of_traction_and_slides_above():
    radius = 10.0
    limit = np.sqrt(FRICTION * GRAVITY * radius)
    x = np.array([[0.0, 0.0, 0.0, factor * limit, 0.0] for factor in (0.98, 1.04)])
    for _ in range(10):
        x = drive(x, np.array([[0.0, 1.0 / radius]] * 2))
    assert abs(slip(x)[0]) < 1e-12
    assert abs(slip(x)[1]) > 0.03


@pytest.mark.slow
def test_plan_made_with_noise_keeps_away_from_walls_and_gets_more_cars_through():
    problem = car_problem(0.5, 0.25, "cpu")
    options = ddp.Options(max_iterations=300, gradient_tolerance=1e-4)
    robust = ddp.solve(problem, START, cautious_drive(), options)
    solve = functools.partial(ddp.solve, with_noise(problem, 0.1, 0.05), START, robust.us, options)
    bold = solve(xs0=robust.xs, K0=robust.K)
    assert robust.converged and bold.converged
    margins, shares, calm = [], [], []
    for plan in (robust, bold):
        margins.append((HALF_WIDTH - np.abs(offset(plan.xs))).min())
        shares.append(np.mean(car.outcomes(plan, 500, 1)[1] < car.CRASH))
        calm.append(-car.outcomes(plan, 1, 1, noise=0.0)[0][0, -1, 0])
    assert margins[0] > 0.5 > 0.2 > margins[1]
    assert calm[1] > calm[0] + 3.0  # the bold plan is the faster one where nothing disturbs it
    assert shares[0] > shares[1] + 0.2


@pytest.mark.slow
def test_command_drives_and_draws(tmp_path, monkeypatch):
    typer_testing = pytest.importorskip("typer.testing")
    app = pytest.importorskip("slcp_warp.scripts.app").app
    monkeypatch.setattr(car, "SIGMAS", (0.5, 0.2))
    monkeypatch.setattr(car, "PASSES", 40)
    shown = []
    monkeypatch.setattr(car, "show_rows", lambda title, rows: shown.extend(rows))  # a terminal may be narrow
    arguments = ["car", "--worlds", "20", "--device", "cpu", "--out", str(tmp_path / "car.png")]
    result = typer_testing.CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "0.5 m/s, 0.25 m" in shown[0].values()
    assert (tmp_path / "car.png").stat().st_size > 10_000
