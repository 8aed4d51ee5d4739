"""Mechanical energy: against the oracle's, its slopes against forces, and what keeps it."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import Oracle
from parameter_checks import crane
from random_scenes import random_tree

import slcp_warp as slcp
from slcp_warp import Body, Scene, Spring, Tendon


def states(rng, scene, *shape):
    return rng.standard_normal((*shape, 2 * scene.nv))


def test_what_moves_and_what_is_lifted_as_the_oracle_has_it():
    rng = np.random.default_rng(0)
    for bodies in (1, 2, 4):
        scene = random_tree(rng, bodies)
        bodies = tuple(replace(b, armature=tuple(rng.uniform(0.1, 1.0, len(np.atleast_1d(b.damping)))))
                       for b in scene.bodies)  # fmt: skip
        for each in (scene, replace(scene, bodies=bodies)):
            x, nv = states(rng, each, 5, 7), each.nv
            found = slcp.energies(x, slcp.Parameters(each))
            assert found.kinetic.shape == (5, 7) and (found.kinetic > 0.0).all()
            np.testing.assert_allclose(found.total, Oracle(each).energy(x[..., :nv], x[..., nv:]), rtol=1e-12)
            np.testing.assert_array_equal(found.elastic, 0.0)


def test_slopes_of_what_is_elastic_are_forces():
    rng = np.random.default_rng(1)
    slide = Body("slide", 1.0, 0.1, joint="prismatic", stiffness=3.0, rest=0.2)
    bodies = (slide, Body("arm", 1.0, 0.2, parent="slide"), Body("box", 2.0, 0.1, joint="free"))
    springs = (Spring("arm", "box", (0.4, -0.1), (0.1, 0.2), stiffness=20.0, length=0.5),
               Spring(None, "arm", (-0.5, 0.8), (0.3, 0.3), stiffness=8.0, length=0.0))  # fmt: skip
    tendons = (Tendon("cord", ("slide.shift", "arm.angle"), (1.0, -0.4), stiffness=5.0, length=0.3),)
    scene = Scene("elastic", bodies, springs=springs, tendons=tendons, gravity=(0.0, 0.0))
    params, oracle = slcp.Parameters(scene), Oracle(scene)
    q = rng.standard_normal((20, scene.nv))

    def elastic(q):
        return slcp.energies(np.concatenate([q, 0.0 * q], -1), params).elastic

    slopes = [(elastic(q + 1e-6 * e) - elastic(q - 1e-6 * e)) / 2e-6 for e in np.eye(scene.nv)]
    forces = sum(oracle.spring_force(q, 0.0 * q, i) for i in range(len(springs)))
    forces[:, 0] -= 3.0 * (q[:, 0] - 0.2)
    (along,) = oracle.tendons()
    forces -= 5.0 * ((q @ along) - 0.3)[:, None] * along
    np.testing.assert_allclose(-np.stack(slopes, -1), forces, atol=1e-7)


@pytest.mark.parametrize("limit", [None, 1e3, 30.0])
def test_a_tendon_that_yields_keeps_what_it_gives(limit):
    """Two carts on a tendon of 100 N/m, pulled 1 m apart: beyond 30 N it pulls with these."""
    carts = tuple(Body(name, 1.0, 0.1, joint="prismatic") for name in "ab")
    cord = Tendon("cord", ("a.shift", "b.shift"), (1.0, -1.0), stiffness=100.0, force_limit=limit)
    scene = Scene("carts", carts, tendons=(cord,), step_size=1e-4, gravity=(0.0, 0.0))
    run = slcp.Simulator(scene, dtype="float64").rollout(scene.state({"a.shift": 1.0}), steps=3000)
    first = 50.0 if limit != 30.0 else 30.0 * (1.0 - 0.5 * 30.0 / 100.0)
    assert run.energies.elastic[0] == pytest.approx(first, rel=1e-12)
    np.testing.assert_allclose(run.energies.total, first, rtol=1e-3)
    assert run.energies.kinetic.max() > 0.5 * first


def test_what_a_motor_does_is_no_elastic_energy():
    body = Body("arm", 1.0, 0.1, joint="prismatic")
    tendon, motor = slcp.limited_servo(body, 100.0, 5.0)
    scene = Scene("arm", (body,), actuators=(motor,), tendons=(tendon,))
    assert slcp.energies(scene.state({"arm.shift": 1.0}), slcp.Parameters(scene)).elastic == 0.0


def test_a_pendulum_keeps_its_energy_and_a_damper_takes_it():
    """By the trapezoidal rule, and what a damper takes is the integral of c omega^2."""
    scene = Scene("pendulum", (Body("rod", 1.0, 0.1, com=(0.5, 0.0)),), step_size=1e-3)
    options = slcp.Options(integrator="trapezoidal")
    sim = slcp.Simulator(scene, options, device="cpu", dtype="float64")
    run = sim.rollout(np.array([[0.3, 0.0], [-1.0, 2.0]]), steps=1000)
    total = run.energies.total
    assert total.shape == (2, 1001) and np.abs(total - total[:, :1]).max() < 1e-3
    assert np.ptp(run.energies.kinetic, axis=1).min() > 1.0
    params = sim.params.replace(damping=np.array([[0.4], [0.8]]))
    run = sim.rollout(np.array([[0.3, 0.0], [0.3, 0.0]]), params=params, steps=1000)
    lost = run.energies.total[:, 0] - run.energies.total[:, -1]
    rate = run.states[..., 1] ** 2 * params["damping"]
    np.testing.assert_allclose(lost, np.trapezoid(rate, dx=1e-3, axis=1), rtol=5e-3)
    one = run[1].energies
    assert one.total.shape == (1001,)
    np.testing.assert_array_equal(one.total, run.energies.total[1])


def test_worlds_have_their_own_numbers():
    rng = np.random.default_rng(2)
    scene = crane()
    base = slcp.Parameters(scene)
    mass = rng.uniform(0.5, 2.0, (4, scene.structure.nb))
    gravity = rng.standard_normal((4, 2))
    params = base.replace(mass=mass, gravity=gravity)
    x = states(rng, scene, 4, 3)
    found = slcp.energies(x, params)
    for i in range(4):
        alone = slcp.energies(x[i], base.replace(mass=mass[i], gravity=gravity[i]))
        for name in ("kinetic", "potential", "elastic"):
            np.testing.assert_allclose(getattr(found, name)[i], getattr(alone, name), rtol=1e-13)
    np.testing.assert_allclose(slcp.energies(x[:, 0], params).total, found.total[:, 0], rtol=1e-13)


def test_what_does_not_fit_is_said():
    scene = crane()
    params = slcp.Parameters(scene)
    with pytest.raises(slcp.ArgumentError, match=r"states has shape \(3, 5\); \(..., 6\) is needed"):
        slcp.energies(np.zeros((3, 5)), params)
    worlds = params.replace(mass=np.ones((4, 3)))
    for shape in ((3, 6), (6,)):
        with pytest.raises(slcp.ArgumentError, match="params are of 4 worlds"):
            slcp.energies(np.zeros(shape), worlds)
    with pytest.raises(slcp.ArgumentTypeError, match="params is"):
        slcp.energies(np.zeros(6), scene)
