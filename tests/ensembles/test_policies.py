"""Policies against their formulas in NumPy: tracking by time, the norm of the nearest, particles."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.nearest import whitening

FINGER = scene("flicking_finger")
STEPS = 4


def plan(rng, count):
    """Nominal states far from contact, controls and gains: other numbers at every step."""
    xs = np.array([-1.0, -1.0, 0.3, 0.0, 0.0, 0.0]) + 0.05 * rng.standard_normal((count, STEPS + 1, 6))
    us, K = rng.standard_normal((count, STEPS, 2)), rng.standard_normal((count, STEPS, 2, 6))
    return SimpleNamespace(xs=xs, us=us, K=K)


@pytest.mark.parametrize("count", [1, 3])
def test_tracking_follows_its_own_time_and_period(device, count):
    """Step k uses row k, its last row is held, and whole turns of the ellipse do not count."""
    rng = np.random.default_rng(0)
    sim, nominal = simulator("flicking_finger", device, wp.float64, "none"), plan(rng, count)
    x0 = nominal.xs[np.arange(3) % count, 0] + 0.02 * rng.standard_normal((3, 6))
    x0[:, 2] += np.pi * np.array([0, 2, -1])
    policy = ddp.TrackingPolicy(nominal, FINGER.state_period)
    run = sim.rollout(x0, policy=policy, steps=STEPS + 2, record="controls")
    assert not run.status.any()
    for world in range(3):
        row = world % count
        for k in range(STEPS + 2):
            at = min(k, STEPS - 1)
            off = run.states[world, k] - nominal.xs[row, at]
            off[2] -= np.pi * np.round(off[2] / np.pi)
            expected = nominal.us[row, at] + nominal.K[row, at] @ off
            np.testing.assert_allclose(run.controls[world, k], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("metric", ["covariance", "variance"])
def test_the_norm_of_the_nearest_neighbour_is_in_units_of_the_spread(metric, timed):
    """(20): |W dx|^2 = dx' C^-1 dx, with C the covariance of the entries or its diagonal; of entries that
    belong to steps the covariance about the mean of the same step."""
    rng = np.random.default_rng(1)
    x = rng.standard_normal((500, 6)) @ rng.standard_normal((6, 6))
    library = SimpleNamespace(x=x, period=np.zeros(6), step=None)
    covariance = np.cov(x.T)
    if timed:
        library.step = np.repeat([0, 3], 250)
        library.x = x + np.where(library.step == 3, 100.0, 0.0)[:, None]
        halves = (x[:250] - x[:250].mean(axis=0), x[250:] - x[250:].mean(axis=0))
        covariance = sum(half.T @ half for half in halves) / 499
    if metric == "variance":
        covariance = np.diag(np.diag(covariance))
    white = whitening(library, metric)
    for dx in rng.standard_normal((20, 6)):
        assert np.sum((white @ dx) ** 2) == pytest.approx(dx @ np.linalg.solve(covariance, dx), rel=1e-6)


def test_particles_feel_the_noise_that_the_feedback_sees():
    """u = us + K (x - xs) with x after the noise of the step."""
    hard = simulator("flicking_finger", "cpu", wp.float64, "none", "hard")
    rng = np.random.default_rng(2)
    nominal = plan(rng, 1)
    spread = np.diag([0.0] * 3 + [0.01] * 3)
    cloud = slcp.particle_rollout(
        hard, nominal.xs[0, 0], nominal.us[0], covariance=spread, count=2000, xs=nominal.xs[0], K=nominal.K[0]
    )
    noise = np.einsum("ij,jk,lk->il", nominal.K[0, 0], spread, nominal.K[0, 0])
    np.testing.assert_allclose(cloud.controls[:, 0].mean(axis=0), nominal.us[0, 0], atol=0.03)
    found = np.cov(cloud.controls[:, 0].T)  # all start in one state: the first control differs by noise only
    np.testing.assert_allclose(found, noise, atol=0.2 * np.abs(noise).max())
