"""Servos against their law, kp (u - q) - kv q', and a pendulum that is held where it is told to be."""

import numpy as np
import pytest

import slcp_warp as slcp


def run(bodies, actuators, u, x0=None, steps=400, h=0.005):
    scene = slcp.Scene("servo", tuple(bodies), actuators=tuple(actuators), gravity=(0.0, 0.0), step_size=h)
    sim = slcp.Simulator(scene, slcp.Options("hard"), device="cpu", dtype="float64")
    return sim.rollout(scene.x0 if x0 is None else np.array(x0), np.tile(u, (steps, 1)))


@pytest.mark.parametrize("joint", ["prismatic", "revolute"])
def test_a_critical_servo_comes_without_overshoot_and_stays(joint):
    """q = u (1 - (1 + w t) exp(-w t)), w^2 = kp / m, to the error of the step's first order."""
    body, motor = slcp.servo(slcp.Body("slide", 2.0, 0.05, joint=joint, com=(0.1, 0.0)), 50.0)
    inert = 2.0 if joint == "prismatic" else 0.05 + 2.0 * 0.1**2
    assert body.damping == pytest.approx(2.0 * np.sqrt(50.0 * inert))
    w, h = np.sqrt(50.0 / inert), 2e-4
    states = run([body], [motor], [0.3], steps=4000, h=h).states
    time = h * np.arange(4001)
    expected = 0.3 * (1.0 - (1.0 + w * time) * np.exp(-w * time))
    np.testing.assert_allclose(states[:, 0], expected, atol=0.3 * w * h)
    assert states[:, 0].max() <= 0.3 + 1e-12 and states[-1, 0] > 0.27


def test_what_a_joint_has_of_its_own_stays():
    own = slcp.Body("slide", 1.0, 0.01, joint="prismatic", stiffness=20.0, rest=0.4, damping=3.0)
    body, motor = slcp.servo(own, 60.0, damping=5.0)
    assert (body.stiffness, body.damping, motor.gear) == (80.0, 8.0, 60.0)
    rests = run([body], [motor], [0.1], steps=4000).states[-1, 0]
    assert rests == pytest.approx((20.0 * 0.4 + 60.0 * 0.1) / 80.0, abs=1e-9)


def test_one_degree_of_freedom_of_a_free_body():
    free = slcp.Body("ship", 2.0, 0.1, joint="free", armature=(0.0, 0.0, 0.3))
    body, motor = slcp.servo(free, 10.0, dof=2)
    assert body.stiffness == (None, None, 10.0) and motor.dof == 2
    assert body.damping == (0.0, 0.0, pytest.approx(2.0 * np.sqrt(10.0 * 0.4)))
    end = run([body], [motor], [0.5], x0=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0], steps=2000).states[-1]
    np.testing.assert_allclose(end, [10.0, 0.0, 0.5, 1.0, 0.0, 0.0], atol=1e-9)


def test_a_servo_that_is_faster_than_the_step_rings_and_does_not_diverge():
    arrives, _ = slcp.servo(slcp.Body("slide", 1.0, 0.01, joint="prismatic"), 1e3)
    rings, _ = slcp.servo(slcp.Body("slide", 1.0, 0.01, joint="prismatic"), 1e8)
    states = run([arrives], [slcp.Actuator("slide", gear=1e3)], [0.2], steps=50, h=0.02).states
    assert states[-1, 0] == pytest.approx(0.2, abs=1e-6) and states[:, 0].max() < 0.21
    states = run([rings], [slcp.Actuator("slide", gear=1e8)], [0.2], steps=2000, h=0.02).states
    assert np.abs(states[:, 0] - 0.2).max() <= 0.2 + 1e-12


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"body": "slide", "stiffness": 1.0}, "body is a str; a Body is needed"),
        ({"stiffness": 0.0}, "stiffness is 0"),
        ({"stiffness": np.nan}, "stiffness is nan"),
        ({"stiffness": 1.0, "damping": -1.0}, "damping is -1"),
        ({"stiffness": 1.0, "dof": 1}, "dof is 1; joint 'prismatic' has 1, from 0"),
    ],
)
def test_what_cannot_be_is_said(given, says):
    body = slcp.Body("slide", 1.0, 0.01, joint="prismatic")
    with pytest.raises(slcp.InputError, match=says):
        slcp.servo(**({"body": body} | given))


def test_a_limited_servo_is_a_servo_until_its_limit():
    """The same motion while 3 N suffice, to where the spring is met (both half a step late); a stall at 3 N
    against what stands in its way, a fall at what it cannot hold.
    """
    body = slcp.Body("slide", 2.0, 0.05, joint="prismatic")
    told, motor = slcp.servo(body, 50.0)
    tendon, limited = slcp.limited_servo(body, 50.0, 3.0)
    assert (tendon.name, limited.tendon, limited.gear) == ("slide_servo", "slide_servo", 50.0)
    assert tendon.damping == told.damping
    near = run([told], [motor], [0.05]).states
    scene = slcp.Scene("limited", (body,), actuators=(limited,), tendons=(tendon,), gravity=(0.0, 0.0),
                       step_size=0.005)  # fmt: skip
    sim = slcp.Simulator(scene, slcp.Options("hard"), device="cpu", dtype="float64")
    np.testing.assert_allclose(sim.rollout([0.0, 0.0], np.full((400, 1), 0.05)).states, near, atol=1e-13)
    far = sim.rollout([0.0, 0.0], np.full((400, 1), 5.0)).states
    assert np.diff(far[:, 1]).max() / 0.005 == pytest.approx(3.0 / 2.0, rel=1e-12)


def test_names_of_limited_servos():
    free = slcp.Body("ship", 2.0, 0.1, joint="free")
    servos = [slcp.limited_servo(free, 5.0, 1.0, dof=i) for i in range(3)]
    assert [t.coordinates for t, _ in servos] == [("ship.x",), ("ship.y",), ("ship.angle",)]
    tendons, actuators = zip(*servos)
    scene = slcp.Scene("ship", (free,), actuators=actuators, tendons=tendons)
    assert scene.control_names == ("ship_x_servo", "ship_y_servo", "ship_angle_servo")
    numbers = slcp.Parameters(scene).replace(**{"ship_y_servo.tendon_force_limit": 2.0})
    assert numbers["tendon_force_limit"].tolist() == [1.0, 2.0, 1.0]
    with pytest.raises(slcp.SceneError, match="force_limit is 0"):
        slcp.limited_servo(free, 5.0, 0.0)


def test_a_file_keeps_limits(tmp_path):
    body = slcp.Body("slide", 2.0, 0.05, joint="prismatic")
    tendon, motor = slcp.limited_servo(body, 50.0, 3.0)
    scene = slcp.Scene("limited", (body,), actuators=(motor,), tendons=(tendon,))
    slcp.save_scene(scene, tmp_path / "scene.json")
    assert slcp.load_scene(tmp_path / "scene.json") == scene
