"""Peers of the work-precision diagrams: their models are the scene's; what is measured of them."""

import dataclasses
import importlib
import math

import numpy as np
import pytest

from slcp_warp import SceneError, Spring, scenes
from slcp_warp.scripts.benchmarks.mechanics.scene import contact, mass_matrix
from slcp_warp.scripts.benchmarks.peers.peer import NEAR, configurations, step_count
from slcp_warp.scripts.benchmarks.shared.optional import load
from slcp_warp.scripts.benchmarks.shared.overlap import overlap

SCENES = ("flicking_finger", "sliding_block", "grasp", "walker", "cart_pole", "rolling_disc")
REACHING = np.array([[-2.2, -0.6, 0.4, 1.0, -1.0, 0.0]])  # the finger before it strikes


def test_mass_matrix_of_cart_and_pole():
    """Closed form: a pole of length l (from upright) on a cart."""
    scene, angle = scenes.cart_pole(), np.array([0.0, 0.7, -2.0])
    m, half = 0.2, 0.3
    expected = np.empty((3, 2, 2))
    expected[:, 0, 0] = 1.0 + m
    expected[:, 0, 1] = expected[:, 1, 0] = -m * half * np.cos(angle)
    expected[:, 1, 1] = m * 0.36 / 12.0 + m * half**2
    q = np.stack([np.array([0.1, 0.2, 0.3]), angle], axis=1)
    np.testing.assert_allclose(mass_matrix(scene, q), expected, rtol=1e-14)


def test_free_bodies_masses_are_diagonal_and_gaps_plain():
    scene = scenes.two_balls()
    q = np.array([[0.0, 0.0, 0.3, 0.3, 0.4, -1.0]])
    np.testing.assert_allclose(mass_matrix(scene, q)[0], np.diag([1, 1, 0.005, 2, 2, 0.01]), atol=1e-16)
    d, normal = contact(scene, q)
    np.testing.assert_allclose([d[0], normal[0]], [0.5 - 0.2, math.atan2(0.4, 0.3)], atol=1e-12)
    block = scenes.sliding_block(slope=0.4)
    d = [contact(block, block.x0[None, :3], k)[0][0] for k in range(4)]
    np.testing.assert_allclose(d, [0.0, 0.0, 0.2, 0.2], atol=1e-15)


def test_a_disc_that_passes_through_another_is_missed():
    """Past each other at 2 m/s: overlap 2 r at worst, one passage; not when it turns back half way."""
    scene = scenes.two_balls()
    h, steps = 0.02, 30
    t = h * np.arange(steps + 1)
    states = np.zeros((2, steps + 1, 12))
    states[0, :, 0] = -0.51 + 2.0 * t
    states[1, :, 0] = -0.51 + 2.0 * np.minimum(t, 0.42 - t)
    found = overlap(scene, states, h)
    assert found.missed == 1
    assert 0.18 < found.penetration < 0.2
    assert overlap(scene, states[1:], h).missed == 0


def test_configurations_are_near_and_steps_are_whole():
    scene = scenes.flicking_finger()
    q = configurations(scene, REACHING)
    assert len(q) == 40 and np.abs(contact(scene, q)[0][:10]).max() < NEAR
    assert step_count(2.0, 0.05) == 40
    with pytest.raises(ValueError, match="whole number of steps"):
        step_count(2.0, 0.03)


def test_a_missing_package_names_its_extra():
    with pytest.raises(ModuleNotFoundError, match=r"slcp-warp\[peers\]"):
        load("no_such_simulator", "NoSuch", "peers")


@pytest.mark.parametrize("name", SCENES)
def test_mujoco_has_the_scenes_masses_and_distances(name):
    pytest.importorskip("mujoco")
    from slcp_warp.scripts.benchmarks.peers.mujoco import MuJoCo

    scene = scenes.NAMED[name]()
    q = configurations(scene, REACHING if name == "flicking_finger" else scene.x0[None])
    assert contact(scene, q)[0].min() < 0.5 * NEAR
    found = MuJoCo().deviation(scene, q)
    iterated = name == "flicking_finger"  # the depth of two ellipses that overlap
    assert found.mass_matrix < 1e-13
    assert found.distance < (1e-5 if iterated else 1e-11) and found.normal < (1e-2 if iterated else 1e-6)
    assert found.note.startswith("M off")


