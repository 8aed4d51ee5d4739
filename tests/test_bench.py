"""The benchmarks' workload and MuJoCo's model of it: the scene's own mechanism, and legal states."""

import dataclasses

import numpy as np
import pytest

from slcp_warp import scenes
from slcp_warp.scripts.bench_workload import distance, legal_states, make_workload, mass_matrix

SCENE = scenes.flicking_finger()


def test_mass_matrix_of_the_finger():
    """Against the closed form of two links of length 1.6, the centre half way, and a free ellipse."""
    q = np.array([[-0.4, -0.9, 0.3], [-1.5, 0.0, 2.0]])
    m, i, half, length = SCENE.bodies[0].mass, SCENE.bodies[0].inertia, 0.8, 1.6
    c = np.cos(q[:, 1])
    expected = np.zeros((2, 3, 3))
    expected[:, 0, 0] = 2 * i + m * half**2 + m * (length**2 + half**2 + 2 * length * half * c)
    expected[:, 0, 1] = expected[:, 1, 0] = i + m * (half**2 + length * half * c)
    expected[:, 1, 1] = i + m * half**2
    expected[:, 2, 2] = SCENE.bodies[2].inertia
    np.testing.assert_allclose(mass_matrix(SCENE, q), expected, rtol=1e-14, atol=1e-14)


def test_distance_of_aligned_ellipses():
    """The finger hangs straight down to y = -3.2 over an ellipse at y = -5 that lies or stands."""
    low = dataclasses.replace(SCENE.bodies[2], anchor=(0.0, -5.0))
    scene = dataclasses.replace(SCENE, bodies=(*SCENE.bodies[:2], low))
    q = np.array([[-np.pi / 2, 0.0, 0.0], [-np.pi / 2, 0.0, np.pi / 2]])
    np.testing.assert_allclose(distance(scene, q), [5.0 - 0.5 - 3.2, 5.0 - 0.7 - 3.2], atol=1e-12)


def test_distance_of_deep_overlap_is_the_shortest_way_out():
    """Against a dense search over normals of the defining maximum."""
    q = np.array([[-np.pi / 2, 0.0, 0.3]])
    alpha = np.linspace(0.0, 2.0 * np.pi, 200001)
    down = np.array([0.0, -3.0 + 2.4])
    tip = np.hypot(0.8 * np.sin(alpha), 0.25 * np.cos(alpha))
    free = np.hypot(0.7 * np.cos(alpha - 0.3), 0.5 * np.sin(alpha - 0.3))
    dense = (np.sin(alpha) * down[1] - tip - free).max()
    np.testing.assert_allclose(distance(SCENE, q), dense, atol=1e-8)


def test_legal_states_are_inside_limits_and_apart():
    x = legal_states(SCENE, 500, np.random.default_rng(3))
    assert x.shape == (500, 6)
    assert (distance(SCENE, x[:, :3]) > 0.0).all()
    for j in (0, 1):
        body = SCENE.bodies[j]
        assert (x[:, j] >= body.lower).all() and (x[:, j] <= body.upper).all()


def test_workload_is_reproducible():
    first, second = (make_workload(SCENE, 8, 5, seed=1) for _ in range(2))
    np.testing.assert_array_equal(first.x0, second.x0)
    np.testing.assert_array_equal(first.controls, second.controls)


def test_mujoco_model_has_the_scenes_masses_and_distances():
    pytest.importorskip("mujoco")
    from slcp_warp.scripts.bench_mujoco import Peer

    q = legal_states(SCENE, 200, np.random.default_rng(0))[:, :3]
    peer = Peer(SCENE, ccd_tolerance="1e-12")  # its distance is iterative
    deviation = peer.deviation(q, mass_matrix(SCENE, q), distance(SCENE, q))
    assert deviation.mass_matrix < 1e-13
    assert deviation.distance < 1e-12
    model = peer.model
    np.testing.assert_array_equal(model.dof_damping.ravel()[:3], [0.2, 0.2, 0.7])
    np.testing.assert_array_equal(model.opt.gravity, [0.0, -4.0, 0.0])
    np.testing.assert_array_equal(model.jnt_range[:2], [[b.lower, b.upper] for b in SCENE.bodies[:2]])
    assert model.jnt_limited.tolist() == [1, 1, 0] and model.opt.timestep == SCENE.step_size
