"""Implicit stiffness: closed form, invariant and bounds for every h omega; contact; both strategies."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import Oracle, residual
from parameter_checks import lever, states
from simulators import WIDTH, scene

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape, Spring

H = 0.01
RATIOS = np.geomspace(0.01, 1e4, 19)  # x = h omega
STRATEGIES = ("specialised", "generic")


def slider(**changes):
    body = Body("slider", 1.0, 0.1, joint="prismatic", stiffness=1.0)
    return Scene("sprung_slider", (body,), gravity=(0.0, 0.0), step_size=H, **changes)


def simulator(scene, device, strategy, dtype="float64", residual="hard"):
    return slcp.Simulator(scene, slcp.Options(residual), device=device, dtype=dtype, strategy=strategy)


def swing(x, step, strategies, device, dtype, start, **changes):
    """Positions and velocities (B, N + 1) of a sprung slider for every strategy."""
    for strategy in strategies:
        sim = simulator(slider(**changes), device, strategy, dtype)
        params = sim.params.replace(stiffness=(x[:, None] / H) ** 2)
        run = sim.rollout(np.tile(start, (len(x), 1)), np.zeros((len(x), step, 0)), params)
        yield strategy, run, run.states[..., 0].astype(float), run.states[..., 1].astype(float)


def test_a_slider_swings_as_the_rule_says(device, dtype):
    """A step is v' = v - h omega^2 q/(1 + x^2/2), q' = q + h v', and keeps (1 + x^2/2) v^2 + omega^2 q^2 -
    h omega^2 q v, (M50): no stretch beyond 2^.5 times the first, no speed beyond 2^.5 times the first.
    """
    rounding = {"float64": 1e-14, "float32": 1e-6}[WIDTH[dtype]]
    omega2, x2 = (RATIOS[:, None] / H) ** 2, RATIOS[:, None] ** 2
    for start in ([0.01, 0.0], [0.0, 1.0]):
        for name, run, q, v in swing(RATIOS, 300, STRATEGIES, device, WIDTH[dtype], start):
            assert not run.status.any(), name
            after = v[:, :-1] - H * omega2 * q[:, :-1] / (1.0 + 0.5 * x2)
            size = np.abs(v[:, :-1]) + H * omega2 * np.abs(q[:, :-1]) / (1.0 + 0.5 * x2)
            assert (np.abs(v[:, 1:] - after) <= 4.0 * rounding * size).all(), name
            moved = H * np.abs(v[:, 1:]) + np.abs(q[:, :-1])
            assert (np.abs(q[:, 1:] - q[:, :-1] - H * v[:, 1:]) <= 4.0 * rounding * moved).all(), name
            kept = (1.0 + 0.5 * x2) * v**2 + omega2 * q**2 - H * omega2 * q * v
            assert (np.abs(kept - kept[:, :1]) <= 1200.0 * rounding * kept[:, :1]).all(), name
            bound = 2.0**0.5 * (1.0 + 1200.0 * rounding)
            if start[0]:
                assert (np.abs(q).max(1) <= bound * start[0]).all(), name
            else:
                assert (np.abs(v).max(1) <= bound).all(), name


def test_a_scene_can_keep_the_explicit_rule(device):
    """Semi-implicit Euler as it was: a rotation below h omega = 2, and beyond it growth that is SOLVED."""
    x = np.array([0.5, 1.99, 2.1])
    ((_, run, q, _v),) = swing(
        x, 100, STRATEGIES[:1], device, "float64", [0.01, 0.0], implicit_stiffness=False
    )
    assert not run.status.any()
    bound = 0.01 / np.sqrt(np.maximum(1.0 - x**2 / 4.0, 1e-30))
    assert (np.abs(q[:2]).max(1) <= bound[:2] * (1 + 1e-9)).all() and np.abs(q[2]).max() > 1e20


def test_what_has_no_spring_is_the_same_scene():
    for sc in (slcp.scenes.flicking_finger(), slcp.scenes.stack(3), scene("menagerie")):
        assert replace(sc, implicit_stiffness=False).structure == sc.structure
        assert not sc.structure.implicit_stiffness
    assert slider().structure.implicit_stiffness and slcp.scenes.walker().structure.implicit_stiffness
    assert not slider(implicit_stiffness=False).structure.implicit_stiffness


def test_springs_with_dampers_are_stable_and_dampers_alone_decay(device):
    """For h omega from .01 to 1e4 and c h/m from .1 to 1e4: (1 + x^2/2) v^2 + omega^2 q^2 - h omega^2 q v
    never grows.
    """
    x, y = (a.ravel() for a in np.meshgrid(RATIOS, np.geomspace(0.1, 1e4, 11)))
    omega2, h = (x[:, None] / H) ** 2, H
    for strategy in STRATEGIES:
        sim = simulator(slider(), device, strategy)
        params = sim.params.replace(stiffness=(x[:, None] / H) ** 2, damping=y[:, None] / H)
        run = sim.rollout(np.tile([0.01, 1.0], (len(x), 1)), np.zeros((len(x), 400, 0)), params)
        assert not run.status.any()
        q, v = run.states[..., 0], run.states[..., 1]
        assert (np.abs(q).max(1) <= 2.0 * (0.01 + h + h / x)).all(), strategy
        kept = (1.0 + 0.5 * x[:, None] ** 2) * v**2 + omega2 * q**2 - h * omega2 * q * v
        assert (kept[:, -1] < kept[:, 0]).all(), strategy


def test_negative_stiffness_stays_explicit(device):
    """A step is v' = v + h |k| q/m, of springs in joints and between points, and N stays definite."""
    sc, far = slider(), np.array([[0.3, -0.1]])
    pulled = Scene("pulled", (Body("slider", 1.0, 0.1, joint="prismatic"),), gravity=(0.0, 0.0), step_size=H,
                   springs=(Spring(None, "slider", stiffness=1.0),))  # fmt: skip
    for strategy in STRATEGIES:
        for scene_, name in ((sc, "stiffness"), (pulled, "spring_stiffness")):
            sim = simulator(scene_, device, strategy)
            params = sim.params.replace(**{name: [-1e6]})
            lin, step = sim.linearize(far, params=params), sim.step(far, params=params)
            np.testing.assert_allclose(step.state[:, 1], -0.1 + H * 1e6 * 0.3, rtol=1e-12)
            np.testing.assert_allclose(lin.A[0, 1], [H * 1e6, 1.0], rtol=1e-9)


