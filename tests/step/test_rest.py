"""What lies still in double precision stays so: a gap that is a rounding of its lengths is none."""

from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp

LAWS = {"hard": {"residual": "hard"}, "coulomb": {"residual": "hard", "friction": "coulomb"}, "smoothed": {}}


def simulator(scene, law):
    return slcp.Simulator(scene, slcp.Options(**LAWS[law]), device="cpu", dtype="float64", strategy="generic")


def resting(rng):
    """A stack of unequal boxes somewhere on the ground, and its state."""
    masses = list(10.0 ** rng.uniform(-0.5, 0.5, int(rng.integers(8, 26))))
    scene = slcp.scenes.stack(len(masses), masses, float(rng.uniform(0.2, 1.0)), float(rng.uniform(0.1, 0.5)))
    x = scene.x0[None].copy()
    x[:, : scene.nv : 3] += rng.uniform(-30.0, 30.0)
    return scene, x


@pytest.mark.parametrize("law", LAWS)
def test_stacks_come_to_rest(law):
    """Gaps of 1e-16 to 4e-15 m, the rounding of heights of some metres, were answered in every step by speeds
    of 1e-12 m/s, sideways too, so that every step was another problem to solve.
    """
    rng = np.random.default_rng(3)
    for _ in range(6):
        scene, x = resting(rng)
        motion = simulator(scene, law).rollout(x, np.zeros((1, 300, 0)))
        assert motion.status[0] == slcp.Status.SOLVED
        late = motion.states[0, -50:, scene.nv :].reshape(50, -1, 3)
        assert np.abs(late[:, :, [0, 2]]).max() < 1e-13  # sideways and turning
        assert np.abs(late).max() < 1e-12
        assert np.abs(motion.states[0, -1] - x).max() < 1e-6


@pytest.mark.parametrize("aside, up", [(0.0, 0.0), (3e4, 0.0), (0.0, 3e4)])
def test_what_is_no_rounding_acts(aside, up):
    """A disc 2e-13 m inside the ground leaves it, one as far above sinks to it, also far to the side; 30 km
    up double precision, whose numbers are 4e-12 m apart there, does not tell.
    """
    scene = slcp.scenes.heap(1)
    ground = replace(scene.shapes[0], offset=(0.0, up))
    scene = replace(scene, shapes=(ground, *scene.shapes[1:]))
    x = np.tile(scene.x0, (2, 1))
    x[:, 0] = aside
    x[:, 1] += [up - 2e-13, up + 2e-13]
    rises = simulator(scene, "hard").step(x).state[:, scene.nv + 1] * 0.01
    np.testing.assert_allclose(rises, [0.0, 0.0] if up else [2e-13, -2e-13], atol=1e-15)


def corner_at_a_stop():
    """A paddle on a slider with a stop, and a disc on the floor that is driven against it."""
    bodies = (
        slcp.Body("paddle", 0.8, 0.01, joint="prismatic", lower=-0.1),
        slcp.Body("disc", 0.3, 3.75e-4, joint="free"),
    )
    shapes = (
        slcp.Shape("floor", None, "halfplane", angle=np.pi / 2),
        slcp.Shape("face", "paddle", "halfplane"),
        slcp.Shape("rim", "disc", "disc", 0.05),
    )
    contacts = (slcp.Contact("floor", "rim", friction=0.4), slcp.Contact("face", "rim", friction=0.4))
    return slcp.Scene("corner at a stop", bodies, shapes, contacts)


@pytest.mark.parametrize("law", LAWS)
def test_what_rests_against_a_stop_is_solved(law):
    """Nothing moves the paddle but the disc, which spins against it or lies there: its rows had no size of
    their own but roundings, and a fifth of these worlds ended NOT_CONVERGED. In the end all is at rest.
    """
    rng = np.random.default_rng(0)
    x = np.tile([-0.08, 0.2, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0], (128, 1))
    x[:, 5] = rng.uniform(-2.0, -0.2, 128)
    x[:, 7] = rng.normal(0.0, 10.0, 128)
    motion = simulator(corner_at_a_stop(), law).rollout(x, steps=200)
    assert (motion.status == slcp.Status.SOLVED).all()
    if law != "smoothed":  # whose noise lets discs creep
        assert motion.states[:, :, 0].min() > -0.1 - 1e-9  # the stop
        assert np.abs(motion.states[:, -1, 6]).max() < 1e-9  # nothing falls
        assert (motion.states[:, :, 1] - motion.states[:, :, 0]).min() > 0.05 - 1e-3  # the face


