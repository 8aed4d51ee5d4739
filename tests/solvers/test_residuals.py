"""Residual functions against adaptive quadrature of their definitions."""

import numpy as np
import pytest
import warp as wp
from scipy.integrate import quad
from scipy.special import spence
from scipy.stats import logistic, norm, uniform

from slcp_warp.kernels.residual.residuals import make_residuals
from slcp_warp.simulator.residuals import residual

NOISE = {"logistic": logistic(), "normal": norm(), "uniform": uniform(-np.sqrt(3.0), 2.0 * np.sqrt(3.0))}
NAMES = ("rem-logistic", "rem-normal", "erm-logistic", "erm-normal", "erm-uniform")
SMALL = [(10.0, 1e-3, 1e-3), (1e-3, 10.0, 1e-3), (0.3, 0.3, 1e-3), (0.0, 0.0, 1.0), (-0.2, 0.4, 0.1)]
FAR = [(1e3, 1e-3, 1e-3), (1e-3, 1e3, 1e-3), (-1e3, 0.0, 1e-3), (0.0, -1e3, 1e-3)]  # |a - b|/sigma = 1e6


def quadrature(name, a, b, sigma):
    """E[min(a, b + sigma e)^k] by integrating around min = a: exact where the noise ends."""
    kind, noise = name.split("-")
    power, x = {"rem": 1, "erm": 2}[kind], NOISE[noise]
    kink = (a - b) / sigma
    reach = 40.0 if noise == "logistic" else 9.0 if noise == "normal" else np.sqrt(3.0)
    end = min(max(kink, -reach), reach)
    points = np.linspace(-reach, end, 9)
    below = sum(
        quad(lambda e: (b + sigma * e) ** power * x.pdf(e), lo, hi, epsabs=1e-17, epsrel=1e-14)[0]
        for lo, hi in zip(points[:-1], points[1:], strict=True)
    )
    return below + a**power * x.sf(kink)


def samples():
    rng = np.random.default_rng(2)
    random = [(*rng.normal(size=2), 10 ** rng.uniform(-3, 0)) for _ in range(40)]
    near = [(a, a + s * t, s) for a, s, t in zip(rng.normal(size=40), 10 ** rng.uniform(-3, 0, 40),
                                                 rng.uniform(-9, 9, 40), strict=True)]  # fmt: skip
    return np.array(SMALL + FAR + random + near)


@pytest.mark.filterwarnings("ignore::scipy.integrate.IntegrationWarning")
@pytest.mark.parametrize("name", NAMES)
def test_against_quadrature(name):
    a, b, sigma = samples().T
    exact = np.array([quadrature(name, *x) for x in samples()])
    size = np.maximum(np.abs(a), np.abs(b)) if name.startswith("rem") else np.abs(exact)
    error = np.abs(residual(name, a, b, sigma) - exact)
    assert (error / (size + sigma ** (2 if "erm" in name else 1))).max() < 1e-12
    single = np.abs(residual(name, a, b, sigma, dtype="float32") - exact)
    scale = size + sigma ** (2 if "erm" in name else 1)
    if name.startswith("erm"):  # a and b themselves are rounded: what that changes of min(a, b)^2
        scale = scale + np.minimum(np.abs(a), np.abs(b)) * np.maximum(np.abs(a - b), 0.0)
    assert (single / scale).max() < 2e-6


def test_square_of_a_small_number_beside_a_large_one():
    got = residual("erm-normal", 10.0, 1e-3, 1e-3, dtype="float32")
    assert abs(got / 2e-6 - 1.0) < 1e-6  # b^2 + sigma^2, where (15) as printed cancels to 0


def test_functions_without_noise():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 200))
    assert (residual("min", a, b) == np.minimum(a, b)).all()
    exact = a + b - np.hypot(a, b)
    np.testing.assert_allclose(residual("fischer-burmeister", a, b), exact, atol=1e-15)
    tiny = residual("fischer-burmeister", 1e4, 1e-4, dtype="float32")
    assert abs(tiny / 1e-4 - 1.0) < 1e-6


@pytest.mark.parametrize("noise", ["logistic", "normal"])
def test_rem_is_at_most_erm(noise):
    a, b, sigma = samples().T
    rem, erm = (residual(f"{kind}-{noise}", a, b, sigma) for kind in ("rem", "erm"))
    assert (rem**2 <= erm * (1.0 + 1e-12)).all()


def test_dilogarithm_on_both_sides_of_its_inversion(device):
    """Li_2(x) of the standard definition, x <= 0, against scipy's spence(1 - x)."""
    dilogarithm = make_residuals(wp.float64).dilogarithm

    @wp.kernel(module="unique", enable_backward=False)
    def evaluate(x: wp.array(dtype=wp.float64), out: wp.array(dtype=wp.float64)):
        out[wp.tid()] = dilogarithm(x[wp.tid()])

    x = -np.concatenate([[0.0, 1.0], 10.0 ** np.linspace(-8.0, 8.0, 81)])
    out = wp.zeros(len(x), dtype=wp.float64, device=device)
    wp.launch(evaluate, dim=len(x), inputs=[wp.array(x, dtype=wp.float64, device=device), out], device=device)
    np.testing.assert_allclose(out.numpy(), spence(1.0 - x), rtol=1e-13, atol=4e-16)  # 1 - x rounds
