"""Brakes hold what they are told, and no more, wherever the joint is."""

import itertools

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Actuator, Body, Scene, Shape

LAWS = {
    "smoothed": slcp.Options(),
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}
SLOPE = 0.4


def carriage(holds):
    """A wheel on a carriage on a slope, both braked; they weigh 2 kg, and the wheel is balanced."""
    along = (np.cos(SLOPE), np.sin(SLOPE))
    arm = Body("arm", 1.0, 0.05, joint="prismatic", axis=along, angle=0.3)
    wheel = Body("wheel", 1.0, 0.01, parent="arm", anchor=(0.2, 0.1), angle=0.7)
    pads, shoes, rubs = zip(slcp.brake(arm, 10.0 * holds), slcp.brake(wheel, holds, radius=0.03))
    shapes = tuple(itertools.chain(*shoes))
    motors = (Actuator("arm"), Actuator("wheel"))
    return Scene("carriage", (arm, wheel, *pads), shapes, rubs, motors)


@pytest.mark.parametrize("strategy, dtype", [("generic", "float64"), ("specialised", "float32")])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("holds", [1e-3, 0.05, 5.0])
def test_it_holds_below_and_slides_above(law, strategy, dtype, holds):
    """Of 1.2 times what is held .2 is left, with the inertias 2 kg and .01 kg m^2."""
    scene = carriage(holds)
    sim = slcp.Simulator(scene, LAWS[law], device="cpu", strategy=strategy, dtype=dtype)
    weight = 2.0 * 9.81 * np.sin(SLOPE)
    share = np.array([0.97, -0.97, 1.2, -1.2])
    us = np.repeat(np.stack([weight + 10.0 * holds * share, holds * share], 1)[:, None], 100, 1)
    traj = sim.rollout(np.tile(scene.x0, (4, 1)), us)
    assert not traj.status.any()
    moves = traj.states[:, -1, scene.nv : scene.nv + 2]
    fast = np.array([10.0 * holds * 0.2 / 2.0, holds * 0.2 / 0.01])
    rounds = 5e-4 if dtype == "float32" else 0.0  # of speeds, beside a weight of 7.6 N
    assert (np.abs(moves[:2]) < (0.25 if law == "smoothed" else 2e-3) * fast + rounds).all()
    np.testing.assert_allclose(moves[2:] / fast, [[1, 1], [-1, -1]], atol=0.35 if law == "smoothed" else 4e-3)


@pytest.mark.parametrize("law", ["hard", "coulomb"])
def test_what_turns_fast_is_braked_as_much(law):
    """At 1,000 rad/s the pad is lifted by 25 cm under Anitescu's friction, and presses the same."""
    wheel = Body("wheel", 1.0, 0.01)
    pad, shoes, rubs = slcp.brake(wheel, 0.05)
    scene = Scene("wheel", (wheel, pad), shoes, (rubs,))
    sim = slcp.Simulator(scene, LAWS[law], device="cpu", dtype="float64", strategy="specialised")
    speed = sim.rollout(scene.state({"wheel.vangle": 1000.0}), steps=60).states[:, scene.nv]
    np.testing.assert_allclose(speed[-1] - speed[10], -0.05 * 50, rtol=1e-4)


def test_what_slides_comes_to_rest_in_time():
    """A wheel of 3 rad/s is braked by 5 rad/s^2, and then stays."""
    wheel = Body("wheel", 1.0, 0.01)
    pad, shoes, rubs = slcp.brake(wheel, 0.05)
    scene = Scene("wheel", (wheel, pad), shoes, (rubs,))
    sim = slcp.Simulator(scene, LAWS["coulomb"], device="cpu", dtype="float64", strategy="specialised")
    speed = sim.rollout(scene.state({"wheel.vangle": 3.0}), steps=100).states[:, scene.nv]
    np.testing.assert_allclose(speed, np.maximum(3.0 - 0.05 * np.arange(101), 0.0), atol=1e-3)


def test_where_everything_may_touch_pads_meet_their_rims_alone():
    arm = Body("arm", 1.0, 0.01)
    pad, shoes, _ = slcp.brake(arm, 0.1, friction=0.4, bit=2)
    ground = Shape("ground", None, "halfplane", angle=np.pi / 2)
    tip = Shape("tip", "arm", "disc", 0.02, (0.5, 0.0))
    scene = Scene("arm", (arm, pad), (ground, tip, *shoes), "auto", friction=0.3)
    assert scene.pair_names == ("ground/tip", "arm_lining/arm_rim")
    assert scene.all_contacts[1].friction == 0.4


@pytest.mark.parametrize("make, message", [
    (lambda: slcp.brake(Body("b", 1.0, 0.1, joint="free"), 1.0), "'b': its joint is 'free'; a brake needs"),
    (lambda: slcp.brake(Body("b", 1.0, 0.1), 0.0), "holds is 0.0; a positive"),
    (lambda: slcp.brake(Body("b", 1.0, 0.1), 1.0, friction=0.0), "friction is 0.0; a positive"),
    (lambda: slcp.brake("b", 1.0), "body is a str; a Body is needed"),
])  # fmt: skip
def test_what_cannot_be_is_named(make, message):
    with pytest.raises(slcp.InputError, match=message):
        make()
