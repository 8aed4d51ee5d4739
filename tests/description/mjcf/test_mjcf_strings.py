"""MuJoCo's tendons from site to site, dry friction of its joints: beside MuJoCo, and what is refused."""

import numpy as np
import pytest
from mujoco_beside import compare, mujoco, turn_of

import slcp_warp as slcp

COULOMB = slcp.Options("hard", friction="coulomb")
HUNG = """
<mujoco model="hung">
  <option timestep=".005"/>
  <worldbody>
    <geom name="ground" type="plane" size="1 1 1"/>
    <site name="hook" pos=".1 0 2"/><site name="peg" pos="0 0 1"/>
    <body name="arm" pos="0 0 1.5">
      <joint name="shoulder" type="hinge" axis="0 1 0" ref=".3" damping=".1"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" mass="1" contype="0" conaffinity="0"/>
      <body name="held" pos=".5 0 0">
        <geom type="sphere" size=".03" mass=".1" contype="0" conaffinity="0"/>
        <site name="tip" pos=".03 0 .01"/>
      </body>
    </body>
    <body name="bob" pos=".6 0 1.2">
      <joint name="bx" type="slide" axis="1 0 0"/><joint name="bz" type="slide" axis="0 0 1"/>
      <joint name="bt" type="hinge" axis="0 -1 0"/>
      <geom name="bob" type="sphere" size=".05" mass=".4"/>
      <site name="top" pos="0 {beside} .05"/>
    </body>
  </worldbody>
  <tendon>{tendons}</tendon>
  <actuator>{actuators}</actuator>
</mujoco>
"""
SPRINGS = """
<spatial name="spring" stiffness="40" damping=".6" springlength=".2">
  <site site="tip"/><site site="top"/>
</spatial>
<spatial damping="2"><site site="hook"/><site site="tip"/></spatial>
<spatial name="still" stiffness="9" springlength=".1"><site site="hook"/><site site="peg"/></spatial>
"""
ROPE = """
<spatial name="rope" limited="true" range="{low} .5"><site site="hook"/><site site="top"/></spatial>
"""


def written(tmp_path, tendons="", actuators="", beside="0", text=HUNG):
    path = tmp_path / "hung.xml"
    path.write_text(text.format(tendons=tendons, actuators=actuators, beside=beside))
    return path


def test_springs_and_dampers_are_mujocos(tmp_path):
    path = written(tmp_path, SPRINGS)
    model, scene = mujoco.MjModel.from_xml_path(str(path)), slcp.load_mjcf(path)
    assert len(scene.springs) == 2 and not scene.tendons and scene.contacts == "auto"
    mass, force = compare(scene, model, turn_of(model))
    assert mass < 1e-9 and force < 1e-5  # lengths are rounded at zero by a thousandth (M26)


@pytest.mark.parametrize("law", [slcp.Options("hard"), COULOMB])
def test_ranges_are_ropes_and_keep_apart(tmp_path, law):
    """The bob falls until the rope is straight, and hangs from it by its weight; thrown up it stays away."""
    scene = slcp.load_mjcf(written(tmp_path, ROPE.format(low=".2")))
    rope, apart = (scene.pair_names.index(name) for name in ("rope/rope_end", "rope_from/rope_to"))
    sim = slcp.Simulator(scene, law, device="cpu", dtype="float64", strategy="generic")
    x0 = np.tile(scene.x0, (2, 1))
    x0[:, scene.state_index("bob.x")] = -0.5  # 40 cm below the hook
    x0[:, scene.state_index("bob.y")] = 0.35
    x0[1, scene.state_index("bob.vy")] = 5.0
    traj = sim.rollout(x0, np.zeros((2, 400, 0)), record=("gap", "impulse"))
    assert not traj.status.any()
    assert np.nanmin(traj.gap) > -1e-3
    weight = 0.4 * 9.81 * scene.step_size
    np.testing.assert_allclose(traj.contact_impulse[0, -1, rope], [weight, 0.0], atol=1e-6)
    assert traj.contact_impulse[1, :, apart, 0].max() > 1.0 and not traj.contact_impulse[0, :, apart].any()
    assert len(scene.all_contacts) == len(slcp.load_mjcf(written(tmp_path)).all_contacts) + 2


