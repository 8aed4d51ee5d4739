"""The oracle against itself and against closed forms, so that it can be trusted to judge the kernels."""

import math

import numpy as np
import pytest
from oracle import Oracle, complex_step, residual, second_along, solve_hard_by_trial
from random_scenes import near_contact, random_tree

from slcp_warp import Body, Contact, Scene, Shape, scenes


def rod_pair(offset=0.0):
    return Scene(
        "two_rods",
        (
            Body("upper", 1.3, 0.2, com=(0.4, offset)),
            Body("lower", 0.7, 0.1, parent="upper", anchor=(0.9, 0.0), com=(0.3, 0.0)),
        ),
    )


def two_shapes(first, second, offset=(0.0, 0.0)):
    return Scene(
        "pair",
        (Body("a", 1.0, 0.1, joint="free"), Body("b", 2.0, 0.3, joint="free")),
        (Shape("a", "a", *first), Shape("b", "b", *second, offset=offset)),
        (Contact("a", "b", 0.4),),
    )


def test_derivatives_of_known_functions():
    q = np.array([[0.3, -1.2], [2.0, 0.1]])
    jac = complex_step(lambda z: np.stack([np.sin(z[..., 0]) * z[..., 1], z[..., 0] ** 2], -1), q)
    np.testing.assert_allclose(jac[:, 0, 0], np.cos(q[:, 0]) * q[:, 1], rtol=1e-15)
    np.testing.assert_allclose(jac[:, 1, 0], 2 * q[:, 0], rtol=1e-15)
    v = np.array([[5.0, 0.5], [-1.0, 7.0]])
    got = second_along(lambda z: np.sin(z[..., :1] + 2 * z[..., 1:]), q, v)
    exact = -np.sin(q[:, :1] + 2 * q[:, 1:]) * (v[:, :1] + 2 * v[:, 1:]) ** 2
    np.testing.assert_allclose(got, exact, rtol=1e-12)


def test_mass_and_force_of_a_single_pendulum():
    m, j, r, damping, theta, rate = 2.0, 0.3, 0.6, 0.17, 0.8, 2.5
    scene = Scene("p", (Body("rod", m, j, com=(r, 0.0), damping=damping),))
    oracle = Oracle(scene)
    q, v = np.array([theta]), np.array([rate])
    assert oracle.mass_matrix(q)[0, 0] == pytest.approx(j + m * r * r, rel=1e-14)
    assert oracle.force(q, v)[0] == pytest.approx(-m * 9.81 * r * math.cos(theta) - damping * rate, rel=1e-13)


def test_mass_and_force_of_a_double_pendulum():
    """The textbook's two-link arm (relative angles)."""
    oracle = Oracle(rod_pair(), gravity=np.zeros(2))
    m1, m2, i1, i2, length, r1, r2 = 1.3, 0.7, 0.2, 0.1, 0.9, 0.4, 0.3
    q, v = np.array([0.4, -1.1]), np.array([1.7, -0.6])
    c, s = math.cos(q[1]), math.sin(q[1])
    m22 = i2 + m2 * r2**2
    m12 = m22 + m2 * length * r2 * c
    m11 = i1 + m1 * r1**2 + i2 + m2 * (length**2 + r2**2 + 2 * length * r2 * c)
    np.testing.assert_allclose(oracle.mass_matrix(q), [[m11, m12], [m12, m22]], rtol=1e-14)
    k = m2 * length * r2 * s
    np.testing.assert_allclose(
        oracle.force(q, v), [k * (2 * v[0] * v[1] + v[1] ** 2), -k * v[0] ** 2], rtol=1e-12
    )