def pushed_stack(count, damping):
    """A stack on the floor, and a slider that damping brings to rest, whose tip touches the lowest box."""
    base = slcp.scenes.stack(count, 1.0, 0.5, 0.2)
    slider = slcp.Body("slider", 1.0, 1e-3, joint="prismatic", anchor=(-0.15, 0.08), damping=damping)
    face = slcp.Shape("face", "box0", "halfplane", offset=(-0.1, 0.0), angle=np.pi)
    tip = slcp.Shape("tip", "slider", "disc", 0.05)
    return replace(
        base, bodies=(slider, *base.bodies), shapes=(*base.shapes, face, tip),
        contacts=(*base.contacts, slcp.Contact("face", "tip", 0.2)), step_size=0.02,
        initial_state=(0.0, *base.x0[: base.nv], *np.zeros(base.nv + 1)),
    )  # fmt: skip


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("count, damping", [(1, 0.3), (5, 1.0)])
def test_what_comes_to_rest_beside_a_load_is_solved(law, count, damping):
    """The slider's momentum fades below the rounding of what the boxes press: a tenth of the worlds of five
    boxes ended NOT_CONVERGED under the hard law. What no row holds moves on as its damping has it.
    """
    scene = pushed_stack(count, damping)
    x = np.tile(scene.x0, (48, 1))
    x[:, scene.nv :] += np.random.default_rng(0).normal(0.0, 0.1, (48, scene.nv))
    motion = simulator(scene, law).rollout(x, steps=250, record="impulse")
    assert (motion.status == slcp.Status.SOLVED).all()
    v, alone = motion.states[:, :, scene.nv], (motion.impulse[:, :, -2:] == 0.0).all(axis=2)
    faded = v[:, 1:] * (1.0 + damping * scene.step_size)
    np.testing.assert_allclose(faded[alone], v[:, :-1][alone], rtol=1e-9)
    assert law == "smoothed" or alone.sum() > 1000


def pushed(scene, rng, worlds, steps):
    """States with velocities N(0, .5), and controls that change every 50 steps and end halfway."""
    x = np.tile(scene.x0, (worlds, 1))
    x[:, scene.nv :] += rng.normal(0.0, 0.5, (worlds, scene.nv))
    us = np.repeat(rng.normal(0.0, 0.5, (worlds, steps // 50, scene.nu)), 50, axis=1)
    us[:, steps // 2 :] = 0.0
    return x, us


@pytest.mark.parametrize("law", ["hard", "coulomb"])
def test_what_friction_holds_is_solved(law):
    """A finger at its stop that presses against a wheel at rest, whose momentum is 1e-20 N m s: of 200 worlds
    63 ended NOT_CONVERGED under Coulomb's law.
    """
    scene = slcp.tasks.flicking_finger().scene
    x, us = pushed(scene, np.random.default_rng(0), 96, 200)
    motion = simulator(scene, law).rollout(x, us)
    assert (motion.status == slcp.Status.SOLVED).all()
    assert np.abs(motion.states[:, :, scene.nv :]).max(axis=2).min(axis=1).min() < 1e-12  # some come to rest


@pytest.mark.parametrize("law", ["hard", "coulomb"])
def test_what_a_fallen_box_locks_is_solved(law):
    """Boxes that fall off a stack leave the lowest one askew on the slider, which two impulses of .3 N s
    hold: 7 of 200 worlds ended NOT_CONVERGED under Coulomb's law.
    """
    scene = replace(pushed_stack(3, 1.0), actuators=(slcp.Actuator("slider"),))
    x, us = pushed(scene, np.random.default_rng(0), 96, 300)
    assert (simulator(scene, law).rollout(x, us).status == slcp.Status.SOLVED).all()
