"""MuJoCo's fixed tendons: forces of random states beside MuJoCo's own, and what is refused."""

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp

mujoco = pytest.importorskip("mujoco")

HAND = """
<mujoco model="hand">
  <worldbody>
    <body name="palm" pos="0 0 .5">
      <joint name="lift" type="slide" axis="0 0 1" damping="2" ref=".3"/>
      <geom type="box" size=".1 .05 .02" mass="1"/><geom name="wrap" type="sphere" size=".01" mass="0"/>
      <body name="left" pos="-.1 0 -.05">
        <joint name="l" type="hinge" axis="0 1 0" ref=".1" damping=".1"/>
        <geom type="sphere" size=".01" pos="0 0 -.1" mass=".1"/>
        <body name="tip" pos="0 0 -.1">
          <joint name="lt" type="hinge" axis="0 1 0" damping=".02"/>
          <geom type="sphere" size=".01" pos=".02 0 -.06" mass=".05"/>
        </body>
      </body>
      <body name="right" pos=".1 0 -.05">
        <joint name="r" type="hinge" axis="0 -1 0"/>
        <geom type="sphere" size=".01" pos="0 0 -.1" mass=".1"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    {tendons}
  </tendon>
  <actuator>
    <motor joint="lift" gear="3"/>
    {actuators}
  </actuator>
</mujoco>
"""
TENDONS = """
<fixed name="grip" stiffness="30" damping=".4" springlength=".2">
  <joint joint="l" coef="1"/><joint joint="r" coef="-1"/>
</fixed>
<fixed name="flexor">
  <joint joint="l" coef=".02"/><joint joint="lt" coef=".015"/><joint joint="lift" coef="2"/>
</fixed>
<fixed stiffness="5"><joint joint="r" coef="2"/><joint joint="lift" coef="-1"/></fixed>
"""
ACTUATORS = '<motor tendon="flexor" gear="2"/><position tendon="grip" kp="12" kv=".5" gear="1.5"/>'


def model(tmp_path, tendons=TENDONS, actuators=ACTUATORS):
    path = tmp_path / "hand.xml"
    path.write_text(HAND.format(tendons=tendons, actuators=actuators))
    return path


def test_forces_are_mujocos(tmp_path):
    path = model(tmp_path)
    sc = slcp.load_mjcf(path)
    assert sc.control_names == ("palm.shift", "flexor", "grip")
    assert [tendon.name for tendon in sc.tendons] == ["grip", "flexor", "tendon2"]
    m = mujoco.MjModel.from_xml_path(str(path))
    data, oracle, rng = mujoco.MjData(m), Oracle(sc), np.random.default_rng(1)
    sense = np.array([1.0, -1.0, -1.0, 1.0])  # of hinges about +y
    for _ in range(20):
        q, v, u = 0.5 * rng.normal(size=4), rng.normal(size=4), rng.normal(size=3)
        data.qpos[:], data.qvel[:], data.ctrl[:] = m.qpos0 + sense * q, sense * v, u
        mujoco.mj_forward(m, data)
        force = sense * (data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias)
        np.testing.assert_allclose(oracle.force(q, v, u), force, rtol=1e-9, atol=1e-12)