@pytest.mark.parametrize("seed", range(6))
def test_power_balance_of_random_trees(seed):
    """Without damping dE/dt = 0 along the accelerations M^-1 r; M is symmetric positive definite."""
    rng = np.random.default_rng(seed)
    scene = random_tree(rng, bodies=4)
    oracle = Oracle(scene, damping=np.zeros(scene.nv))
    q, v = rng.standard_normal((2, 5, scene.nv))
    mass = oracle.mass_matrix(q)
    np.testing.assert_allclose(mass, np.swapaxes(mass, -1, -2), atol=1e-14)
    assert np.linalg.eigvalsh(mass).min() > 0.0
    acceleration = np.linalg.solve(mass, oracle.force(q, v)[..., None])[..., 0]
    e = 1e-4

    def energy(t):
        return oracle.energy(q + t * v + 0.5 * t * t * acceleration, v + t * acceleration)

    slope = (8 * (energy(e) - energy(-e)) - (energy(2 * e) - energy(-2 * e))) / (12 * e)
    scale = np.abs(energy(0.0)) + np.abs(np.sum(v * v, -1))
    assert np.max(np.abs(slope) / scale) < 1e-9


def test_external_wrench_is_a_generalised_force_by_virtual_work():
    rng = np.random.default_rng(3)
    scene = random_tree(rng, bodies=3)
    oracle = Oracle(scene)
    q, v, dq = rng.standard_normal((3, scene.nv))
    wrench = rng.standard_normal((3, 3))
    got = oracle.force(q, v, external=wrench) - oracle.force(q, v)
    e = 1e-6
    work = np.sum(wrench.ravel() * (oracle.poses(q + e * dq) - oracle.poses(q - e * dq))) / (2 * e)
    assert got @ dq == pytest.approx(work, rel=1e-8)


def test_disc_distances_in_closed_form():
    rng = np.random.default_rng(0)
    q = rng.standard_normal((50, 6))
    centres = np.linalg.norm(q[:, 3:5] - q[:, :2], axis=1)
    for first, second in ((("disc", 0.3), ("disc", 0.5)), (("ellipse", (0.3, 0.3)), ("ellipse", (0.5, 0.5)))):
        gap, jn, jt, _ = Oracle(two_shapes(first, second)).contact_jacobian(q, 0)
        np.testing.assert_allclose(gap, centres - 0.8, atol=1e-14)
        n = (q[:, 3:5] - q[:, :2]) / centres[:, None]
        t = np.stack([-n[:, 1], n[:, 0]], -1)
        np.testing.assert_allclose(jn, np.concatenate([-n, 0 * n[:, :1], n, 0 * n[:, :1]], 1), atol=1e-12)
        one = np.ones((50, 1))
        np.testing.assert_allclose(jt, np.concatenate([-t, -0.3 * one, t, -0.5 * one], 1), atol=1e-12)


def test_distance_of_axis_aligned_ellipses():
    oracle = Oracle(two_shapes(("ellipse", (0.7, 0.5)), ("ellipse", (0.8, 0.25))))
    q = np.array([[0.0, 0, 0, 3.0, 0, 0], [0, 0, 0, 0, 3.0, 0], [0, 0, 0, 0, 3.0, np.pi / 2]])
    gap, angle, _, _, _ = oracle.contact(q, 0)
    np.testing.assert_allclose(gap, [3 - 1.5, 3 - 0.75, 3 - 1.3], atol=1e-14)
    np.testing.assert_allclose(np.cos(angle - [0, np.pi / 2, np.pi / 2]), 1.0, atol=1e-14)


