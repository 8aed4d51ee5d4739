"""Exact solutions of the work-precision diagrams: against plain time stepping, differences and the oracle."""

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp
from slcp_warp import scenes
from slcp_warp.scripts.benchmarks.exact import plate, problems
from slcp_warp.scripts.benchmarks.exact.events import integrate
from slcp_warp.scripts.benchmarks.exact.flow import Flow
from slcp_warp.scripts.benchmarks.exact.mechanics import Mechanism
from slcp_warp.scripts.benchmarks.exact.modes import BACKWARD, FORWARD, OFF, STICK, Row, choose

G = problems.G


named = problems.problem
EXACT = [name for name in problems.MAKERS if name != "finger impact"]  # that one takes seconds


def test_problems_are_legal():
    for p in map(named, EXACT):
        assert p.name in problems.MAKERS
        nv = p.scene.nv
        assert p.starts.shape == p.exact.shape and np.isfinite(p.exact).all(), p.name
        assert len(p.starts) >= 32 or not p.contacts, p.name
        steps = p.duration / np.array(problems.STEP_SIZES)
        assert np.allclose(steps, steps.round()), p.name
        oracle = Oracle(p.scene)
        for states in (p.starts, p.exact):
            gaps = oracle.rows(states[:, :nv])[0]
            assert gaps.size == 0 or gaps.min() > -1e-12, p.name
        assert p.errors(p.exact).max() == 0.0


def test_sliding_against_small_steps():
    for name, slope, mu in (
        ("sliding stop", 0.0, 0.5),
        ("slope sticks", 0.3, 0.4),
        ("slope slips", 0.3, 0.2),
    ):
        p, h = named(name), 2e-4
        x, v = np.zeros(len(p.starts)), p.starts[:, 3] / np.cos(slope)
        for _ in range(round(p.duration / h)):
            free = v - h * G * np.sin(slope)
            v = np.sign(free) * np.maximum(np.abs(free) - h * mu * G * np.cos(slope), 0.0)
            x = x + h * v
        assert np.abs((p.exact - p.starts)[:, 0] - np.cos(slope) * x).max() < 4e-4
        assert np.abs(p.exact[:, 3] - np.cos(slope) * v).max() < 2e-3


def test_rolling_against_small_steps():
    p, h, mu, radius = named("rolling disc"), 2e-4, 0.3, 0.1
    v, spin, x = p.starts[:, 3].copy(), np.zeros(len(p.starts)), np.zeros(len(p.starts))
    for _ in range(round(p.duration / h)):
        slip = v + radius * spin
        rub = -np.sign(slip) * np.minimum(mu * G * h, np.abs(slip) / 3.0)
        v, spin = v + rub, spin + rub * 2.0 / radius
        x = x + h * v
    assert np.abs(p.exact[:, 0] - x).max() < 4e-4
    assert np.abs(p.exact[:, 5] - spin).max() < 1e-9


def test_plate_against_small_steps():
    p, h = named("ball bounces on a sprung plate"), 1e-4
    mass = np.array([plate.PLATE, plate.BALL])
    q, v = p.starts[:, :2].copy(), p.starts[:, 2:].copy()
    for _ in range(round(p.duration / h)):
        v[:, 0] -= h * plate.SPRING / mass[0] * q[:, 0]
        v -= h * G
        push = np.maximum(-(q[:, 1] - q[:, 0]) / h - (v[:, 1] - v[:, 0]), 0.0) / np.sum(1.0 / mass)
        v += push[:, None] * np.array([-1.0, 1.0]) / mass
        q = q + h * v
    assert p.errors(np.hstack([q, v])).mean() < 2e-4
    events = [plate.bounce(start, p.duration)[1] for start in p.starts]
    assert min(len(e) for e in events) >= 3  # lands, leaves, lands again


def test_mechanism_against_the_oracle():
    scene = scenes.flicking_finger()
    oracle, mechanism = Oracle(scene), Mechanism(scene)
    rng = np.random.default_rng(0)
    checked = 0
    while checked < 8:
        q, v = rng.uniform([-2.6, -2.0, -3.0], [-0.5, 0.0, 3.0]), rng.standard_normal(3)
        gap, normal, tangent, _ = oracle.contact_jacobian(q, 0)
        if not -0.05 < gap < 0.6:
            continue
        checked += 1
        assert mechanism.gap(q) == pytest.approx(gap, abs=1e-12)
        frames = mechanism.frames(q, v)
        mass, force = mechanism.dynamics(frames, v)
        np.testing.assert_allclose(mass, oracle.mass_matrix(q), atol=1e-12)
        np.testing.assert_allclose(force, oracle.force(q, v), atol=1e-10)
        assert mechanism.energy(q, v) == pytest.approx(oracle.energy(q, v), abs=1e-11)
        touch = mechanism.touch(frames, v)
        np.testing.assert_allclose(touch.normal, normal, atol=1e-11)
        np.testing.assert_allclose(touch.tangent, tangent, atol=1e-11)
        assert touch.normal_speed == pytest.approx(normal @ v)
        assert touch.tangent_speed == pytest.approx(tangent @ v)
        e = 1e-5
        fore, back = (mechanism.touch(mechanism.frames(q + s * v, v), v) for s in (e, -e))
        normal_bias = (fore.normal_speed - back.normal_speed) / (2 * e)
        tangent_bias = (fore.tangent_speed - back.tangent_speed) / (2 * e)
        assert touch.normal_bias == pytest.approx(normal_bias, abs=1e-7)
        assert touch.tangent_bias == pytest.approx(tangent_bias, abs=1e-7)


