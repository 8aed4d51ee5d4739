"""Momentum and the centre of mass: by differences, and what changes them."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import Oracle, rotate
from random_scenes import random_tree

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape


def flyer(**changes):
    """Three links in the air: a free one and two that hang on it."""
    bodies = (
        Body("torso", 5.0, 0.3, joint="free", com=(0.0, 0.1)),
        Body("thigh", 2.0, 0.05, parent="torso", com=(0.0, -0.2)),
        Body("shin", 1.0, 0.02, parent="thigh", anchor=(0.0, -0.4), com=(0.0, -0.2)),
    )
    return Scene(**{"name": "flyer", "bodies": bodies, "step_size": 0.01} | changes)


def test_of_random_trees_it_is_what_their_points_move_by():
    """Linear momentum by a difference of places, angular by one of every body's turn and place."""
    rng = np.random.default_rng(0)
    for bodies in (1, 2, 4):
        scene = random_tree(rng, bodies)
        oracle, nv, step = Oracle(scene), scene.nv, 1e-6
        x = rng.standard_normal((6, 2 * nv))
        found = slcp.momentum(x, slcp.Parameters(scene))
        mass, inertia, com = (
            np.array([getattr(b, n) for b in scene.bodies]) for n in ("mass", "inertia", "com")
        )

        def placed(q, oracle=oracle, com=com, count=bodies):
            frames = oracle.frames(q)
            turns = np.stack([frames[b][0] for b in range(count)])
            return turns, np.stack([frames[b][1] + rotate(frames[b][0], com[b]) for b in range(count)])

        (ahead, there), (back, behind) = (placed(x[:, :nv] + s * step * x[:, nv:]) for s in (1.0, -1.0))
        speed, rate = (there - behind) / (2.0 * step), (ahead - back) / (2.0 * step)
        points = placed(x[:, :nv])[1]
        centre = np.einsum("i,ibj->bj", mass, points) / mass.sum()
        np.testing.assert_allclose(found.mass, mass.sum(), rtol=1e-12)
        np.testing.assert_allclose(found.place, centre, atol=1e-12)
        np.testing.assert_allclose(found.linear, np.einsum("i,ibj->bj", mass, speed), atol=1e-7)
        np.testing.assert_allclose(found.velocity, found.linear / mass.sum(), rtol=1e-12)
        arm = points - centre
        turning = arm[..., 0] * speed[..., 1] - arm[..., 1] * speed[..., 0]
        exact = np.einsum("i,ib->b", mass, turning) + np.einsum("i,ib->b", inertia, rate)
        np.testing.assert_allclose(found.angular, exact, atol=1e-7)
        last = slcp.momentum(x, slcp.Parameters(scene), scene.bodies[-1].name)
        np.testing.assert_allclose(last.linear, mass[-1] * speed[-1], atol=1e-7)
        np.testing.assert_allclose(last.place, points[-1], atol=1e-12)


@pytest.mark.parametrize("integrator, order", [("euler", 1.0), ("trapezoidal", 2.0)])
def test_in_flight_steps_keep_it_by_their_order(integrator, order):
    """Fast limbs: what is gained or lost over .1 s falls with the step size, or with its square."""
    scene = flyer()
    x0 = scene.state({"thigh.angle": 0.5, "shin.angle": -1.0, "shin.vangle": 20.0, "thigh.vangle": -5.0})
    lost = []
    for h in (0.01, 0.005, 0.0025):
        sim = slcp.Simulator(
            replace(scene, step_size=h), slcp.Options(integrator=integrator), dtype="float64", device="cpu",
            strategy="specialised",
        )  # fmt: skip
        run = sim.rollout(x0, steps=round(0.1 / h))
        found = run.momentum
        fallen = found.linear[-1] - found.linear[0] - [0.0, -9.81 * 0.1 * 8.0]
        lost.append([np.abs(fallen).max(), abs(found.angular[-1] - found.angular[0])])
    fell = np.log2(np.array(lost[:-1]) / np.array(lost[1:]))
    assert (np.abs(fell - order) < 0.35 * order).all(), (lost, fell)
    assert lost[0][0] > 0.1 if integrator == "euler" else lost[0][0] < 0.5


def test_contacts_give_it_what_gravity_takes():
    """Of bodies that are free by themselves to rounding, whatever touches: J' lambda is all that acts."""
    bodies = (Body("a", 1.0, 0.01, joint="free"), Body("b", 2.0, 0.02, joint="free"))
    shapes = (Shape("ground", None, "halfplane", angle=np.pi / 2), Shape("a", "a", "disc", 0.1),
              Shape("b", "b", "rectangle", (0.2, 0.1), corner_radius=0.01))  # fmt: skip
    contacts = (Contact("ground", "a", 0.4), Contact("ground", "b", 0.4), Contact("a", "b", 0.3))
    scene = Scene("two", bodies, shapes, contacts, step_size=0.01)
    sim = slcp.Simulator(scene, slcp.Options("hard", friction="coulomb"), dtype="float64", device="cpu")
    x0 = scene.state({"a.x": -0.5, "a.y": 0.15, "b.y": 0.12, "a.vx": 3.0, "b.angle": 0.2})
    run = sim.rollout(x0, steps=60, record=("impulse", "gap"))
    table, gained = run.contacts(), np.zeros((60, 2))
    ground = np.array([name.startswith("ground") for name in table["pair"]])
    forces = [table[name][ground] * scene.step_size for name in ("normal_force", "tangential_force")]
    np.add.at(gained, table["step"][ground], np.stack([-forces[1], forces[0]], -1))  # up, and to its left
    gained[:, 1] -= 3.0 * 9.81 * scene.step_size
    np.testing.assert_allclose(np.diff(run.momentum.linear, axis=0), gained, atol=1e-9)
    assert np.abs(gained).max() > 0.5 and not run.status


def test_what_does_not_fit_is_said():
    params = slcp.Parameters(flyer())
    with pytest.raises(slcp.ArgumentError, match=r"states has shape \(3,\); \(..., 10\) is needed"):
        slcp.momentum(np.zeros(3), params)
    with pytest.raises(slcp.ArgumentError, match=r"bodies names \['foot'\]; choose from"):
        slcp.momentum(np.zeros(10), params, "foot")
