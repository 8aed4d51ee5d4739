"""The trapezoidal integrator: order, rest and impact, derivatives, and DDP through it."""

import numpy as np
import pytest
import warp as wp
from differences import GAPS, differences
from oracle import Oracle
from random_scenes import near_contact
from scipy.integrate import solve_ivp
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp.gradients import launches
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds
from slcp_warp.scripts.benchmarks.fuzz.problem import Truth

H = 0.05


def trapezoidal(name, device, **options):
    sc = scene(name) if isinstance(name, str) else name
    return slcp.Simulator(sc, slcp.Options(integrator="trapezoidal", **options), device=device)


def errors(sim, x0, exact, duration, step_sizes, **changes):
    """Largest error of the state after `duration`, one for every step size."""
    out = []
    for h in step_sizes:
        steps = round(duration / h)
        params = sim.params.replace(step_size=h, **changes)
        run = sim.rollout(x0, np.zeros((steps, sim.nu)), params)
        assert run.status == 0
        out.append(np.abs(run.states[-1] - exact).max())
    return np.array(out)


def kicked(q, k, h):
    """M and v' of two equal links (1 kg, 1 m, inertia .1, mass in the middle) at rest, a spring k at the
    second joint: (M + h^2/4 K_q) v' = -h (0, k q_2), K_q = d(M a + f)/dq_2 at constant a = -M^-1 (0, k q_2).
    """
    m = 0.25 + 0.1 + 0.5 * np.cos(q) * np.array([[2.0, 1.0], [1.0, 0.0]]) + np.array([[1.0, 0.0], [0.0, 0.0]])
    m[0, 0] += 0.25 + 0.1
    slope = -0.5 * np.sin(q) * np.array([[2.0, 1.0], [1.0, 0.0]])
    pull = np.array([0.0, k])
    by_q = np.zeros((2, 2))
    by_q[:, 1] = pull - slope @ np.linalg.solve(m, pull * q)
    return m, np.linalg.solve(m + h * h / 4 * by_q, -h * pull * q)


def test_a_stiff_spring_kicks_the_other_joint_as_the_rule_says(device):
    """h omega = .3 keeps the energy, 1 nearly; 2 and more multiply it, in the end by .15 (h omega)^2."""
    upper = slcp.Body("upper", 1.0, 0.1, com=(0.5, 0.0))
    lower = slcp.Body("lower", 1.0, 0.1, parent="upper", anchor=(1.0, 0.0), com=(0.5, 0.0), stiffness=1.0)
    sim = trapezoidal(slcp.Scene("sprung_links", (upper, lower), gravity=(0.0, 0.0), step_size=0.01), device)
    q, product = 0.7, np.array([0.1, 0.3, 1.0, 2.0, 3.0, 10.0, 1e2, 1e3, 1e4])
    mass = kicked(q, 1.0, 0.01)[0]
    k = (product / 0.01) ** 2 / np.linalg.inv(mass)[1, 1]
    truth = [kicked(q, value, 0.01) for value in k]
    stiffness = np.stack([0.0 * k, k], 1)
    step = sim.step(np.tile([0.5, q, 0.0, 0.0], (len(k), 1)), None, sim.params.replace(stiffness=stiffness))
    assert (step.status == 0).all()
    gain = []
    for i, (_, v) in enumerate(truth):
        assert np.abs(step.state[i, 2:] - v).max() < 1e-5 * max(1.0, product[i] / 100) * np.abs(v).max()
        x, m = np.asarray(step.state[i], float), mass * 1.0
        m[0, :] += (np.cos(x[1]) - np.cos(q)) * np.array([1.0, 0.5])
        m[1, 0] = m[0, 1]
        gain.append((0.5 * x[2:] @ m @ x[2:] + 0.5 * k[i] * x[1] ** 2) / (0.5 * k[i] * q * q))
    assert abs(gain[0] - 1) < 1e-3 and abs(gain[1] - 1) < 1e-2 and abs(gain[2] - 1) < 0.1
    assert gain[3] > 2.0 and gain[4] > 8.0 and gain[-1] / gain[-2] == pytest.approx(100.0, rel=0.05)


