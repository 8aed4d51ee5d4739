"""ERM in the step: stationary points, derivatives, what it does at a distance."""

import functools

import numpy as np
import pytest
import warp as wp
from differences import differences, states_near_contact
from oracle import Oracle
from simulators import scene, simulator
from taped import loss_of, on_device

import slcp_warp as slcp
from slcp_warp.simulator.residuals import residual

H, SIGMA = 0.05, 0.1


CASES = [
    ("flicking_finger", "erm-normal", "inertia"),
    pytest.param("rubbing_particle", "erm-logistic", "none", marks=pytest.mark.full),
]


def near(device, where, name, scaling):
    """Simulator, params, states near contact where the normal is unique, and controls."""
    sim = simulator(where, device, wp.float64, scaling, name)
    x, u = states_near_contact(where, 60)
    keep = Oracle(scene(where)).problem(x)["margin"] > 0.05
    return sim, sim.params.replace(step_size=H, sigma=SIGMA), x[keep], u[keep]


def objective(lam, a, b, d, name):
    return residual(name, d * lam, a @ lam + b, SIGMA).sum()


@pytest.mark.parametrize("where,name,scaling", CASES)
def test_step_minimises_the_expected_square(device, where, name, scaling):
    sim, params, x, u = near(device, where, name, scaling)
    step = sim.step(x, u, params)
    assert (step.status == 0).all()
    start = simulator(where, device, wp.float64, scaling, name.replace("erm", "rem")).step(x, u, params)
    p = Oracle(scene(where), step_size=H).problem(x, u)
    b = p["rate"] + np.einsum("bij,bj->bi", p["J"], p["vfree"])
    d = p["D"] if scaling == "inertia" else np.ones_like(p["D"])
    for i in range(len(x)):
        f = functools.partial(objective, a=p["A"][i], b=b[i], d=d[i], name=name)
        if np.abs(step.impulse[i]).max() == 0.0:
            assert f(step.impulse[i]) < 1e-12
            continue
        assert f(step.impulse[i]) <= f(start.impulse[i]) * (1.0 + 1e-12)
        e = 1e-6 * np.eye(len(b[i]))
        slope = [(f(step.impulse[i] + k) - f(step.impulse[i] - k)) / 2e-6 for k in e]
        assert np.abs(slope).max() < 1e-7 * (1.0 + np.abs(p["A"][i]).max())


@pytest.mark.parametrize("where,name,scaling", CASES)
def test_first_derivatives(device, where, name, scaling):
    sim, params, x, u = near(device, where, name, scaling)
    lin = sim.linearize(x, u, params)
    exact = differences(lambda x, u: sim.step(x, u, params).state, x, u)
    got = np.concatenate([lin.A, lin.B[..., : sim.nu]], axis=-1)
    error = np.abs(got - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))
    assert np.median(error) < 1e-8 and error.max() < 1e-5, (
        f"{error.max():.2g}, x = {x[error.argmax()].tolist()}"
    )


def test_one_row_scaled_by_inertia_is_the_rem_step(device):
    states, controls = np.zeros((3, 6)), np.zeros((3, 0))
    states[:, 1], states[:, 4] = (0.003, 0.02, 0.1), (0.0, -1.0, -8.0)
    after = [
        simulator("particle", device, wp.float64, "inertia", name).step(states, controls).state
        for name in ("erm-normal", "rem-normal")
    ]
    np.testing.assert_allclose(after[0], after[1], atol=1e-9)


@pytest.mark.parametrize("name", ["erm-normal", pytest.param("rem-logistic", marks=pytest.mark.slow)])
def test_gradient_of_a_trapezoidal_rollout_on_a_tape(device, name):
    """Of REM, too; by all parameters with erm-logistic in tests/mechanism/test_damping.py."""
    options = slcp.Options(residual=name, integrator="trapezoidal")
    sim = slcp.Simulator(scene("rubbing_particle"), options, device, "float64")
    rng, steps = np.random.default_rng(0), 6
    x0, us = rng.normal(size=(4, 6)), np.zeros((4, steps, 0))
    x0[:, 1], x0[:, 4] = rng.uniform(0.01, 0.06, 4), -2.0  # lands within the rollout
    weight = rng.normal(size=(4, steps + 1, 6))
    start = on_device(x0, device)
    with wp.Tape() as tape:
        traj = sim.rollout(start, on_device(us, device, False))
        loss = loss_of(traj.states, weight, device)
    tape.backward(loss)
    assert (traj.status.numpy() == 0).all()
    exact, step = np.zeros((4, 6)), 1e-6
    for j in range(6):
        ends = [sim.rollout(x0 + k * step * np.eye(6)[j], us, record=("impulse",)) for k in (1, -1)]
        assert (ends[0].impulse.max(axis=(1, 2)) > 0.1).all()
        exact[:, j] = np.einsum("bkj,bkj->b", weight, ends[0].states - ends[1].states) / (2.0 * step)
    np.testing.assert_allclose(start.grad.numpy(), exact, atol=1e-7 * np.abs(exact).max())
