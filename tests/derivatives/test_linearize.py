"""A, B and the second derivatives of the step against central differences of the step itself, in float64."""

import numpy as np
import pytest
import warp as wp
from differences import differences, states_near_contact
from oracle import Oracle
from simulators import scene, simulator


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


CASES = [  # scene, scaling, hard, second derivatives too: one kernel makes A, B and those
    ("flicking_finger", "none", False, True),
    ("flicking_finger", "inertia", False, True),
    slow("flicking_finger", "inertia", True, True),
    pytest.param("sliding_block", "inertia", False, False, marks=pytest.mark.full),
    slow("moving_plane", "inertia", False, True),
    pytest.param("capsules", "inertia", False, False, marks=pytest.mark.full),
    slow("pill", "inertia", False, True),
    slow("slab", "inertia", False, True),
    slow("hoop", "inertia", False, True),
    pytest.param("blocks", "inertia", False, False, marks=pytest.mark.full),
    slow("touching_tree", "inertia", False, False),
]


def case(name, scaling, hard, device, count=60):
    """Simulator, params, states and controls where the step is smooth, and each world's largest impulse."""
    sc = scene(name)
    sim = simulator(name, device, wp.float64, scaling, "hard" if hard else "rem-logistic")
    params = sim.params.replace(step_size=0.05) if hard else sim.params.replace(step_size=0.05, sigma=0.1)
    x, u = states_near_contact(name, count)
    step = sim.step(x, u, params)
    keep = (step.status == 0) & (_margin(name, x) > 0.05)
    if hard:  # away from kinks: every row is clearly acting or clearly open
        problem = Oracle(sc, step_size=0.05).problem(x, u)
        w = problem["rate"] + np.einsum("bij,bj->bi", problem["J"], step.state[:, sc.nv :])
        keep &= (np.abs(problem["D"] * step.impulse - w) > 0.02).all(axis=1)
    assert keep.mean() > 0.6
    return sim, params, x[keep], u[keep], np.abs(step.contact_impulse[keep, :, 0]).max(axis=1)


def _margin(name, x):
    return Oracle(scene(name)).problem(x)["margin"]


@pytest.mark.parametrize("name,scaling,hard,second", CASES)
def test_derivatives(device, name, scaling, hard, second):
    sim, params, x, u, push = case(name, scaling, hard, device)
    touching = push > 1e-3
    assert 0.3 < touching.mean() < 0.97, f"{touching.mean():.0%} of the states touch"

    def jacobians(x, u):
        lin = sim.linearize(x, u, params, second=second)
        assert (lin.status == 0).all()
        return np.concatenate([lin.A, lin.B[..., : sim.nu]], axis=-1)

    close("A, B", jacobians(x, u), differences(lambda x, u: sim.step(x, u, params).state, x, u), x)
    if second:
        hessian = sim.linearize(x, u, params, second=True).second
        nv, nz = sim.scene.nv, sim.nx + sim.nu
        assert hessian.shape == (len(x), nv, nz, nz)
        np.testing.assert_allclose(hessian, np.swapaxes(hessian, -1, -2), rtol=1e-9, atol=1e-9)
        close("second", hessian, differences(lambda x, u: jacobians(x, u)[:, nv:], x, u), x, 1.0)


def close(what, got, exact, x, floor=0.0):
    """Errors relative to `floor` and the largest exact entry of each world, below 1e-6."""
    axes = tuple(range(1, exact.ndim))
    error = np.abs(got - exact).max(axis=axes) / (floor + np.abs(exact).max(axis=axes))
    worst = error.argmax()
    assert error.max() < 1e-6, f"{what}: {error.max():.2g} in world {worst}, x = {x[worst].tolist()}"


def test_second_derivatives_need_not_be_asked_for_and_change_nothing(device):
    sim, params, x, u, _ = case("flicking_finger", "none", False, device)
    plain, full = sim.linearize(x, u, params), sim.linearize(x, u, params, second=True)
    assert plain.second is None
    np.testing.assert_allclose(plain.A, full.A, atol=1e-12)
    np.testing.assert_allclose(plain.B, full.B, atol=1e-12)


@pytest.mark.parametrize("name", ["pendulum_chain", slow("sprung")])
def test_contact_free_derivatives(device, name):
    sim = simulator(name, device)
    rng = np.random.default_rng(5)
    x, u = 1.5 * rng.standard_normal((20, sim.nx)), rng.standard_normal((20, sim.nu))
    nv = sim.scene.nv
    lin = sim.linearize(x, u, second=True)
    exact = differences(lambda x, u: sim.step(x, u).state, x, u, 1e-3)
    np.testing.assert_allclose(np.concatenate([lin.A, lin.B], -1), exact, atol=1e-9)

    def first(x, u):
        lin = sim.linearize(x, u, second=True)  # by the kernel that is compiled already
        return np.concatenate([lin.A[:, nv:], lin.B[:, nv:]], axis=-1)

    exact = differences(first, x, u, 1e-3)
    np.testing.assert_allclose(lin.second, exact, atol=1e-8 * max(1.0, np.abs(exact).max()))


def test_position_rows_follow_from_the_velocity_rows(device):
    """q' = q + h v': dq'/dz = dq/dz + h dv'/dz, to rounding."""
    sim, params, x, u, _ = case("flicking_finger", "none", False, device)
    lin = sim.linearize(x, u, params)
    np.testing.assert_allclose(lin.A[:, :3], np.eye(6)[:3] + 0.05 * lin.A[:, 3:], atol=1e-12)
    np.testing.assert_allclose(lin.B[:, :3], 0.05 * lin.B[:, 3:], atol=1e-12)


def test_float32_derivatives_follow_float64(device):
    _, params, x, u, _ = case("flicking_finger", "none", False, device)
    coarse = simulator("flicking_finger", device, wp.float32, "none")
    x, u = x.astype(np.float32), u.astype(np.float32)
    got = coarse.linearize(x, u, params)
    exact = simulator("flicking_finger", device, wp.float64, "none").linearize(x, u, params)
    scale = np.abs(exact.A).max(axis=(1, 2), keepdims=True)
    assert (np.abs(got.A - exact.A) / scale).max() < 5e-3
    assert np.median((np.abs(got.A - exact.A) / scale).max(axis=(1, 2))) < 1e-4


def test_unsolved_worlds_have_a_status_and_finite_derivatives(device, dtype):
    sim = simulator("flicking_finger", device, dtype, "none")
    x = np.tile(scene("flicking_finger").x0, (5, 1))
    clean = sim.linearize(x)
    x[2, 4] = np.nan
    lin = sim.linearize(x)
    assert lin.status[2] == 3 and (np.delete(lin.status, 2) == 0).all()
    assert np.isfinite(lin.A).all() and np.isfinite(lin.B).all()
    np.testing.assert_array_equal(np.delete(lin.A, 2, 0), np.delete(clean.A, 2, 0))


def test_without_controls_b_is_empty(device):
    sim = simulator("moving_plane", device, wp.float64, "inertia")
    lin = sim.linearize(np.tile(scene("moving_plane").x0, (3, 1)), second=True)
    assert lin.A.shape == (3, 8, 8) and lin.B.shape == (3, 8, 0)
