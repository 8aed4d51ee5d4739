"""Exact solutions of the work-precision diagrams: against plain time stepping, differences and the oracle."""

import numpy as np
import pytest
from oracle import Oracle

from slcp_warp import scenes
from slcp_warp.scripts import diagram_plate, diagram_problems
from slcp_warp.scripts.diagram_mechanics import Mechanism

G = diagram_problems.G


def named(name):
    return next(p for p in diagram_problems.problems() if p.name == name)


def test_problems_are_legal():
    for p in diagram_problems.problems():
        nv = p.scene.nv
        assert p.starts.shape == p.exact.shape and np.isfinite(p.exact).all(), p.name
        assert len(p.starts) >= 32 or not p.contacts, p.name
        steps = p.duration / np.array(diagram_problems.STEP_SIZES)
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
    mass = np.array([diagram_plate.PLATE, diagram_plate.BALL])
    q, v = p.starts[:, :2].copy(), p.starts[:, 2:].copy()
    for _ in range(round(p.duration / h)):
        v[:, 0] -= h * diagram_plate.SPRING / mass[0] * q[:, 0]
        v -= h * G
        push = np.maximum(-(q[:, 1] - q[:, 0]) / h - (v[:, 1] - v[:, 0]), 0.0) / np.sum(1.0 / mass)
        v += push[:, None] * np.array([-1.0, 1.0]) / mass
        q = q + h * v
    assert p.errors(np.hstack([q, v])).mean() < 2e-4
    events = [diagram_plate.bounce(start, p.duration)[1] for start in p.starts]
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
