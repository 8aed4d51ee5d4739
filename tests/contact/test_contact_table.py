"""Contacts of a run as a table: what presses where balances what moves, body by body."""

from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Scene, Shape

LAWS = {"smoothed": slcp.Options(), "coulomb": slcp.Options("hard", friction="coulomb")}


def yard(turned):
    """Two boxes, a rod and two discs that fall on a slope, and into a bowl; `turned`: shape_b is shape_a."""
    shapes = (
        Shape("slope", None, "halfplane", angle=np.pi / 2 + 0.2),
        Shape("bowl", None, "ring", 2.0, offset=(0.0, 1.9)),
        Shape("block", "box", "rectangle", (0.2, 0.1), offset=(0.02, 0.0), angle=0.1, corner_radius=0.03),
        Shape("crate", "crate", "rectangle", (0.1, 0.15)),
        Shape("rod", "rod", "capsule", (0.05, 0.2)),
        Shape("ball", "ball", "disc", 0.1),
        Shape("egg", "egg", "disc", 0.12, offset=(0.03, 0.0)),
    )
    bodies = tuple(
        Body(n, m, 0.02 * m, joint="free")
        for n, m in (("box", 2.0), ("crate", 1.5), ("rod", 1.0), ("ball", 0.5), ("egg", 0.7))
    )
    return Scene("yard", bodies, shapes[::-1] if turned else shapes, "auto", friction=0.4, step_size=0.005)


def start(scene, rng):
    q = np.array([[-0.3, 0.5, 0.3], [-0.3, 0.85, 0.1], [0.35, 0.55, 1.0], [0.0, 0.75, 0.0], [0.0, 1.05, 0.0]])
    x = np.concatenate([q.ravel(), np.zeros(15)])
    return x + 0.02 * rng.standard_normal((2, 30))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("law", LAWS)
def test_forces_and_moments_of_the_table_are_those_that_bodies_feel(law, turned):
    scene = yard(turned)
    sim = slcp.Simulator(scene, LAWS[law], device="cpu", dtype="float64", strategy="generic")
    run = sim.rollout(start(scene, np.random.default_rng(0)), steps=160, record=("impulse", "gap"))
    assert not run.status.any()
    kinds = set()
    rows = [i for i, row in enumerate(scene.structure.rows) if row.sign >= 0]  # the first of every pair
    for world in range(2):
        table = run.contacts(world, least=0.0)
        h, x = scene.step_size, run.states[world]
        names = [body.name for body in scene.bodies]
        owner = {s.name: names.index(s.body) if s.body else -1 for s in scene.shapes}
        force, moment, apart = np.zeros((160, 5, 2)), np.zeros((160, 5)), np.zeros((160, 5))
        pairs = list(scene.pair_names)
        n = np.stack([table["normal_x"], table["normal_y"]], -1)
        t = np.stack([-n[:, 1], n[:, 0]], -1)
        push = table["normal_force"][:, None] * n + table["tangential_force"][:, None] * t
        for i, (step, pair) in enumerate(zip(table["step"], table["pair"])):
            place = np.array([table["x"][i], table["y"][i]])
            for sign, shape in zip((-1.0, 1.0), pair.split("/")):
                b = owner[shape.split("(")[0]]
                if b >= 0:
                    arm = place - x[step, 3 * b : 3 * b + 2]
                    force[step, b] += sign * push[i]
                    moment[step, b] += sign * (arm[0] * push[i, 1] - arm[1] * push[i, 0])
                    gap = run.gap[
                        world, step, rows[pairs.index(pair)]
                    ]  # the other side is touched so far off
                    apart[step, b] += np.abs(table["tangential_force"][i] * gap)
            kinds.add(pair)
        v = x[:, 15:].reshape(161, 5, 3)
        change = np.diff(v, axis=0) / h
        mass = np.array([body.mass for body in scene.bodies])
        felt = mass[:, None] * (change[..., :2] - np.array(scene.gravity))
        size = np.abs(felt).max()
        np.testing.assert_allclose(force, felt, atol=1e-4 * size)
        miss = np.abs(moment - 0.02 * mass * change[..., 2])
        assert (miss < 1e-4 * size + 1.001 * apart).all()
    assert len(kinds) > 6 and any("block" in kind and "crate" in kind for kind in kinds)


def test_a_table_has_what_presses_and_when():
    scene = slcp.scenes.stack(2)
    sim = slcp.Simulator(scene, LAWS["coulomb"], device="cpu", dtype="float64")
    run = sim.rollout(scene.x0, steps=5, record="impulse")
    table = run.contacts()
    assert set(table["step"]) == set(range(5)) and (table["normal_force"] > 0.0).all()
    np.testing.assert_allclose(table["time"], table["step"] * scene.step_size)
    weight = 9.81 * sum(body.mass for body in scene.bodies)
    below = table["y"] < 1e-6
    np.testing.assert_allclose(table["normal_force"][below].sum() / 5.0, weight, rtol=1e-6)
    lifted = replace(scene, gravity=(0.0, 0.0))
    none = slcp.Simulator(lifted, LAWS["coulomb"], device="cpu", dtype="float64")
    apart = scene.x0 + np.eye(12)[1] * 0.0 + np.eye(12)[4] * 1.0
    assert len(none.rollout(apart, steps=3, record="impulse").contacts(least=1e-6)["pair"]) == 0


def test_what_it_needs_is_said():
    scene = slcp.scenes.stack(2)
    sim = slcp.Simulator(scene, LAWS["coulomb"], device="cpu", dtype="float64")
    with pytest.raises(slcp.ArgumentError, match="impulse was not recorded"):
        sim.rollout(scene.x0, steps=2).contacts()
    run = sim.rollout(scene.x0, steps=2, record="impulse")
    with pytest.raises(slcp.ArgumentError, match="world is 1"):
        run.contacts(1)
    with pytest.raises(slcp.ArgumentError, match="least is -1"):
        run.contacts(least=-1.0)