def test_mujoco_runs_in_our_coordinates():
    """A ball in free fall: the first-order step's own sum, exactly; RK4 the parabola; starts come first."""
    pytest.importorskip("mujoco")
    from slcp_warp.scripts.benchmarks.peers.mujoco import MuJoCo

    scene, h, steps = scenes.ball_drop(height=5.0), 0.05, 10
    starts = np.array([[0.1, 5.0, 0.3, 1.0, 0.5, -2.0], [0.0, 4.0, 0.0, 0.0, 0.0, 0.0]])
    t = h * np.arange(steps + 1)
    for setting, extra in (("default", 0.5 * 9.81 * h * t), ("RK4", 0.0 * t)):
        run = MuJoCo().prepare(scene, starts, h * steps, h, setting)
        states = run.rollout()
        assert states.shape == (2, steps + 1, 6) and run.compile_seconds == 0.0
        np.testing.assert_array_equal(states[:, 0], starts)
        expected = starts[:, None, :3] + t[:, None] * starts[:, None, 3:]
        expected[:, :, 1] -= 0.5 * 9.81 * t**2 + extra
        np.testing.assert_allclose(states[:, :, :3], expected, atol=1e-12)


def test_mujocos_spring_holds_the_scenes_weight():
    """A damped cart on a spring at an incline comes to rest where its spring carries it."""
    pytest.importorskip("mujoco")
    from slcp_warp.scripts.benchmarks.peers.mujoco import MuJoCo

    axis = (math.cos(0.3), math.sin(0.3))
    cart = dataclasses.replace(scenes.cart_pole().bodies[0], axis=axis, angle=0.8, stiffness=50.0, rest=0.1,
                               damping=20.0, lower=None, upper=None)  # fmt: skip
    scene = scenes.cart_pole()
    scene = dataclasses.replace(scene, bodies=(cart,), shapes=(), contacts=(), initial_state=None)
    end = MuJoCo().prepare(scene, np.zeros((1, 2)), 10.0, 0.01, "default").rollout()[0, -1]
    np.testing.assert_allclose(end, [0.1 - 9.81 * math.sin(0.3) / 50.0, 0.0], atol=1e-9)


def test_mujoco_refuses_what_it_has_not():
    pytest.importorskip("mujoco")
    from slcp_warp.scripts.benchmarks.peers.mujoco_model import mjcf

    spring = Spring("box0", None, stiffness=10.0)
    with pytest.raises(SceneError, match="takes no springs between points"):
        mjcf(dataclasses.replace(scenes.stack(1), springs=(spring,)))


@pytest.mark.slow
@pytest.mark.parametrize(
    "package, where, name",
    [
        ("mujoco_warp", "mujoco_warp", "MuJoCoWarp"),
        ("mujoco.mjx", "mjx", "MJX"),
        ("pydrake", "drake", "Drake"),
    ],
)
def test_other_peers_have_the_scenes_model_and_fall_like_it(package, where, name):
    """In single precision: a ball that falls for a quarter of a second, on first-order steps."""
    pytest.importorskip(package, reason=f"{package} is not installed (extra `peers`)")
    peer = getattr(importlib.import_module(f"slcp_warp.scripts.benchmarks.peers.{where}"), name)()
    scene, h, steps = scenes.ball_drop(height=0.1), 0.025, 10
    found = peer.deviation(scene, configurations(scene, scene.x0[None]))
    assert found.mass_matrix < 1e-6 and found.distance < 1e-5 and found.normal < 1e-5
    starts = np.array([[0.1, 5.0, 0.3, 1.0, 0.5, -2.0], [0.0, 4.0, 0.0, 0.0, 0.0, 0.0]])
    states = peer.prepare(scene, starts, h * steps, h, peer.settings(True)[0]).rollout()
    t = h * np.arange(steps + 1)
    expected = starts[:, None, :3] + t[:, None] * starts[:, None, 3:]
    expected[:, :, 1] -= 0.5 * 9.81 * (t**2 + h * t)
    np.testing.assert_allclose(states[:, :, :3], expected, atol=1e-5)
    if hasattr(peer, "linearization"):
        linear = peer.linearization(scene, h, peer.settings(True)[0])
        one = np.eye(3)
        free = np.block([[one, h * one], [0.0 * one, one]])
        np.testing.assert_allclose(linear.step(starts)[:, 3:5], starts[:, 3:5] - [0.0, 9.81 * h], atol=1e-12)
        for jacobian in linear.jacobians.values():
            np.testing.assert_allclose(jacobian(starts), np.stack([free, free]), atol=1e-6)