REFUSED = {
    "spatial": (
        '<spatial name="s"><site site="a"/><geom geom="wrap"/><site site="b"/></spatial>',
        "only fixed tendons",
    ),
    "range": (
        '<fixed name="s" limited="true" range="0 1"><joint joint="l" coef="1"/></fixed>',
        "tendon 's': range is limited",
    ),
    "frictionloss": (
        '<fixed name="s" frictionloss=".1"><joint joint="l" coef="1"/></fixed>',
        "frictionloss is 0.1",
    ),
    "armature": ('<fixed name="s" armature=".1"><joint joint="l" coef="1"/></fixed>', "armature is 0.1"),
    "slack": (
        '<fixed name="s" stiffness="1" springlength="0 .1"><joint joint="l" coef="1"/></fixed>',
        "tendon 's': its spring is slack from 0 to 0.1",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused(tmp_path, name):
    tendons, message = REFUSED[name]
    path = model(tmp_path, tendons, "")
    text = path.read_text()
    for place, site in (
        ('<geom type="box"', "a"),
        ('<geom type="sphere" size=".01" pos="0 0 -.1" mass=".1"/>', "b"),
    ):
        text = text.replace(place, f'<site name="{site}"/>{place}', 1)
    path.write_text(text)
    with pytest.raises(slcp.MjcfError, match=message):
        slcp.load_mjcf(path)
    assert not slcp.load_mjcf(path, left_out=("tendons",)).tendons


def test_what_pulls_at_tendons_that_are_left_out_is_refused(tmp_path):
    with pytest.raises(slcp.MjcfError, match="an actuator acts on a tendon, and tendons are left out"):
        slcp.load_mjcf(model(tmp_path), left_out=("tendons",))


def test_a_constant_pull_needs_a_spring(tmp_path):
    pull = '<general tendon="flexor" biastype="affine" biasprm="2 0 0" gainprm="1"/>'
    with pytest.raises(slcp.MjcfError, match="tendon 'flexor': an actuator pulls it by 2 without a control"):
        slcp.load_mjcf(model(tmp_path, actuators=pull))
    sprung = TENDONS.replace('name="flexor"', 'name="flexor" stiffness="4" springlength=".1"')
    found = slcp.load_mjcf(model(tmp_path, sprung, pull)).tendons[1]
    assert found.length == pytest.approx(0.1 + 2.0 / 4.0 - 0.02 * np.deg2rad(0.1) - 2.0 * 0.3)


def test_a_spring_whose_stiffness_a_servo_takes_away_still_pulls(tmp_path):
    away = '<general tendon="flexor" biastype="affine" biasprm="0 1 0" gear="2"/>'
    sprung = TENDONS.replace('name="flexor"', 'name="flexor" stiffness="4" springlength=".3"')
    with pytest.raises(
        slcp.MjcfError, match="tendon 'flexor': an actuator pulls it by 1.2 without a control"
    ):
        slcp.load_mjcf(model(tmp_path, sprung, away))
    path = model(tmp_path, "", '<general joint="r" biastype="affine" biasprm="0 1 0" gear="2"/>')
    path.write_text(path.read_text().replace('name="r"', 'name="r" stiffness="4" springref="20"'))
    with pytest.raises(slcp.MjcfError, match="joint 'r': an actuator pushes it by 1.39.* without a control"):
        slcp.load_mjcf(path)


def test_a_tendon_may_be_called_as_a_body_there(tmp_path):
    tendons = TENDONS.replace('name="grip"', 'name="tip"')
    sc = slcp.load_mjcf(model(tmp_path, tendons, ACTUATORS.replace('tendon="grip"', 'tendon="tip"')))
    assert sc.control_names[-1] == sc.tendons[0].name == "tip_tendon"


def test_ranges_of_controls_are_limits_of_a_task(tmp_path):
    limited = (
        '<motor tendon="flexor" ctrllimited="true" ctrlrange="-1 2"/><motor joint="r" ctrlrange="-.5 .5"/>'
    )
    path = model(tmp_path, actuators=limited)
    lower, upper = slcp.mjcf_control_limits(path)
    assert lower.tolist() == [-np.inf, -1.0, -0.5] and upper.tolist() == [np.inf, 2.0, 0.5]
    task = slcp.Task("grip", slcp.load_mjcf(path), duration=0.1, control_limits=(lower, upper))
    push = slcp.policies.Linear(np.zeros((3, 8)), np.zeros(8), [5.0, 5.0, -5.0])
    held = slcp.policies.Linear(np.zeros((3, 8)), np.zeros(8), [5.0, 2.0, -0.5])
    end = {name: slcp.measures.final(name) for name in ("palm.shift", "left.angle", "right.angle")}
    rows = slcp.sweep(
        task.replace(measures=end), {"push": push, "held": held}, worlds=1, cases=slcp.Options()
    )
    for name in end:
        assert rows.part("push")[name] == rows.part("held")[name] != 0.0
    with pytest.raises(FileNotFoundError):
        slcp.mjcf_control_limits(tmp_path / "none.xml")
