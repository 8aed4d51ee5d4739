"""Sampled controls: splines, what is drawn, the three updates, and what comes of them."""

import numpy as np
import pytest
import scipy.interpolate
from ddp_examples import cart_pole, random_linear_problem

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.sampling.spline import SPLINES, spline_weights

METHODS = ("predictive", "cem", "mppi")


def curve(kind, horizon, knots):
    """Values (N,) of the spline through knots (M,)."""
    first, weights = spline_weights(kind, horizon, len(knots))
    padded = np.append(knots, np.zeros(3))
    return np.array([weights[k] @ padded[first[k] : first[k] + 4] for k in range(horizon)])


@pytest.mark.parametrize("knots", [1, 2, 3, 4, 5, 9])
def test_splines_are_what_scipy_makes_of_the_knots(knots):
    values, N = np.random.default_rng(knots).standard_normal(knots), 41
    at = np.linspace(0.0, 40.0, max(knots, 2))[:knots]
    assert curve("constant", N, values) == pytest.approx(values[np.arange(N) * knots // N])
    for kind in SPLINES:
        assert curve(kind, N, np.ones(knots)) == pytest.approx(np.ones(N))
    if knots == 1:
        return
    assert curve("linear", N, values) == pytest.approx(np.interp(np.arange(N), at, values))
    outer = np.concatenate([values[:1], values, values[-1:]])  # Catmull and Rom: chords of the neighbours
    slopes = (outer[2:] - outer[:-2]) / (2.0 * (at[1] - at[0]))
    smooth = scipy.interpolate.CubicHermiteSpline(at, values, slopes)(np.arange(N))
    assert curve("cubic", N, values) == pytest.approx(smooth)


def searched(problem, x0, us0=None, seed=0, batch=1, **options):
    sampler = ddp.Sampler(problem, batch, ddp.Sampling(**{"samples": 64, "scale": 2.0, **options}))
    sampler.run(x0, us0, seed)
    return sampler


def drawn(sampler):
    """Knots (S, M, nu) and costs (S,) of the first problem's last iteration."""
    rows = sampler._samples.knots.shape[2] - 3
    return sampler._samples.knots.numpy()[0, :, :rows], sampler._samples.cost.numpy()[0]


@pytest.mark.parametrize("method", METHODS)
def test_costs_and_states_are_those_of_the_controls(method):
    problem, x0, _ = cart_pole("cpu", limits=(-4.0, 5.0))
    found = ddp.sample(problem, x0, options=ddp.Sampling(method=method, samples=64, scale=8.0), seed=3)
    again = ddp.solve(problem, x0, found.us, ddp.Options(max_iterations=0))
    assert found.cost == pytest.approx(float(again.cost), rel=1e-12)
    np.testing.assert_allclose(found.xs, again.xs, atol=1e-12)
    assert found.us.min() == -4.0 and found.us.max() == 5.0  # wide noise meets the limits
    assert (np.diff(found.best) <= 0.0).all() and found.best[-1] == found.cost
    nothing = ddp.solve(problem, x0, np.zeros((40, 1)), ddp.Options(max_iterations=0))
    assert found.cost < 0.5 * nothing.cost


def test_what_is_drawn_is_normal_and_addressed_by_the_seed():
    problem, x0, _ = cart_pole("cpu")
    knots, _ = drawn(searched(problem, x0, samples=4002, iterations=1, seed=5))
    assert not knots[:2].any()  # the mean and the best so far
    noise = knots[2:] / 2.0
    assert noise.mean((0, 2)) == pytest.approx(np.zeros(5), abs=0.06)
    assert noise.std((0, 2)) == pytest.approx(np.ones(5), abs=0.05)
    assert np.abs(np.corrcoef(noise[:, :, 0].T) - np.eye(5)).max() < 0.06
    again, other = (drawn(searched(problem, x0, samples=4002, iterations=1, seed=s))[0] for s in (5, 6))
    assert np.array_equal(knots, again) and not np.array_equal(knots[2:], other[2:])


def test_the_next_mean_and_deviation():
    """One iteration of every method, against NumPy."""
    problem, x0, _ = cart_pole("cpu")
    for method in METHODS:
        sampler = searched(problem, x0, method=method, iterations=1, elites=0.25, least=0.0)
        (knots, cost), rows = drawn(sampler), slice(0, 5)
        mean, deviation = (a.numpy()[0, rows] for a in (sampler._samples.mean, sampler._samples.deviation))
        order = np.argsort(cost, kind="stable")
        if method == "predictive":
            expected, wide = knots[order[0]], 0.9 * np.full((5, 1), 2.0)
        elif method == "cem":
            elite = knots[order[:16]]
            expected, wide = elite.mean(0), elite.std(0)
        else:
            weight = np.exp(-(cost - cost.min()) / (0.1 * (cost.mean() - cost.min())))
            expected, wide = np.tensordot(weight / weight.sum(), knots, 1), 0.9 * np.full((5, 1), 2.0)
        np.testing.assert_allclose(mean, expected, atol=1e-12, err_msg=method)
        np.testing.assert_allclose(deviation, wide, atol=1e-12, err_msg=method)


@pytest.mark.parametrize("method", METHODS)
def test_a_warm_start_is_never_worse(method):
    problem, x0, _ = cart_pole("cpu")
    good = ddp.solve(problem, x0)
    found = ddp.sample(problem, x0, good.us, ddp.Sampling(method=method, samples=16, iterations=2, scale=1.0))
    assert found.cost <= good.cost + 1e-12
    np.testing.assert_allclose(found.us, good.us, atol=0.2)


def test_a_batch_is_as_many_singles():
    problem, data = random_linear_problem(2)
    x0 = np.random.default_rng(0).standard_normal((3, 4))
    together = ddp.sample(problem, x0, options=ddp.Sampling(samples=32, iterations=3), seed=9)
    for b in range(3):
        alone = ddp.sample(problem, x0[b], options=ddp.Sampling(samples=32, iterations=3), seed=9)
        assert np.array_equal(together.us[b], alone.us) and together.cost[b] == alone.cost


def test_a_linear_quadratic_problem_is_nearly_solved():
    """With a knot for each step and the elites' own spread the method comes to the minimum."""
    problem, data = random_linear_problem(4, horizon=6)
    best = ddp.solve(problem, data["x0"], np.zeros((6, 2)))
    options = ddp.Sampling(knots=6, spline="constant", samples=400, iterations=40, least=0.0)
    found = ddp.sample(problem, data["x0"], options=options)
    assert best.cost <= found.cost < best.cost + 0.02 * abs(best.cost) + 0.02


def test_rollouts_that_fail_are_left_out():
    """From states that overflow: of all samples none is finite, of a neighbour's all are."""
    problem, x0, _ = cart_pole("cpu")
    wild = np.array([0.0, 0.0, 0.0, 1e200])
    for method in METHODS:
        found = ddp.sample(problem, np.stack([wild, x0]), options=ddp.Sampling(method=method, iterations=3))
        assert np.isinf(found.cost[0]) and np.isfinite(found.cost[1]) and np.isfinite(found.us).all()


@pytest.mark.parametrize(
    "given, text",
    [
        ({"method": "random"}, "method must be one of predictive, cem, mppi; got 'random'"),
        ({"spline": "quintic"}, "spline must be one of"),
        ({"samples": 2}, "samples is 2"),
        ({"iterations": 0}, "iterations is 0"),
        ({"knots": 0}, "knots is 0"),
        ({"elites": 0.0}, "elites"),
        ({"elites": 1.5}, "elites is 1.5; a share of the samples"),
        ({"temperature": -1.0}, "temperature"),
        ({"decay": np.nan}, "decay"),
        ({"least": -0.1}, "least"),
        ({"scale": -1.0}, "scale must be a number of at least 0"),
        ({"scale": [[1.0]]}, "scale must be"),
        ({"scale": (1.0, 2.0)}, r"scale has shape \(2,\); a number or \(1,\)"),
    ],
)
def test_what_cannot_be_sampled(given, text):
    problem, x0, _ = cart_pole("cpu")
    with pytest.raises(slcp.InputError, match=text):
        ddp.sample(problem, x0, options=ddp.Sampling(**given))
    with pytest.raises(slcp.InputError, match="us0 must have shape|u0 must have shape"):
        ddp.sample(problem, x0, np.zeros((3, 1)))
    with pytest.raises(slcp.InputError, match="seed is -1"):
        ddp.sample(problem, x0, seed=-1)