def test_one_range_to_zero_is_a_rope_alone(tmp_path):
    scene = slcp.load_mjcf(written(tmp_path, ROPE.format(low="0")))
    assert [shape.name for shape in scene.shapes[-2:]] == ["rope", "rope_end"]
    assert slcp.Parameters(scene)["rope.radius"].max() == 0.5


@pytest.mark.parametrize("tendons, actuators, beside, message", [
    (ROPE.format(low="0"), "", ".1", "tendon 'rope': its sites are 0.1 m apart along the normal"),
    (ROPE.format(low="0"), '<motor name="winch" tendon="rope"/>', "0", "'winch': tendon 'rope' is not fixed"),
    ('<spatial stiffness="3" springlength="0 .4"><site site="tip"/><site site="top"/></spatial>', "", "0",
     "tendon 'tendon0': its spring is slack from 0 to 0.4"),
    ('<spatial><site site="tip"/><geom geom="bob"/><site site="top"/></spatial>', "", "0",
     "tendon 'tendon0': only fixed tendons, of joints, and those from one site to another"),
    ('<spatial name="s" range="0 1" limited="true"><site site="tip"/><site site="peg"/><site site="top"/>'
     "</spatial>", "", "0", "tendon 's': range is limited; it is not supported"),
    ('<spatial name="s" frictionloss="1"><site site="tip"/><site site="top"/></spatial>', "", "0",
     "tendon 's': frictionloss is 1.0"),
])  # fmt: skip
def test_what_is_not_straight_is_refused(tmp_path, tendons, actuators, beside, message):
    with pytest.raises(slcp.MjcfError, match=message):
        slcp.load_mjcf(written(tmp_path, tendons, actuators, beside), brakes=True)


SLIDER = """
<mujoco model="slider">
  <option timestep=".005"/>
  <worldbody>
    <body name="cart" pos="0 0 1">
      <joint name="slide" type="slide" axis="1 0 0" frictionloss="2"/>
      <geom name="cart" type="sphere" size=".1" mass="2"/>
      <body name="wheel" pos="0 0 .3">
        <joint name="hinge" type="hinge" axis="0 1 0" frictionloss=".3"/>
        <geom name="wheel" type="sphere" size=".1" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="slide"/><motor joint="hinge"/></actuator>
</mujoco>
"""


def test_dry_friction_of_joints_is_that_of_brakes(tmp_path):
    """Below what it holds nothing moves, above the rest accelerates; geoms touch nothing more."""
    path = written(tmp_path, text=SLIDER)
    with pytest.raises(slcp.MjcfError, match=r"joint 'slide': frictionloss is 2.0; .* brakes=True"):
        slcp.load_mjcf(path)
    scene = slcp.load_mjcf(path, brakes=True)
    assert [body.name for body in scene.bodies] == ["cart", "wheel", "cart_pad", "wheel_pad"]
    assert scene.state_names[:2] == ("cart.shift", "wheel.angle") and len(scene.pair_names) == 2
    sim = slcp.Simulator(scene, COULOMB, device="cpu", dtype="float64", strategy="generic")
    us = np.repeat([[[1.98, 0.297]], [[2.6, 0.4]]], 100, axis=1)
    traj = sim.rollout(np.tile(scene.x0, (2, 1)), us)
    assert not traj.status.any()
    speed = traj.states[:, -1, scene.nv : scene.nv + 2]
    np.testing.assert_allclose(speed[0], 0.0, atol=1e-9)
    inertia = 0.4 * 1.0 * 0.1**2
    np.testing.assert_allclose(np.abs(speed[1]), [0.6 / 3.0 * 0.5, 0.1 / inertia * 0.5], rtol=1e-3)
    alone = slcp.load_mjcf(path, left_out="frictionloss", brakes=True)
    assert len(alone.bodies) == 2
    free = SLIDER.replace('axis="1 0 0" frictionloss="2"', 'axis="1 0 0"').replace(
        '<joint name="hinge"', '<joint name="x" type="slide" axis="1 0 0" frictionloss="1"/>'
        '<joint name="z" type="slide" axis="0 0 1"/><joint name="hinge"')  # fmt: skip
    with pytest.raises(slcp.MjcfError, match="joint 'x': frictionloss is 1; a joint that turns or shifts"):
        slcp.load_mjcf(written(tmp_path, text=free), brakes=True)
