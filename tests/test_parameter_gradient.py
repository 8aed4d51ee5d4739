"""Gradients by every column of the parameter table against central differences of rollouts, in float64."""

import numpy as np
import pytest
import warp as wp
from random_scenes import near_contact
from simulators import scene, simulator
from test_tape import loss_of, on_device

import slcp_warp as slcp

WORLDS, STEPS, EPS = 12, 3, 1e-6
CASES = (
    ("flicking_finger", "none", "rem-logistic"),  # revolute joints, ellipses, limits
    ("touching_tree", "inertia", "rem-logistic"),  # free and prismatic joints, all offsets, a fixed plane
    ("sprung_plane", "inertia", "hard"),  # a plane that turns on a spring, discs, friction in both orders
)


def start(name):
    rng = np.random.default_rng(3)
    s = scene(name)
    x0 = near_contact(s, rng, WORLDS, gaps=(0.0, 0.005, -0.02), spread=0.3)
    us = rng.standard_normal((WORLDS, STEPS, s.nu))
    weight = rng.standard_normal((WORLDS, STEPS + 1, 2 * s.nv))
    return x0, us, weight, rng.standard_normal((WORLDS, s.structure.nb, 3))


def by_world(params):
    """The same parameters as one row per world."""
    return params.replace(
        **{name: np.broadcast_to(params[name], (WORLDS, *params[name].shape)) for name in params.names}
    )


def gradient(sim, params, x0, us, weight, force):
    device = sim.device
    params = params.track()
    with wp.Tape() as tape:
        traj = sim.rollout(on_device(x0, device, False), on_device(us, device, False), params,
                           external_force=on_device(force, device, False))  # fmt: skip
        loss = loss_of(traj.states, weight, device)
    tape.backward(loss)
    assert not traj.status.numpy().any()
    return params


@pytest.mark.slow
@pytest.mark.parametrize("name, scaling, residual", CASES)
def test_every_column(device, name, scaling, residual):
    sim = simulator(name, device, wp.float64, scaling, residual)
    x0, us, weight, force = start(name)
    params = by_world(sim.params)
    tracked = gradient(sim, params, x0, us, weight, force)

    def losses(**changes):
        traj = sim.rollout(x0, us, params.replace(**changes), external_force=force)
        return (traj.states * weight).sum((1, 2))

    checked = 0
    for column in sim.params.names:
        if column == "sigma" and residual == "hard":
            assert not tracked.gradient(column).any()
            continue
        exact = tracked.gradient(column)
        for at in np.ndindex(*sim.params.layout.shape(column)):
            if column == "shape_angle" and not scene(name).structure.shapes[at[0]].turned:
                continue
            if column in ("friction", "radius") and not params[column][(0, *at)]:
                continue  # a pair without friction, a half-plane
            change = np.zeros_like(params[column])
            change[(slice(None), *at)] = EPS
            slope = losses(**{column: params[column] + change}) - losses(**{column: params[column] - change})
            slope /= 2.0 * EPS
            size = 1.0 + np.abs(slope).max()
            np.testing.assert_allclose(exact[(slice(None), *at)], slope, atol=2e-6 * size, err_msg=column)
            checked += slope.any()
    assert checked > 25  # most columns matter in these scenes


@pytest.mark.slow
def test_shared_parameters_collect_the_sum_and_forget_it(device):
    sim = simulator("flicking_finger", device, wp.float64, "none")
    data = start("flicking_finger")
    each = gradient(sim, by_world(sim.params), *data).gradient("mass")
    shared = gradient(sim, sim.params, *data)
    np.testing.assert_allclose(shared.gradient("mass"), each.sum(0), rtol=1e-10)
    shared.zero_gradient()
    assert not shared.gradient("mass").any()


def test_errors_name_what_is_needed():
    spring = simulator("sprung")
    with wp.Tape(), pytest.raises(slcp.OptionError, match="neither for springs"):
        spring.rollout(scene("sprung").x0, np.zeros((1, spring.nu)), spring.params.track())
    params = simulator("flicking_finger").params
    with pytest.raises(slcp.ParameterError, match="not tracked"):
        params.gradient("mass")
    with pytest.raises(slcp.ParameterError, match="no parameter 'weight'"):
        params.track().gradient("weight")
    with pytest.raises(slcp.ParameterError, match="built with the angle 0"):
        params.replace(shape_angle=0.1)