def test_free_swing_of_the_finger_is_second_order(device):
    """Undamped, T = 2 s, no limit and no contact in reach; 1e-2 at h = .05."""
    sc = scene("flicking_finger")
    x0 = np.array([-0.6, -0.8, 0.3, 0.0, 0.0, 1.0])
    truth = Oracle(sc, damping=np.zeros(3))

    def motion(t, x):
        return np.concatenate([x[3:], np.linalg.solve(truth.mass_matrix(x[:3]), truth.force(x[:3], x[3:]))])

    exact = solve_ivp(motion, (0.0, 2.0), x0, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    away = sc.default_parameters()["anchor"].copy()
    away[2] = (0.0, -30.0)
    sim = trapezoidal("flicking_finger", device, scaling="none")
    free = {"damping": 0.0, "lower": -100.0, "upper": 100.0, "anchor": away}
    error = errors(sim, x0, exact, 2.0, (0.05, 0.025, 0.0125), **free)
    assert error[0] < 1e-2 and (error[:-1] / error[1:] > 3.5).all(), error


def test_swinging_against_a_limit_is_second_order(device):
    """Gravity holds the first link on its limit; the second one swings as a pendulum of its own."""
    links = (
        slcp.Body("arm", 1.0, 0.05, com=(0.5, 0.0), lower=0.0),
        slcp.Body("bob", 1.0, 0.02, parent="arm", anchor=(1.0, 0.0), com=(0.4, 0.0)),
    )
    sim = trapezoidal(slcp.Scene("stop", links), device, residual="hard")
    x0 = np.array([0.0, -1.0, 0.0, 0.0])

    def swing(t, y):
        return [y[1], -9.81 * 0.4 / (0.02 + 0.4**2) * np.cos(y[0])]

    angle, rate = solve_ivp(swing, (0.0, 0.4), x0[[1, 3]], rtol=1e-12, atol=1e-12).y[:, -1]
    error = errors(sim, x0, [0.0, angle, 0.0, rate], 0.4, (0.04, 0.02, 0.01))
    assert error[0] < 1e-2 and (error[:-1] / error[1:] > 3.5).all(), error


def test_what_rests_stays_and_what_lands_neither_enters_nor_rebounds(device):
    sim = trapezoidal("ball_drop", device, residual="hard")
    params = sim.params.replace(step_size=H)
    nv = sim.scene.nv
    gap = sim.step(np.zeros(2 * nv), None, params).gap.ravel()[0]
    x = np.zeros((2, 2 * nv))
    x[:, 1] -= gap  # on the ground
    x[1, 1] += 1.0
    run = sim.rollout(x, np.zeros((2, 40, 0)), params, record="gap")
    assert (run.status == 0).all()
    np.testing.assert_allclose(run.states[0], np.broadcast_to(x[0], run.states[0].shape), atol=1e-12)
    heights = run.gap[1].ravel()
    landed = np.argmax(heights < 1e-9)
    assert 0 < landed < 20 and heights.min() > -1e-12
    np.testing.assert_allclose(heights[landed:], 0.0, atol=1e-12)
    np.testing.assert_allclose(run.states[1, landed + 1 :, nv:], 0.0, atol=1e-12)


@pytest.fixture
def touching(device):
    """Finger, params, and states near contact where the normal is unique; a force acts on every body."""
    sim = trapezoidal("flicking_finger", device, scaling="none")
    params = sim.params.replace(step_size=H, sigma=0.1)
    rng = np.random.default_rng(21)
    x = near_contact(sim.scene, rng, 40, GAPS, spread=0.4)
    x = x[Oracle(sim.scene).problem(x)["margin"] > 0.05]
    u, force = rng.standard_normal((len(x), 2)), rng.standard_normal((3, 3))

    def apart(x):
        return {"external_force": np.tile(force, (len(x), 1, 1))}

    return sim, params, x, u, apart


def relative(got, exact):
    axes = tuple(range(1, exact.ndim))
    return (np.abs(got - exact).max(axis=axes) / (1.0 + np.abs(exact).max(axis=axes))).max()


def test_first_derivatives(touching):
    sim, params, x, u, apart = touching
    lin = sim.linearize(x, u, params, **apart(x))
    exact = differences(lambda x, u: sim.step(x, u, params, **apart(x)).state, x, u)
    push = sim.step(x, u, params, **apart(x)).contact_impulse[..., 0].max(axis=1)
    assert (lin.status == 0).all() and 0.3 < (push > 1e-3).mean() < 0.97
    assert relative(np.concatenate([lin.A, lin.B], axis=-1), exact) < 1e-6


@pytest.mark.slow
def test_second_derivatives_by_differences(touching):
    sim, params, x, u, apart = touching

    def first(x, u):
        lin = sim.linearize(x, u, params, **apart(x))
        rows = np.concatenate([lin.A, lin.B], axis=-1)
        rows[:, :3, :3] -= np.eye(3)
        rows[:, :3] /= H
        return rows  # of v* and v'

    full = sim.linearize(x, u, params, second=True, **apart(x))
    plain = sim.linearize(x, u, params, **apart(x))
    np.testing.assert_allclose(full.A, plain.A, atol=1e-12)
    assert full.second.shape == (len(x), 6, 8, 8)
    assert relative(full.second, differences(first, x, u)) < 2e-6


@pytest.mark.full
def test_differences_agree_with_the_closed_form(device, monkeypatch):
    """Euler has both; the differences are taken in float64, of a simulator in float32, too (that they are
    right in float64 is `test_second_derivatives_by_differences`).
    """
    closed, sim = (simulator("flicking_finger", device, width, "none") for width in (wp.float64, wp.float32))
    rng = np.random.default_rng(21)
    x = near_contact(sim.scene, rng, 40, GAPS, spread=0.4)
    x = x[Oracle(sim.scene).problem(x)["margin"] > 0.05]
    u = rng.standard_normal((len(x), 2))
    x, u = x.astype(np.float32), u.astype(np.float32)
    for sigma in (0.1, 0.01):
        params = sim.params.replace(step_size=H, sigma=sigma)
        exact = closed.linearize(x, u, params, second=True).second
        with monkeypatch.context() as patch:
            patch.setattr(launches, "in_closed_form", lambda method: False)
            got = sim.linearize(x, u, params, second=True).second
        assert relative(got, exact) < 1e-3


def test_accelerations_of_a_stiff_spring_cost_no_digits_in_the_elimination():
    """A body that rides on a sprung arm, up to 1e12 rad/s^2: in units of v', v' and its derivatives by state
    are as right as a rounding of K_q, 1e-16 h^2 k/I of what it is added to, lets them be. v' was 50 times as
    far off without refinement. Against the rule in extended precision.
    """
    arm = slcp.Body("arm", 1.0, 0.01, com=(0.2, 0.1), stiffness=1e3, rest=0.3)
    puck = slcp.Body("puck", 0.5, 0.02, parent="arm", joint="free", anchor=(0.4, -0.1), com=(0.0, 0.05))
    sc = slcp.Scene("puck_on_an_arm", (arm, puck), step_size=0.01)
    sim = slcp.Simulator(sc, slcp.Options("hard", integrator="trapezoidal"), device="cpu")
    worlds = 64
    x, k = np.random.default_rng(0).standard_normal((worlds, 8)), np.zeros((worlds, 4))
    k[:, 0] = np.tile(10.0 ** np.arange(3, 11), worlds // 8)

    def reached(x):
        numbers = {n: np.repeat(v[None], worlds, 0) for n, v in sc.default_parameters().items()}
        numbers |= {"stiffness": k, "sigma": np.zeros((worlds, 0))}
        truth = Truth(sc, Worlds(numbers, x, np.zeros((worlds, 0)), np.zeros(worlds, int)))
        return truth.drive(np.zeros((worlds, 4))).free

    params, true = sim.params.replace(stiffness=k), reached(x)
    within = 2e-15 * (1.0 + 0.01**2 * k[:, 0] / 0.06)
    step, linear = sim.step(x, None, params), sim.linearize(x, None, params)
    assert (step.status == 0).all() and (linear.status == 0).all()
    missed = np.abs(step.state[:, 4:] - true).max(1) / np.abs(true).max(1)
    assert (missed < within).all()
    e = 1e-6
    for j, unit in enumerate(np.eye(8)):
        slope = (8.0 * (reached(x + e * unit) - reached(x - e * unit))
                 - (reached(x + 2 * e * unit) - reached(x - 2 * e * unit))) / (12.0 * e)  # fmt: skip
        off = np.abs(linear.A[:, 4:, j] - slope).max(1) / np.abs(linear.A[:, 4:]).max((1, 2))
        assert (off < 1e-6).all()
