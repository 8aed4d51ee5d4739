"""Gradients by every column of the parameter table against central differences of rollouts, in float64."""

import dataclasses

import numpy as np
import pytest
import warp as wp
from parameter_checks import acts, alike, check, crane, errors, hub, jib, smooth, states
from random_scenes import near_contact
from simulators import scene, simulator
from taped import loss_of, on_device

import slcp_warp as slcp
from slcp_warp import Actuator

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


def damped(params):
    """The same with some damping everywhere: less than none is refused, so there is no difference at 0."""
    return params.replace(damping=np.maximum(params["damping"], 0.05))


def by_world(params):
    """Parameters as one row per world."""
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
    params = by_world(damped(sim.params))
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
            if not acts(scene(name), column, at[0] if at else 0):
                assert column == "shape_angle" or not exact[:, at[0]].any()
                continue
            if column == "radius" and not params[column][(0, *at)]:
                continue  # a half-plane
            change = np.zeros_like(params[column])
            together = alike(scene(name), column, at)
            for entry in together:
                change[(slice(None), *entry)] = EPS
            slope = losses(**{column: params[column] + change}) - losses(**{column: params[column] - change})
            slope /= 2.0 * EPS
            size = 1.0 + np.abs(slope).max()
            found = sum(exact[(slice(None), *entry)] for entry in together)
            np.testing.assert_allclose(found, slope, atol=2e-6 * size, err_msg=column)
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


def coulomb_modes(sc):
    """Of every row of a rollout's first step: off, pressing or sticking, sliding to either side."""

    def modes(traj, params):
        lam = traj.impulse[:, 0]
        out = (lam > 0.0).astype(int)
        for i, row in enumerate(sc.structure.rows):
            if row.kind == "contact" and row.sign < 0:
                bound = np.broadcast_to(params["friction"], (len(lam), len(sc.contacts)))[:, row.index]
                bound = bound * lam[:, i - 1] * (1.0 - 1e-9)
                out[:, i] = np.where(
                    lam[:, i - 1] > 0.0, 1 + (lam[:, i] > bound) + 2 * (lam[:, i] < -bound), 0
                )
        return out

    return modes


def rubbing():
    """`sprung_plane` driven against a limit."""
    base = scene("sprung_plane")
    plate = dataclasses.replace(base.bodies[0], lower=-0.1)
    return dataclasses.replace(base, name="rubbing", bodies=(plate, *base.bodies[1:]),
                               actuators=(Actuator("plate", gear=2.0),))  # fmt: skip


@pytest.mark.slow
def test_coulomb_friction(device):
    sc = rubbing()
    options = slcp.Options(residual="hard", friction="coulomb")
    sim = slcp.Simulator(sc, options, device=device, dtype="float64")
    x, u, force = states(sc, 120)
    x[::2, sc.nv :] *= 0.05  # slow ones stick
    modes = coulomb_modes(sc)
    here = modes(sim.rollout(x, u[:, None], external_force=force, record="impulse"), sim.params)
    assert (here[:, 0] == 1).any()  # the limit
    friction = [i for i, row in enumerate(sc.structure.rows) if row.kind == "contact" and row.sign < 0]
    assert set(here[:, friction].ravel()) == {0, 1, 2, 3}  # off, sticking, sliding to either side
    check(errors(sim, x, u, damped(sim.params), force, modes))


@pytest.mark.full
@pytest.mark.parametrize("make, pushed_rows", [(crane, 5), (jib, 5), (hub, 4)])
def test_springs_shapes_with_sides_and_noise_of_the_state(device, make, pushed_rows):
    sc = make()
    sim = slcp.Simulator(sc, slcp.Options(noise="state"), device=device, dtype="float64")
    spread = np.eye(sc.nv) + np.array([[0.0, 0.3, -0.2], [0.3, 0.0, 0.1], [-0.2, 0.1, 0.5]])
    params = damped(sim.params).replace(position_covariance=1e-6 * spread, velocity_covariance=0.01 * spread)
    x, u, force = states(sc, 60)
    pushed = sim.rollout(x, u[:, None], params, external_force=force, record="impulse").impulse > 1e-2
    assert pushed.any((0, 1)).sum() >= pushed_rows
    check(errors(sim, x, u, params, force, smooth))


def test_errors_name_what_is_needed():
    late = slcp.Simulator(scene("particle"), slcp.Options(residual="hard", gap="end"))
    with wp.Tape(), pytest.raises(slcp.OptionError, match="'end', which has no derivatives"):
        late.rollout(late.scene.x0, np.zeros((1, 0)), late.params.track())
    params = simulator("flicking_finger").params
    with pytest.raises(slcp.ParameterError, match="not tracked"):
        params.gradient("mass")
    with pytest.raises(slcp.ParameterError, match="no parameter 'weight'"):
        params.track().gradient("weight")
    with pytest.raises(slcp.ParameterError, match="built with the angle 0"):
        params.replace(shape_angle=0.1)
