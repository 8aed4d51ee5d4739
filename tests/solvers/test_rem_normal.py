"""REM with normal noise (footnote 3): what a step solves, its derivatives, rows that are left out."""

import numpy as np
import warp as wp
from differences import differences, states_near_contact
from oracle import Oracle
from scipy.stats import norm
from simulators import scene, simulator

H, SIGMA = 0.05, 0.1


def smooth(z, sigma):
    """The mean of max(z + noise, 0)."""
    return z * norm.cdf(z / sigma) + sigma * norm.pdf(z / sigma)


def finger(device, dtype=wp.float64):
    sim = simulator("flicking_finger", device, dtype, "inertia", "rem-normal")
    x, u = states_near_contact("flicking_finger", 60)
    keep = Oracle(scene("flicking_finger")).problem(x)["margin"] > 0.05
    return sim, sim.params.replace(step_size=H, sigma=SIGMA), x[keep], u[keep]


def test_step_solves_the_problem_of_normal_noise(device):
    sim, params, x, u = finger(device)
    step = sim.step(x, u, params)
    assert (step.status == 0).all()
    problem = Oracle(scene("flicking_finger"), step_size=H).problem(x, u)
    d = problem["D"]
    v = step.state[:, 3:]
    w = problem["rate"] + np.einsum("bij,bj->bi", problem["J"], v)
    assert np.abs(d * step.impulse - smooth(d * step.impulse - w, SIGMA)).max() < 1e-10
    left = np.einsum("bij,bj->bi", problem["M"], v - problem["vfree"])
    np.testing.assert_allclose(left, np.einsum("bij,bi->bj", problem["J"], step.impulse), atol=1e-10)


def test_derivatives_of_first_and_second_order(device):
    sim, params, x, u = finger(device)
    lin = sim.linearize(x, u, params, second=True)
    exact = differences(lambda x, u: sim.step(x, u, params).state, x, u)
    got = np.concatenate([lin.A, lin.B], axis=-1)
    assert (np.abs(got - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))).max() < 1e-6

    def first(x, u):
        lin = sim.linearize(x, u, params, second=True)  # by the kernel that is compiled already
        return np.concatenate([lin.A[:, 3:], lin.B[:, 3:]], axis=-1)

    exact = differences(first, x, u)
    error = np.abs(lin.second - exact).max(axis=(1, 2, 3)) / (1.0 + np.abs(exact).max(axis=(1, 2, 3)))
    assert error.max() < 1e-6


def test_float32_agrees_with_float64(device):
    _, _, x, u = finger(device)
    after = []
    for dtype in (wp.float32, wp.float64):
        sim, params, _, _ = finger(device, dtype)
        step = sim.step(x, u, params)
        assert (step.status == 0).all()
        after.append(step.state)
    np.testing.assert_allclose(after[0], after[1], atol=2e-4)