@pytest.mark.parametrize(
    "kinds", [("ellipse", "ellipse"), ("halfplane", "ellipse"), ("ellipse", "halfplane")]
)
def test_normal_row_is_the_gradient_of_the_gap_and_points_touch(kinds):
    """Envelope theorem; and the touched points are d apart along n."""
    rng = np.random.default_rng(1)
    radii = {"ellipse": (0.7, 0.3), "halfplane": 0.0}
    scene = two_shapes((kinds[0], radii[kinds[0]]), (kinds[1], radii[kinds[1]]), offset=(0.2, -0.1))
    oracle = Oracle(scene, shape_angle=np.array([0.3, -0.4]))
    q = 1.2 * rng.standard_normal((40, 6))
    gap, angle, pa, pb, margin = oracle.contact(q, 0)
    _, jn, _, _ = oracle.contact_jacobian(q, 0)
    unique = margin > 1e-2
    assert unique.mean() > 0.8
    n = np.stack([np.cos(angle), np.sin(angle)], -1)
    np.testing.assert_allclose((pb - pa)[unique], (gap[:, None] * n)[unique], atol=1e-12)
    e = 1e-5
    for j in range(6):
        dq = e * np.eye(6)[j]
        slope = (oracle.contact(q + dq, 0)[0] - oracle.contact(q - dq, 0)[0]) / (2 * e)
        np.testing.assert_allclose(jn[unique, j], slope[unique], atol=1e-7)


@pytest.mark.parametrize("name", ["flicking_finger", "grasp", "sliding_block"])
@pytest.mark.parametrize("scaling", ["none", "inertia"])
def test_smooth_step_has_no_residual_and_approaches_the_hard_one(name, scaling):
    rng = np.random.default_rng(2)
    scene = scenes.NAMED[name]()
    x = near_contact(scene, rng, 12)
    u = rng.standard_normal((12, scene.nu))
    last = None
    hard = Oracle(scene).step(x, u, hard=True)[0]
    for sigma in (0.1, 0.01, 0.001):
        oracle = Oracle(scene, sigma=sigma)
        new, impulse = oracle.step(x, u, scaling=scaling)
        problem = oracle.problem(x, u, scaling=scaling)
        r1, r2 = residual(problem, new[:, scene.nv :], impulse)
        assert np.abs(r1).max() < 1e-11 and np.abs(r2).max() < 1e-12
        with np.errstate(under="ignore"):
            a = problem["D"] * impulse
            b = problem["rate"] + np.einsum("bij,bj->bi", problem["J"], new[:, scene.nv :])
            np.testing.assert_allclose(np.exp(-a / sigma) + np.exp(-b / sigma), 1.0, atol=1e-9)
        far = np.abs(new - hard).max()
        assert last is None or far < 0.35 * last
        last = far


@pytest.mark.parametrize("name", ["flicking_finger", "grasp", "sliding_block"])
def test_hard_step_agrees_with_trying_all_sets_of_rows(name):
    rng = np.random.default_rng(4)
    scene = scenes.NAMED[name]()
    x = near_contact(scene, rng, 20)
    problem = Oracle(scene).problem(x, np.zeros((20, scene.nu)))
    new, impulse = Oracle(scene).step(x, np.zeros((20, scene.nu)), hard=True)
    r1, r2 = residual(problem, new[:, scene.nv :], impulse, hard=True)
    assert np.abs(r1).max() < 1e-11 and np.abs(r2).max() < 1e-11
    assert (np.sum(impulse > 1e-6, axis=1) > 0).mean() > 0.3
    for i in range(20):
        trial = solve_hard_by_trial(problem["A"][i], problem["b"][i])
        np.testing.assert_allclose(problem["A"][i] @ trial, problem["A"][i] @ impulse[i], atol=1e-9)


def test_residual_notices_small_errors():
    scene = scenes.flicking_finger()
    x = near_contact(scene, np.random.default_rng(5), 8)
    oracle = Oracle(scene)
    new, impulse = oracle.step(x, np.zeros((8, 2)))
    problem = oracle.problem(x, np.zeros((8, 2)))
    r1, r2 = residual(problem, new[:, 3:] + 1e-9, impulse)
    assert np.abs(r1).max(axis=1).min() > 1e-10
    touching = impulse[:, -1] > 1e-2
    assert touching.any()
    r1, r2 = residual(problem, new[:, 3:], impulse * (1 + 1e-8))
    assert np.abs(r2)[touching].max() > 1e-12
