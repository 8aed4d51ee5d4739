"""Armature: the inertia that a coordinate has by itself, as of a rotor behind a gear."""

import numpy as np
import pytest

import slcp_warp as slcp

H = 0.01
STRATEGIES = ["specialised", "generic"]


def cart_with_arm(**changes):
    bodies = (
        slcp.Body("cart", 2.0, 0.1, joint="prismatic", armature=0.5),
        slcp.Body("arm", 1.0, 0.05, parent="cart", com=(0.0, -0.3), **changes),
    )
    return slcp.Scene("cart_with_arm", bodies, actuators=(slcp.Actuator("cart"),), step_size=H)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_slider_is_as_heavy_as_its_mass_and_its_armature(strategy):
    body = slcp.Body("slider", 2.0, 0.1, joint="prismatic", armature=0.5)
    scene = slcp.Scene(
        "slider", (body,), actuators=(slcp.Actuator("slider"),), gravity=(0.0, 0.0), step_size=H
    )
    sim = slcp.Simulator(scene, device="cpu", dtype="float64", strategy=strategy)
    own = np.array([0.0, 0.5, 8.0])
    after = sim.step(np.zeros((3, 2)), np.full((3, 1), 4.0), sim.params.replace(armature=own[:, None]))
    np.testing.assert_allclose(after.state[:, 1], H * 4.0 / (2.0 + own), rtol=1e-14)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_gravity_does_not_pull_on_it(strategy):
    """A rotor adds to what turns, and not to what is pulled: (I + m l^2 + a) q'' = -m g l sin q."""
    body = slcp.Body("arm", 1.0, 0.05, com=(0.3, 0.0), armature=0.7)
    sim = slcp.Simulator(
        slcp.Scene("arm", (body,), step_size=H), device="cpu", dtype="float64", strategy=strategy
    )
    after = sim.step([0.4, 0.0])
    expected = -H * 9.81 * 0.3 * np.cos(0.4) / (0.05 + 0.3**2 + 0.7)
    np.testing.assert_allclose(np.ravel(after.state)[1], expected, rtol=1e-13)


def test_one_that_is_zero_changes_nothing():
    x, u = [0.1, 0.7, -0.3, 2.0], [1.5]
    runs = []
    for armature in (None, 0.0):
        scene = cart_with_arm(armature=armature)
        assert scene.structure.armature == ((0,) if armature is None else (0, 1))
        runs.append(slcp.Simulator(scene, device="cpu", dtype="float64").step(x, u).state)
    np.testing.assert_array_equal(*runs)


def test_what_was_built_without_has_none():
    sim = slcp.Simulator(cart_with_arm(), device="cpu", dtype="float64")
    with pytest.raises(slcp.ParameterError, match="without an armature"):
        sim.params.replace(armature=[0.5, 0.5])
    with pytest.raises(slcp.ParameterError, match="must not be negative"):
        sim.params.replace(**{"cart.shift.armature": -1.0})
    with pytest.raises(slcp.SceneError, match="armature is -1.0; it must not be negative"):
        cart_with_arm(armature=-1.0)
    with pytest.raises(slcp.ParameterError, match="no parameter"):
        body = slcp.Body("arm", 1.0, 0.05)
        slcp.Parameters(slcp.Scene("arm", (body,))).replace(armature=1.0)


def test_files_keep_it(tmp_path):
    scene = cart_with_arm(armature=0.25)
    slcp.save_scene(scene, tmp_path / "scene.json")
    assert slcp.load_scene(tmp_path / "scene.json").bodies == scene.bodies