@pytest.mark.parametrize("sideways, expected", [(0.3, STICK), (1.0, FORWARD), (-1.0, BACKWARD)])
def test_modes_of_a_landing_particle(sideways, expected):
    mass = np.diag([2.0, 2.0])
    row = Row(np.array([0.0, 1.0]), 0.0, np.array([1.0, 0.0]), 0.0, friction=0.5)
    (answer,) = choose(mass, mass @ np.array([sideways, -1.0]), [row])
    assert answer.modes == (expected,)
    left = np.sign(sideways) * max(abs(sideways) - 0.5, 0.0)
    np.testing.assert_allclose(answer.x, [left, 0.0], atol=1e-15)
    (answer,) = choose(mass, mass @ np.array([sideways, 1.0]), [row])
    assert answer.modes == (OFF,)


STRIKE = (-2.2, -0.6, 0.4, 1.0, -1.0, 0.0)
FINGERS = {  # start: what happens to it for two seconds
    STRIKE: ["starts", "impact", "halts", "slips"],
    (-2.14, -0.16, -0.18, 3.17, 1.21, 1.0): ["starts", "impact", "releases", "impact"],  # the last on a limit
    (-0.78, -0.89, 0.74, -2.08, -3.24, 2.3): ["starts", "impact", "impact", "impact"],  # limit and pair
}


@pytest.mark.parametrize("start", FINGERS)
def test_events_obey_the_contact_law(start):
    """Equations of motion, complementarity and cone at points between events, and the balance of energy."""
    scene = scenes.flicking_finger()
    mechanism, oracle = Mechanism(scene), Oracle(scene)
    flow, x0, nv = Flow(mechanism), np.array(start), scene.nv
    motion = integrate(mechanism, x0, 2.0)
    assert [event.what for event in motion.events] == FINGERS[start]
    assert motion.drift < 1e-11 and motion.doubt < 1e-12 and motion.graze > 0.1
    rounding = 1e-13 * sum(abs(oracle.energy(x0[:nv], v)) for v in (x0[nv:], np.zeros(nv)))  # of energies
    assert all(event.lost >= -rounding for event in motion.events)  # at a start nothing is lost
    assert all(event.lost > 1e3 * rounding for event in motion.events if event.what == "impact")
    energy = oracle.energy(motion.end[:nv], motion.end[nv:]) - oracle.energy(x0[:nv], x0[nv:])
    assert energy + motion.lost == pytest.approx(0.0, abs=1e-9)
    before = np.append(x0, 0.0)
    for piece in motion.pieces[::4]:
        time, e = 0.5 * (piece.start + piece.end), 1e-4 * (piece.end - piece.start)
        y = piece.at(time)
        q, v = y[:nv], y[nv : 2 * nv]
        total = oracle.energy(q, v) + y[-1]
        assert total == pytest.approx(oracle.energy(x0[:nv], x0[nv:]), abs=1e-9)
        assert y[-1] >= before[-1] - rounding
        before = y
        forces = flow.solve(y, piece.modes)[1]
        gaps, rows, _ = oracle.rows(q)
        gaps, limits = gaps[:5], rows[:4]  # four limits, then both rows of the pair have its gap
        assert gaps.min() > -1e-10 and forces[:, 0].min() >= 0.0
        assert np.abs(gaps * forces[:, 0]).max() < 1e-9
        _, normal, tangent, _ = oracle.contact_jacobian(q, 0)
        f_n, f_t = forces[4]
        assert abs(f_t) <= 0.5 * f_n + 1e-9
        if f_n > 0.0:
            assert abs(normal @ v) < 1e-10
            assert abs((0.5 * f_n - abs(f_t)) * (tangent @ v)) < 1e-9 and f_t * (tangent @ v) <= 1e-9
        acceleration = (piece.at(time + e) - piece.at(time - e))[nv : 2 * nv] / (2.0 * e)
        pushed = oracle.force(q, v) + limits.T @ forces[:4, 0] + normal * f_n + tangent * f_t
        np.testing.assert_allclose(oracle.mass_matrix(q) @ acceleration, pushed, atol=1e-5)


def test_events_do_not_depend_on_tolerances():
    mechanism = Mechanism(scenes.flicking_finger())
    end = integrate(mechanism, np.array(STRIKE), 2.0).end
    for tolerance, max_step in ((1e-13, 0.007), (1e-11, 0.03)):
        other = integrate(mechanism, np.array(STRIKE), 2.0, tolerance, max_step).end
        assert np.abs(other - end).max() < 1e-10


def test_events_say_what_they_cannot():
    with pytest.raises(slcp.SceneError, match="revolute"):
        Mechanism(scenes.ball_drop())


@pytest.mark.slow
def test_time_stepping_converges_to_the_events():
    """Hard Coulomb steps of the simulator, first order in h."""
    scene = scenes.flicking_finger()
    mechanism, starts = Mechanism(scene), np.array(list(FINGERS))
    exact = np.array([integrate(mechanism, start, 2.0).end for start in starts])
    options = slcp.Options(residual="hard", friction="coulomb")
    sim = slcp.Simulator(scene, options, device="cpu")
    for h, worst in ((5e-3, 5e-2), (5e-4, 5e-3), (5e-5, 5e-4)):
        run = sim.rollout(
            starts, np.zeros((len(starts), round(2.0 / h), sim.nu)), sim.params.replace(step_size=h)
        )
        assert not run.status.any()
        assert np.abs(run.states[:, -1] - exact).max() < worst