def hung(length):
    """Discs on springs between points, the first tied to the world: a chain."""
    names = ("a", "b", "c")
    bodies = tuple(Body(n, 1.0, 0.02, joint="free") for n in names)
    ties = ((None, "a"), ("a", "b"), ("b", "c"))
    springs = tuple(Spring(one, other, stiffness=1.0, length=length) for one, other in ties)
    start = np.array([[0.5 * (i + 1), -0.1 * i, 0.0] for i in range(3)]).ravel()
    return Scene("hung", bodies, springs=springs, step_size=H, initial_state=(*start, *np.zeros(9)))


@pytest.mark.parametrize("length", [0.5, 0.0], ids=["taut", "of no length"])
def test_a_chain_on_springs_stays_bounded(device, length):
    """Explicit ones are at 1e100 and more here, SOLVED."""
    sc, x = hung(length), np.array([1.0, 3.0, 10.0, 100.0, 1e4])
    starts = np.tile(sc.x0, (len(x), 1))
    ends = []
    for strategy in STRATEGIES:
        sim = simulator(sc, device, strategy)
        params = sim.params.replace(spring_stiffness=np.repeat((x[:, None] / H) ** 2, 3, 1))
        run = sim.rollout(starts, np.zeros((len(x), 300, 0)), params)
        assert not run.status.any(), strategy
        assert np.abs(run.states[..., [0, 1, 3, 4, 6, 7]]).max() < 30.0, strategy
        ends.append(run.states[:, 1])
    np.testing.assert_allclose(*ends, rtol=1e-9, atol=1e-9)


def test_the_walker_lands_with_large_steps(device):
    """Its joints' springs have h omega > 2 at h = .05; explicit ones take it to 1e10, SOLVED."""
    sim = simulator(slcp.scenes.walker(), device, "generic")
    for h in (0.005, 0.02, 0.05):
        run = sim.rollout(sim.scene.x0, np.zeros((round(2.0 / h), sim.nu)), sim.params.replace(step_size=h))
        assert run.status == 0 and np.abs(run.states).max() < 12.0, h


def press(rest):
    """A disc on a guide that a spring presses against the ground, or lifts off it."""
    body = Body("disc", 1.0, 0.1, joint="prismatic", axis=(0.0, 1.0), stiffness=1.0, rest=rest)
    shapes = (Shape("disc", "disc", "disc", 0.1), Shape("ground", None, "halfplane", angle=np.pi / 2))
    return Scene("press", (body,), shapes, (Contact("ground", "disc"),), step_size=H)


def test_what_a_spring_presses_rests_with_its_force(device):
    """The impulse is h (m g + k (q - rest)); a body that falls onto it stops there."""
    x = RATIOS[RATIOS > 0.3]
    for strategy in STRATEGIES:
        sim = simulator(press(0.05), device, strategy)
        params = sim.params.replace(stiffness=(x[:, None] / H) ** 2)
        for height in (0.1, 0.15):
            run = sim.rollout(np.tile([height, 0.0], (len(x), 1)), np.zeros((len(x), 60, 0)), params,
                              record="impulse")  # fmt: skip
            assert not run.status.any()
            np.testing.assert_allclose(run.states[:, -1, 0], 0.1, rtol=0.0, atol=1e-12)
            force = 9.81 + (x / H) ** 2 * 0.05
            np.testing.assert_allclose(run.impulse[:, -1, 0], H * force, rtol=1e-9, err_msg=strategy)
            assert (run.states[:, :, 0] >= 0.1 - 1e-12).all()


@pytest.mark.parametrize("stiff", [1.0, 1e4])
def test_contact_with_springs_is_the_oracles(device, stiff):
    """(M + h C + h^2/2 K)(v' - v) = h (r + u) + J' lambda, and w, in both kernel strategies."""
    sc = lever()
    x, _, _ = states(sc, 60)
    changes = {"spring_stiffness": stiff * sc.default_parameters()["spring_stiffness"]}
    problem = Oracle(sc, **changes).problem(x, np.zeros((len(x), sc.nu)))
    size = np.abs(problem["vfree"]).max(1, keepdims=True) + np.abs(problem["rate"]).max(1, keepdims=True)
    inertia = np.einsum("...ii->...i", problem["M"])
    for strategy in STRATEGIES:
        sim = simulator(sc, device, strategy, residual="rem-logistic")
        step = sim.step(x, np.zeros((len(x), sc.nu)), params=sim.params.replace(**changes))
        assert not step.status.any() and (step.impulse > 1e-3).any(0).mean() > 0.4
        r1, r2 = residual(problem, step.state[:, sc.nv :], step.impulse)
        assert (np.abs(r1) <= 1e-11 * inertia.max(1, keepdims=True) * size).all(), strategy
        assert (np.abs(r2) <= 1e-10 * size).all(), strategy
