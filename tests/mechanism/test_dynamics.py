"""Mass matrix and forces through contact-free steps, against the oracle; and the order of the integrator."""

import numpy as np
import pytest
import warp as wp
from oracle import Oracle
from scipy.integrate import solve_ivp
from simulators import numbers, rounded, scene, simulator

FREE = ["pendulum_chain", "tree0", "tree1", "carts", "floating", "sprung"]
TOLERANCE = {"float32": 3e-5, "float64": 1e-11}


def largest_error(name, device, dtype, count=40, external=None, seed=0, **changes):
    """One step from random states against the oracle's, relative to the size of each world's next state."""
    sim, sc = simulator(name, device, dtype), scene(name)
    rng = np.random.default_rng(seed)
    x = 1.5 * rng.standard_normal((count, 2 * sc.nv))
    u = rng.standard_normal((count, sc.nu))
    step = sim.step(x, u, sim.params.replace(**changes), external_force=external)
    assert (step.status == 0).all()
    oracle = Oracle(sc, **numbers(sc, dtype, **changes))
    exact, _ = oracle.step(*rounded(dtype, x, u), external=external)
    scale = 1.0 + np.abs(exact).max(axis=1, keepdims=True)
    return (np.abs(step.state - exact) / scale).max()


@pytest.mark.parametrize("name", FREE)
def test_free_step(device, name):
    assert largest_error(name, device, wp.float64) < TOLERANCE["float64"]


@pytest.mark.parametrize("name", ["floating", "carts", "sprung"])
def test_free_step_in_single_precision(device, name):
    assert largest_error(name, device, wp.float32) < TOLERANCE["float32"]


def test_numbers_of_every_world_are_its_own(device, dtype):
    """All mechanical parameters vary from world to world."""
    sc, rng = scene("carts"), np.random.default_rng(1)
    base = sc.default_parameters()
    turn = rng.uniform(-3, 3, (40, 3))
    changes = {
        name: base[name] + rng.uniform(0.1, 0.4, (40, *base[name].shape))
        for name in ("mass", "inertia", "com", "anchor", "angle", "damping", "gear", "gravity")
    }
    changes["axis"] = np.stack([np.cos(turn), np.sin(turn)], -1)
    changes["step_size"] = rng.uniform(0.001, 0.1, 40)
    assert largest_error("carts", device, dtype, **changes) < TOLERANCE[dtype.__name__]


@pytest.mark.parametrize("name", ["floating", "carts"])
def test_external_force_at_the_centres_of_mass(device, dtype, name):
    wrench = np.random.default_rng(2).standard_normal((40, scene(name).structure.nb, 3))
    wrench = wrench.astype(np.float32).astype(float)
    assert largest_error(name, device, dtype, external=wrench) < TOLERANCE[dtype.__name__]


def simulate(name, device, x0, duration, h, **changes):
    """States (N + 1, nx) of a passive rollout."""
    sim, sc = simulator(name, device), scene(name)
    count = round(duration / h)
    params = sim.params.replace(step_size=h, **changes)
    traj = sim.rollout(x0[None], np.zeros((1, count, sc.nu)), params)
    assert (traj.status == 0).all()
    return traj.states[0]


def exact_motion(name, x0, duration, **changes):
    """The same motion in continuous time."""
    sc = scene(name)
    oracle, nv = Oracle(sc, **changes), sc.nv

    def rate(_, x):
        q, v = x[:nv], x[nv:]
        return np.r_[v, np.linalg.solve(oracle.mass_matrix(q), oracle.force(q, v))]

    return solve_ivp(rate, (0.0, duration), x0, rtol=1e-10, atol=1e-10).y[:, -1]


def orders(errors):
    """Observed order between halvings."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


@pytest.mark.parametrize("name", ["pendulum_chain", "floating"])
def test_motion_converges_at_first_order(device, name):
    x0 = 0.5 * np.random.default_rng(3).standard_normal(2 * scene(name).nv)
    exact = exact_motion(name, x0, 0.5)
    errors = [np.linalg.norm(simulate(name, device, x0, 0.5, h)[-1] - exact) for h in (0.004, 0.002, 0.001)]
    np.testing.assert_allclose(orders(errors), 1.0, atol=0.25)


def test_energy_of_a_chain_converges_at_first_order(device):
    oracle = Oracle(scene("pendulum_chain"))
    x0 = 0.5 * np.random.default_rng(4).standard_normal(6)
    drift = []
    for h in (0.004, 0.002, 0.001):
        x = simulate("pendulum_chain", device, x0, 1.0, h)
        drift.append(np.abs(np.diff([oracle.energy(y[:3], y[3:]) for y in (x[0], x[-1])]))[0])
    assert drift[-1] < 0.01 * 9.81 * (0.25 + 0.75 + 1.25)  # of the weight times the reach
    np.testing.assert_allclose(orders(drift), 1.0, atol=0.25)


def test_momentum_of_a_floating_chain_converges_at_first_order(device):
    """No gravity, no damping: linear and angular momentum about the world's origin stay as they are."""
    changes = {"gravity": np.zeros(2), "damping": np.zeros(5)}
    oracle = Oracle(scene("floating"), **changes)
    x0 = np.random.default_rng(5).standard_normal(10)

    def momentum(x):
        e = 1e-6
        pose = oracle.poses(x[:5]).reshape(-1, 3)
        rate = ((oracle.poses(x[:5] + e * x[5:]) - oracle.poses(x[:5] - e * x[5:])) / (2 * e)).reshape(-1, 3)
        m, j = oracle.p["mass"], oracle.p["inertia"]
        spin = m * (pose[:, 0] * rate[:, 1] - pose[:, 1] * rate[:, 0]) + j * rate[:, 2]
        return np.r_[m @ rate[:, :2], spin.sum()]

    drift = []
    for h in (0.004, 0.002, 0.001):
        x = simulate("floating", device, x0, 0.5, h, **changes)
        drift.append(np.linalg.norm(momentum(x[-1]) - momentum(x[0])))
    np.testing.assert_allclose(orders(drift), 1.0, atol=0.25)
