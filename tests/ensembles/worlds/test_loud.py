"""Gains that noisy sensors make too loud: what they make of controls, and what is said of it."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ensembles.worlds.loud import noise_of_controls


def task(sensor, limits=(-8.0, 8.0)):
    scene = slcp.Scene(
        "cart",
        (slcp.Body("cart", 1.0, 0.01, joint="prismatic"),),
        actuators=(slcp.Actuator("cart"),),
        step_size=0.01,
    )
    return slcp.Task(
        "hold",
        scene,
        duration=0.1,
        control_limits=limits,
        disturbances=slcp.Disturbances(sensor=sensor),
        measures={"x": slcp.measures.final("cart.shift")},
    )


def test_the_deviation_is_what_drawn_noise_has():
    rng = np.random.default_rng(0)
    K, sd = rng.normal(size=(3, 5, 2, 4)), np.array([0.1, 0.0, 0.3, 0.02])
    drawn = np.einsum("...ij,wj->w...i", K, sd * rng.standard_normal((20000, 4)))
    found = noise_of_controls(SimpleNamespace(K=K), sd)
    np.testing.assert_allclose(found, np.sqrt((drawn**2).mean(axis=(0, 1, 2))), rtol=0.02)
    assert noise_of_controls(SimpleNamespace(K=None), sd) is None
    assert noise_of_controls(object(), sd) is None


@pytest.mark.parametrize("sensor", [{"cart.shift": 0.001}, 0.001])
def test_a_sweep_says_so(sensor):
    """4,000 N/m and a sensor of 1 mm: 4 N of the 8 that there are; a fifth of the gains is no matter."""
    loud, quiet = (slcp.policies.Linear(np.array([[-k, -1.0]])) for k in (4000.0, 800.0))
    with pytest.warns(RuntimeWarning, match=r"policy 'loud'.* 'cart.shift' by 4 \(standard deviation\), 50%"):
        slcp.sweep(task(sensor), {"loud": loud, "quiet": quiet}, worlds=4)
    for told, policy in ((task(sensor), quiet), (task(0.0), loud), (task(sensor, None), loud)):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            slcp.sweep(told, policy, worlds=4)


def test_less_of_a_plans_gains():
    plan = SimpleNamespace(us=np.ones((3, 1)), xs=np.zeros((4, 2)), K=np.full((3, 1, 2), -5.0))
    less, none = (ddp.TrackingPolicy(plan, gain=g) for g in (0.2, 0.0))
    assert (less.K == -1.0).all() and (none.K == 0.0).all() and (ddp.TrackingPolicy(plan).K == -5.0).all()
    run = slcp.Simulator(task(0.0).scene, dtype="float64").rollout([0.5, 0.0], policy=less, steps=1)
    assert run.states[-1, 1] == pytest.approx(0.01 * (1.0 - 0.5), rel=1e-12)
    with pytest.raises(slcp.ArgumentError, match="gain is -1"):
        ddp.TrackingPolicy(plan, gain=-1.0)
