"""Products with derivatives of rollouts against central differences, in float64."""

import concurrent.futures

import numpy as np
import pytest
import warp as wp
from simulators import simulator
from taped import start

import slcp_warp as slcp

EPS = 1e-6


def finger(device):
    return simulator("flicking_finger", device, wp.float64, "none")


def test_jvp_is_a_difference_and_vjp_its_transpose(device):
    sim = finger(device)
    x0, us, weight = start()
    us = us.copy()
    rng = np.random.default_rng(2)
    dx0, dus = rng.standard_normal(x0.shape), rng.standard_normal(us.shape)
    params = sim.params.replace(friction=np.array([0.2, 0.5, 0.9]))
    forward = slcp.jvp(sim, x0, us, dx0, dus, params)
    above = sim.rollout(x0 + EPS * dx0, us + EPS * dus, params).states
    below = sim.rollout(x0 - EPS * dx0, us - EPS * dus, params).states
    difference = (above - below) / (2.0 * EPS)
    size = np.abs(difference).max((1, 2), keepdims=True)
    np.testing.assert_allclose(forward.tangent / size, difference / size, atol=1e-5)
    back = slcp.vjp(sim, x0, us, weight, params, parameters=("friction",))
    np.testing.assert_allclose(
        (back.x0 * dx0).sum(1) + (back.controls * dus).sum((1, 2)),
        (weight * forward.tangent).sum((1, 2)), rtol=1e-9,
    )  # fmt: skip
    shifted = [
        sim.rollout(x0, us, params.replace(friction=params["friction"] + s * EPS)).states for s in (1, -1)
    ]
    by_friction = ((shifted[0] - shifted[1]) / (2.0 * EPS) * weight).sum((1, 2))
    np.testing.assert_allclose(back.parameters["friction"][:, 0], by_friction, rtol=1e-4)


def test_threads_may_pull_back_at_once(device):
    """Warp has one tape at a time: a second thread met "entering a tape while one is already active"."""
    sim, (x0, us, weight) = finger(device), start()
    alone = slcp.vjp(sim, x0, us, weight)
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        for each in pool.map(lambda _: slcp.vjp(sim, x0, us, weight), range(24)):
            np.testing.assert_array_equal(each.x0, alone.x0)
            np.testing.assert_array_equal(each.controls, alone.controls)


@pytest.mark.slow
def test_weighted_hessian_is_the_difference_of_the_weighted_gradient(device):
    sim = finger(device)
    x0, us, _ = start()
    x, u = sim.rollout(x0, us).states[:, 20], us[:, 20]
    weights = np.random.default_rng(4).standard_normal(x.shape)
    hessian, status = slcp.weighted_hessian(sim, x, u, weights)
    assert not status.any()

    def gradient(x, u):
        lin = sim.linearize(x, u)
        return np.einsum("bi,bij->bj", weights, np.concatenate([lin.A, lin.B], 2))

    for j, e in enumerate(EPS * np.eye(8)):
        column = (gradient(x + e[:6], u + e[6:]) - gradient(x - e[:6], u - e[6:])) / (2.0 * EPS)
        np.testing.assert_allclose(hessian[:, j], column, atol=1e-5 * np.abs(hessian).max())


def test_gradients_by_numbers_of_single_parts(device):
    sim = finger(device)
    x0, us, weight = start()
    pair = sim.scene.pair_names[0]
    names = ("mass", "com", "friction", "link2.mass", "link1.com", "link2.com_y", f"{pair}.friction")
    back = slcp.vjp(sim, x0, us, weight, parameters=names).parameters
    bodies = [body.name for body in sim.scene.bodies]
    one, two = bodies.index("link1"), bodies.index("link2")
    assert np.abs(back["mass"][:, two]).min() > 0.0
    np.testing.assert_array_equal(back["link2.mass"], back["mass"][:, two])
    np.testing.assert_array_equal(back["link1.com"], back["com"][:, one])
    np.testing.assert_array_equal(back["link2.com_y"], back["com"][:, two, 1])
    np.testing.assert_array_equal(back[f"{pair}.friction"], back["friction"][:, 0])
    for wrong in ("link3.mass", "link2.weight"):
        with pytest.raises(slcp.ParameterError, match=wrong.replace("link2.", "")):
            slcp.vjp(sim, x0, us, weight, parameters=("mass", wrong))


def test_bad_arguments_are_named(device):
    sim = finger(device)
    x0, us, weight = start()
    with pytest.raises(slcp.ArrayError, match=r"weights has shape \(3, 75, 6\); \(3, 76, 6\) is needed"):
        slcp.vjp(sim, x0, us, weight[:, 1:])
    with pytest.raises(slcp.ArrayError, match=r"controls has shape \(3, 75, 1\); \(3, N, 2\) is needed"):
        slcp.jvp(sim, x0, us[..., :1], x0)
    with pytest.raises(slcp.ParameterError, match="parameters names \\['weight'\\]"):
        slcp.vjp(sim, x0, us, weight, parameters=("weight",))
    with pytest.raises(slcp.ArrayError, match=r"dx0 has shape \(6,\); \(3, 6\) is needed"):
        slcp.jvp(sim, x0, us, x0[0])
