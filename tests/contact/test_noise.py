"""Noise of the state mapped to the rows, eq. (18): levels, meaning of sigma, derivatives, vanishing rows."""

import numpy as np
import pytest
import warp as wp
from differences import GAPS, differences
from oracle import Oracle, residual
from random_scenes import near_contact
from simulators import scene

import slcp_warp as slcp
from slcp_warp.kernels.residual.noise import FLOOR

RATIO = np.sqrt(3.0) / np.pi
POSITION = 1e-5 * np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 2.0]])
VELOCITY = 1e-2 * np.array([[1.0, 0.3, 0.0], [0.3, 2.0, -0.5], [0.0, -0.5, 1.0]])
H = 0.05


@pytest.fixture
def finger(device):
    options = slcp.Options(noise="state")
    return slcp.Simulator(scene("flicking_finger"), options, device=device)


@pytest.fixture
def params(finger):
    return finger.params.replace(step_size=H, position_covariance=POSITION, velocity_covariance=VELOCITY)


@pytest.fixture
def states(finger):
    rng = np.random.default_rng(3)
    x = near_contact(scene("flicking_finger"), rng, 60, GAPS, spread=0.4)
    return x, rng.standard_normal((60, 2))


def test_step_solves_the_problem_with_the_mapped_levels(finger, params, states):
    x, u = states
    step = finger.step(x, u, params)
    oracle = Oracle(scene("flicking_finger"), step_size=H)
    problem = oracle.problem(x, u)
    spread = POSITION / H**2 + VELOCITY
    deviation = np.sqrt(np.einsum("bij,jk,bik->bi", problem["J"], spread, problem["J"]))
    problem["sigma"] = RATIO * deviation
    assert (step.status == 0).all()
    r1, r2 = residual(problem, step.state[:, 3:], step.impulse)
    sure = problem["margin"] > 1e-3
    assert np.abs(r1[sure]).max() < 1e-10 and np.abs(r2[sure]).max() < 1e-10
    problem["sigma"] = deviation
    assert np.abs(residual(problem, step.state[:, 3:], step.impulse)[1]).max() > 1e-3


def test_derivatives_follow_sigma_through_the_jacobian(finger, params, states):
    x, u = states
    keep = Oracle(scene("flicking_finger")).problem(x)["margin"] > 0.05
    x, u = x[keep], u[keep]
    lin = finger.linearize(x, u, params)
    exact = differences(lambda x, u: finger.step(x, u, params).state, x, u)
    got = np.concatenate([lin.A, lin.B], axis=-1)
    assert (np.abs(got - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))).max() < 1e-6


def test_standard_deviation_is_the_scale_times_pi_over_root_three(device):
    sc = scene("ball_drop")
    x = np.array([0.0, 0.102, 0.3, 0.4, -0.3, 0.1])  # inside the layer, where sigma shows
    scale = slcp.Simulator(sc, slcp.Options(deviation="scale"), device=device)
    spread = slcp.Simulator(sc, slcp.Options(deviation="standard-deviation"), device=device)
    one = scale.step(x, None, scale.params.replace(sigma=RATIO * 0.2)).state
    two = spread.step(x, None, spread.params.replace(sigma=0.2)).state
    np.testing.assert_allclose(one, two, atol=1e-13)
    assert np.abs(scale.step(x, None, scale.params.replace(sigma=0.2)).state - two).max() > 1e-3
    assert slcp.Options(noise="state").method.converts and not slcp.Options().method.converts


def test_row_whose_jacobian_vanishes_stays_regular(device):
    """A slider across the contact's normal: J -> 0, so do D and sigma, and the change of v stays finite.

    With a constant sigma the same rows throw it: dv ~ sigma log 2/|J|.
    """
    body = slcp.Body("slider", 1.0, 0.1, joint="prismatic", axis=(1.0, 0.0))
    shapes = (
        slcp.Shape("tip", "slider", "disc", 0.1),
        slcp.Shape("floor", None, "halfplane", angle=np.pi / 2),
    )
    sc = slcp.Scene("across", (body,), shapes, (slcp.Contact("floor", "tip"),), gravity=(0.0, 0.0))
    tilts = np.array([1e-1, 1e-2, 1e-3, 1e-4])
    axis = np.stack([np.cos(tilts), np.sin(tilts)], -1)[:, None, :]
    change = {}
    for noise in ("row", "state"):
        sim = slcp.Simulator(sc, slcp.Options(noise=noise, deviation="scale"), device=device)
        level = {"sigma": 0.1} if noise == "row" else {"velocity_covariance": 0.01}
        p = sim.params.replace(step_size=0.01, axis=axis, anchor=np.array([[[0.0, 0.1]]] * 4), **level)
        step = sim.step(np.zeros((4, 2)), None, p)
        assert (step.status == 0).all()
        assert noise == "row" or np.isfinite(sim.linearize(np.zeros((4, 2)), None, p).A).all()
        change[noise] = step.state[:, 1]
    level = np.sqrt((0.1 * np.sin(tilts)) ** 2 + FLOOR**2)  # the floor shows only where |J| < 1e-4
    np.testing.assert_allclose(change["state"], level * np.log(2.0) / np.sin(tilts), rtol=1e-9)
    np.testing.assert_allclose(change["state"], 0.1 * np.log(2.0), rtol=6e-3)
    np.testing.assert_allclose(change["row"], 0.1 * np.log(2.0) / np.sin(tilts), rtol=1e-9)


@pytest.mark.parametrize(
    "value,words",
    [
        (np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]), "not symmetric"),
        (-np.eye(3), "eigenvalue"),
        (np.zeros((2, 2)), "shape"),
    ],
)
def test_bad_covariances(finger, value, words):
    with pytest.raises(slcp.ParameterError, match=words):
        finger.params.replace(velocity_covariance=value)


def test_noise_of_the_state_needs_a_residual_with_noise():
    with pytest.raises(slcp.OptionError, match="has no noise"):
        slcp.Options(noise="state", residual="hard")


def test_covariances_belong_to_noise_of_the_state(device):
    sim = slcp.Simulator(scene("flicking_finger"), device=device, dtype="float32")
    assert sim.dtype is wp.float32
    with pytest.raises(slcp.ParameterError, match="velocity_covariance"):
        sim.params.replace(velocity_covariance=0.1)
