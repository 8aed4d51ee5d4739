"""Gradients through steps that nothing comes back from: what rests, and what is after the loss."""

import numpy as np
import pytest

import slcp_warp as slcp

HARD = slcp.Options("hard")
N = 80


def asked_at(sim, x0, steps, at, component):
    """Gradients by x0 of one component of the state at a step."""
    weights = np.zeros((1, steps + 1, sim.nx))
    weights[0, at, component] = 1.0
    return slcp.vjp(sim, x0[None], np.zeros((1, steps, sim.nu)), weights, parameters=("mass", "friction"))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_what_comes_to_rest_has_a_gradient_of_zero(device, dtype):
    """Every step through a contact that holds takes twelve digits: after 30 of them numbers ended, and the
    gradient was NaN.
    """
    scene = slcp.scenes.push_block()
    sim = slcp.Simulator(scene, HARD, device=device, dtype=dtype, strategy="generic")
    vx = scene.state_index("block.vx")
    run = sim.rollout(scene.x0, np.zeros((N, sim.nu)))
    assert run.status == 0 and abs(run.states[-1, vx]) < 1e-6
    for component in (vx, scene.state_index("block.vangle")):
        found = asked_at(sim, scene.x0, N, N, component)
        assert np.abs(found.x0).max() < 1e-6
        assert all(np.abs(found.parameters[name]).max() < 1e-6 for name in ("mass", "friction"))


@pytest.mark.parametrize("strategy", ["generic", "specialised"])
def test_steps_after_the_loss_are_not_gone_through(device, strategy):
    """To the last bit what a shorter rollout has; gradients by the world's own size do not change that."""
    scene = slcp.scenes.flicking_finger()
    sim = slcp.Simulator(scene, HARD, device=device, dtype="float64", strategy=strategy)
    x0 = scene.x0 + 0.1 * np.random.default_rng(0).standard_normal(sim.nx)
    for scale in (1.0, 1e-120):
        whole, short = (asked_at(sim, x0, steps, 6, 1) for steps in (30, 6))
        assert np.abs(short.x0).max() > 1e-3
        np.testing.assert_array_equal(whole.x0, short.x0)
        for name in ("mass", "friction"):
            np.testing.assert_array_equal(whole.parameters[name], short.parameters[name])
        weights = np.zeros((1, 7, sim.nx))
        weights[0, 6, 1] = scale
        small = slcp.vjp(sim, x0[None], np.zeros((1, 6, sim.nu)), weights).x0
        np.testing.assert_allclose(small / scale, short.x0, rtol=1e-9, atol=1e-12)


def test_a_later_step_without_a_derivative_spoils_no_earlier_loss(device):
    """A box that lands flat against a sprung wall: Coulomb's law has many solutions there, and no slope."""
    corners = slcp.box("c", "box", width=0.3, height=0.2)
    ground = slcp.Shape("ground", None, "halfplane", angle=np.pi / 2)
    wall = slcp.Shape("wall", "wall", "halfplane", angle=np.pi)
    scene = slcp.Scene(
        "bounce",
        bodies=(
            slcp.Body("box", 1.0, 0.13 / 12, joint="free"),
            slcp.Body("wall", 0.5, 0.01, joint="prismatic", anchor=(1.5, 0.0), stiffness=800.0, damping=4.0),
        ),
        shapes=(ground, wall, *corners),
        contacts=(
            *slcp.touching(corners, (ground,), friction=0.4), *slcp.touching(corners, (wall,), friction=0.3)
        ),
        initial_state=(0.0, 0.35, 0.3, 0.0, 4.0, 1.0, -1.0, 0.0), step_size=0.005,
    )  # fmt: skip
    options = slcp.Options("hard", friction="coulomb")
    sim = slcp.Simulator(scene, options, device=device, dtype="float64", strategy="generic")
    late = asked_at(sim, scene.x0, 100, 100, 0)
    assert np.isnan(late.x0).all()
    found = asked_at(sim, scene.x0, 100, 65, 0)
    e = 1e-6 * np.eye(8)
    ends = [sim.rollout(scene.x0 + side * e, np.zeros((8, 65, 0))).states[:, -1, 0] for side in (1.0, -1.0)]
    np.testing.assert_allclose(found.x0[0], (ends[0] - ends[1]) / 2e-6, atol=1e-5 * np.abs(found.x0).max())
