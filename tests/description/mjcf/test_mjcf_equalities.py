"""MuJoCo's equality constraints of joints and tendons: held as stiffly as the rule says, moving as what they
hold moves, and what is refused.
"""

import mujoco_beside
import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp
from slcp_warp.description.mjcf.equalities import RIGID

mujoco = pytest.importorskip("mujoco")

# hinges about +y and -y and a slide, at reference positions that are not zero; the tip over a floor
ARM = """
<mujoco model="arm">
  <option timestep=".002"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="floor" type="plane" pos="0 0 -.45" size="5 5 1" contype="1" conaffinity="1"/>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" ref="20" damping=".02"/>
      <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="1"/>
      <body name="lower" pos=".3 0 0">
        <joint name="elbow" axis="0 -1 0" ref="-10"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .25 0 0" mass=".5"/>
        <body name="hand" pos=".25 0 0">
          <joint name="reach" type="slide" axis="1 0 0" ref=".1" damping="1"/>
          <geom name="tip" type="sphere" size=".02" mass=".1" contype="1" conaffinity="1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="belt"><joint joint="shoulder" coef=".05"/><joint joint="elbow" coef=".085"/></fixed>
    <fixed name="screw"><joint joint="reach" coef="3"/></fixed>
    <fixed name="nut"><joint joint="elbow" coef=".06"/></fixed>
  </tendon>
  <equality>{equality}</equality>
  <keyframe><key qpos="0.4490658503988659 -0.17453292519943295 .1"/></keyframe>
  <actuator><motor joint="shoulder" gear="3"/><motor joint="elbow"/></actuator>
</mujoco>
"""
JOINTS = (
    '<joint name="gear" joint1="shoulder" joint2="elbow" polycoef=".1 -1.7"/>'
    '<joint joint1="reach" joint2="elbow" polycoef="0 .02"/>'
)
TENDONS = (  # the same
    '<tendon name="belt" tendon1="belt" polycoef=".005"/>'
    '<tendon tendon1="screw" tendon2="nut" polycoef="0 1"/>'
)
ALONG = np.array([1.7, 1.0, 0.02])  # our coordinates by the elbow's: the shoulder turns against ours
AT = np.array([-0.1, 0.0, 0.0])
LAWS = {
    "smoothed": slcp.Options(),
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}


def written(folder, equality=JOINTS, text=ARM):
    path = folder / "model.xml"
    path.write_text(text.replace("{equality}", equality))
    return path


def off(states):
    """By how much the two constraints of the arm are missed, (..., 2)."""
    upper, lower, hand = (states[..., i] for i in range(3))
    return np.stack([-upper - 0.1 + 1.7 * lower, hand - 0.02 * lower], axis=-1)


def starts(scene, count):
    """States on the constraints, above the floor."""
    elbow = np.random.default_rng(0).uniform(-0.6, 0.6, 4 * count)[:, None]
    q = AT + ALONG * elbow
    gaps = slcp.Simulator(scene, device="cpu", strategy="generic").step(np.hstack([q, 0.0 * q])).gap
    q = q[np.asarray(gaps).min(axis=1) > 0.02][:count]
    assert len(q) == count
    return np.hstack([q, 0.0 * q])


@pytest.mark.parametrize("equality", [JOINTS, TENDONS], ids=["joints", "tendons"])
def test_stiffness_is_that_of_the_rule(tmp_path, equality):
    """R m/h^2 and 2 k h by MuJoCo's mass matrix at qpos0, with 1 for the largest coefficient."""
    path = written(tmp_path, equality)
    scene, m = slcp.load_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(m)
    mujoco.mj_forward(m, data)
    inverse = np.linalg.inv(mujoco_beside.full_matrix(m, data))
    first, second = scene.tendons[-2:]
    assert first.coordinates == ("upper.angle", "lower.angle")
    assert second.coordinates == ("lower.angle", "hand.shift")
    assert np.divide(first.coefficients, first.coefficients[1]) == pytest.approx([-1.0 / 1.7, 1.0])
    assert second.coefficients == pytest.approx((-0.02, 1.0))
    assert first.length / first.coefficients[0] == pytest.approx(-0.1) and second.length == 0.0
    for tendon, row in ((first, [1.0 / 1.7, 1.0, 0.0]), (second, [0.0, -0.02, 1.0])):
        mass = 1.0 / (row @ inverse @ row)
        assert tendon.stiffness == pytest.approx(RIGID * mass / 0.002**2)
        assert tendon.damping == pytest.approx(2.0 * tendon.stiffness * 0.002)


@pytest.mark.parametrize("law", LAWS)
def test_what_is_held_is_held_under_load(tmp_path, law, dtype):
    """Random torques, the tip hitting the floor: solved, and off by less than a force moves in a step / R."""
    scene = slcp.load_mjcf(written(tmp_path))
    x, rng = starts(scene, 64), np.random.default_rng(1)
    u = np.repeat(rng.normal(size=(64, 20, 2)), 25, axis=1)
    sim = slcp.Simulator(scene, LAWS[law], dtype=dtype.__name__, device="cpu")
    run = sim.rollout(x, u, record="gap")
    assert np.all(np.asarray(run.status) == slcp.Status.SOLVED)
    states = np.asarray(run.states, float)
    if law != "smoothed":
        assert np.asarray(run.gap).min() < 1e-4  # it hits the floor
    assert np.abs(off(states)).max() < 2e-3 and np.abs(off(states)).mean() < 6e-4
    assert np.ptp(states[..., 1]) > 0.8


@pytest.mark.parametrize("equality", [JOINTS, TENDONS], ids=["joints", "tendons"])
def test_motion_is_that_of_the_held_mechanism(tmp_path, equality):
    """Of one coordinate, by Runge-Kutta with the oracle's forces: the error is of the first order in h.
    MuJoCo's own constraints yield more.
    """
    path = written(tmp_path, equality)
    scene, m = slcp.load_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    free = Oracle(slcp.load_mjcf(path, left_out=("equality constraints",)))
    u, there = np.array([0.8, -0.3]), {}

    def slope(z):
        q, v = AT + ALONG * z[0], ALONG * z[1]
        return np.array([z[1], ALONG @ free.force(q, v, u) / (ALONG @ free.mass_matrix(q) @ ALONG)])

    z, step = np.array([0.3, 0.0]), 1e-3
    for _ in range(250):
        k1 = slope(z)
        k2 = slope(z + step / 2 * k1)
        k3 = slope(z + step / 2 * k2)
        z = z + step / 6 * (k1 + 2 * k2 + 2 * k3 + slope(z + step * k3))
    exact = [*(AT + ALONG * z[0]), *(ALONG * z[1])]
    sim = slcp.Simulator(scene, slcp.Options("hard"), dtype="float64", device="cpu", strategy="generic")
    start = [*(AT + ALONG * 0.3), 0.0, 0.0, 0.0]
    for h in (1e-3, 5e-4):
        run = sim.rollout(start, np.tile(u, (1, round(0.25 / h), 1)), sim.params.replace(step_size=h))
        there[h] = np.asarray(run.states).reshape(-1, 6)
    errors = [np.abs(there[h][-1] - exact).max() for h in (1e-3, 5e-4)]
    assert errors[0] < 0.02 and 0.4 < errors[1] / errors[0] < 0.6

    data, turn = mujoco.MjData(m), np.diag(mujoco_beside.turn_of(m))
    data.qpos[:], data.ctrl[:] = m.qpos0 + turn * start[:3], u
    theirs = []
    for _ in range(125):
        mujoco.mj_step(m, data)
        theirs.append(off(turn * (data.qpos - m.qpos0)))
    assert np.abs(off(there[1e-3])).max() < 0.1 * np.abs(theirs).max() < 0.1 * 0.02


GRIPPER = """
<mujoco model="gripper">
  <option timestep=".001"/>
  <default><geom mass=".02" contype="2" conaffinity="0"/></default>
  <worldbody>
    <geom name="wall" type="plane" pos="0 .2 .5" zaxis="0 -1 0" size="1 1 1" contype="1" conaffinity="2"/>
    <body name="palm" pos="0 0 .5">
      <joint name="lift" type="slide" axis="0 0 1"/>
      <geom name="palm" type="capsule" fromto="-.03 0 0 .03 0 0" size=".01" mass=".2"/>
      <body name="thumb" pos=".03 0 .045" euler="0 -90 0">
        <joint name="thumb" axis="0 -1 0" range="-10 60" limited="true" damping=".01"/>
        <geom name="thumb" type="capsule" fromto="0 0 0 .02 0 -.01" size=".007"/>
        <body name="thumbtip" pos=".05 .01 -.01"><joint name="thumbtip" axis="0 -1 0" stiffness=".01"/>
          <geom name="thumbtip" type="sphere" pos=".003 0 0" size=".008"/></body>
      </body>
      <body name="finger" pos="-.03 0 .045" euler="0 90 180">
        <joint name="finger" axis="0 -1 0" range="-10 60" limited="true" damping=".01"/>
        <geom name="finger" type="capsule" fromto="0 0 0 .02 0 -.01" size=".007"/>
        <geom name="nail" type="box" pos=".02 0 -.03" euler="0 20 0" size=".01 .01 .003"/>
        <body name="fingertip" pos=".05 .01 -.01"><joint name="fingertip" axis="0 -1 0" stiffness=".01"/>
          <geom name="fingertip" type="sphere" pos=".003 0 0" size=".008"/>
          <body pos="0 0 .02" euler="180 0 0"><geom name="welded" type="sphere" pos=".01 0 .03" size=".002"/>
            <body pos=".01 0 0" euler="0 30 0"><joint type="slide" axis="1 0 0" stiffness="50"/>
              <geom name="claw" type="capsule" fromto="0 0 0 0 0 .02" size=".004"/></body></body></body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="grasp"><joint joint="thumb" coef=".5"/><joint joint="finger" coef=".5"/></fixed>
    <fixed name="coupling"><joint joint="thumb" coef="-.5"/><joint joint="finger" coef=".5"/></fixed>
  </tendon>
  <equality>{equality}</equality>
  <actuator><motor tendon="grasp"/><motor joint="lift" gear="5"/></actuator>
</mujoco>
"""
COUPLING = '<tendon name="coupling" tendon1="coupling"/>'


def test_bodies_that_are_mirrored(tmp_path):
    """A finger turned over, beside a wall behind it: places, masses and forces are MuJoCo's."""
    path = written(tmp_path, "", GRIPPER)
    scene, m = slcp.load_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    turn = mujoco_beside.turn_of(m)
    assert np.diag(turn).tolist() == [1, 1, 1, -1, -1, 1]
    assert mujoco_beside.compare(scene, m, turn).max() < 1e-13
    assert not scene.all_contacts  # all of them are beside the wall
    touching = GRIPPER.replace('conaffinity="0"', 'conaffinity="2"').replace(".01 -.01", "0 -.01")
    path = written(tmp_path, "", touching)
    scene, m = slcp.load_mjcf(path, corner_radius=1e-3), mujoco.MjModel.from_xml_path(str(path))
    data, oracle, rng = mujoco.MjData(m), Oracle(scene), np.random.default_rng(0)
    assert {s.name for s in scene.shapes} >= {"thumb", "finger", "nail", "welded", "claw"}
    for q in 0.5 * rng.normal(size=(5, m.nv)):
        data.qpos[:] = turn @ q
        mujoco.mj_kinematics(m, data)
        for i, shape in enumerate(scene.shapes):
            at, angle = oracle.shape_pose(q, i)
            place, axes = data.geom(shape.name).xpos, data.geom(shape.name).xmat.reshape(3, 3)
            assert at == pytest.approx(place[[0, 2]], abs=1e-12)
            first = axes[:, 2] if shape.kind == "capsule" else axes[:, 0]
            if shape.kind != "disc":
                across = np.cos(angle) * first[2] - np.sin(angle) * first[0]
                assert across == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("turned", [False, True], ids=["wall", "mirrored wall"])
def test_a_wall_behind_is_no_wall(tmp_path, turned):
    """But what reaches it: of two fingertips of which one lies deeper in, mirrored, the other one does."""
    text = GRIPPER.format(equality="")
    if turned:
        wall = '<geom name="wall" type="plane" pos="0 .2 .5" zaxis="0 -1 0"'
        assert wall in text
        text = text.replace(
            wall, wall.replace('pos="0 .2 .5" zaxis="0 -1 0"', 'pos="0 -.2 .5" zaxis="0 1 0"')
        )
        place = text.index('<geom name="wall"')
        end = text.index("/>", place) + 2
        text = text[:place] + f'<body euler="0 0 180">{text[place:end]}</body>' + text[end:]
    parts = text.split('type="sphere" pos=".003 0 0" size=".008"')
    path = tmp_path / "model.xml"
    for sizes in ((0.169, 0.229), (0.171, 0.229), (0.169, 0.231)):
        thumb, finger = (f'type="sphere" pos=".003 .02 0" size="{size}"' for size in sizes)
        path.write_text(parts[0] + thumb + parts[1] + finger + parts[2])
        if sizes == (0.169, 0.229):
            assert slcp.load_mjcf(path).nv == 6
            continue
        name = "thumbtip" if sizes[0] > 0.17 else "fingertip"
        with pytest.raises(
            slcp.MjcfError, match=f"'wall' and '{name}': the first is a wall along the plane xz"
        ):
            slcp.load_mjcf(path)


def test_a_slide_of_a_free_body_that_is_turned(tmp_path):
    """What is tied to one of two slides that are turned against ours has a coordinate of its own for it."""
    sled = """<body name="sled" pos="0 0 1" euler="0 20 0">
      <joint name="x" type="slide" axis="1 0 0" ref=".1"/><joint name="z" type="slide" axis="0 0 1"/>
      <joint name="tilt" axis="0 1 0"/><geom size=".1" mass="1"/></body>"""
    free = ARM.replace('<body name="upper">', sled + '<body name="upper">', 1)
    free = free[: free.index("<keyframe>")] + free[free.index("</keyframe>") + 11 :]
    assert slcp.load_mjcf(written(tmp_path, "", free)).state_names[:3] == ("sled.x", "sled.y", "sled.angle")
    path = written(tmp_path, '<joint joint1="x" joint2="elbow" polycoef="0 -.4"/>', free)
    scene, m = slcp.load_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    assert scene.state_names[:3] == ("x.shift", "z.shift", "sled.angle")
    tendon, data, turn = scene.tendons[-1], mujoco.MjData(m), np.diag(mujoco_beside.turn_of(m))
    for q in np.random.default_rng(0).normal(size=(5, m.nv)):
        data.qpos[:] = m.qpos0 + turn * q
        mujoco.mj_fwdPosition(m, data)
        along = sum(c * q[scene.state_index(n)] for n, c in zip(tendon.coordinates, tendon.coefficients))
        assert along - tendon.length == pytest.approx(data.efc_pos[0], abs=1e-12)


def test_coupled_fingers_stay_coupled(tmp_path, dtype):
    """Random motion of a gripper that has a tendon of the name of its constraint; MuJoCo's yields more."""
    path = written(tmp_path, COUPLING, GRIPPER)
    scene, m = slcp.load_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    assert [t.name for t in scene.tendons] == ["grasp", "coupling", "coupling_equality"]
    assert scene.control_names == ("grasp", "palm.shift")
    rng, data = np.random.default_rng(0), mujoco.MjData(m)
    u = np.repeat(rng.uniform(-1, 1, (16, 10, 2)) * [0.02, 1.0], 30, axis=1)
    thumb, finger = scene.state_index("thumb.angle"), scene.state_index("finger.angle")
    theirs = []
    for controls in u[0]:
        data.ctrl[:] = controls
        mujoco.mj_step(m, data)
        theirs.append(data.joint("finger").qpos[0] - data.joint("thumb").qpos[0])
    for law in LAWS.values():
        sim = slcp.Simulator(scene, law, dtype=dtype.__name__, device="cpu")
        run = sim.rollout(np.tile(scene.x0, (16, 1)), u)
        assert np.all(np.asarray(run.status) == slcp.Status.SOLVED)
        states = np.asarray(run.states, float)
        apart = states[..., thumb] + states[..., finger]
        assert np.abs(apart).max() < 1e-4 and np.ptp(states[..., thumb]) > 0.2
        assert np.abs(apart[0]).max() < 0.1 * np.abs(theirs).max()


def test_start_that_misses_is_said(tmp_path):
    path = written(tmp_path)
    path.write_text(path.read_text().replace("0.4490658503988659", "0.349"))
    with pytest.warns(RuntimeWarning, match="model.xml: equality constraint 'gear' is missed by 0.1 at the"):
        slcp.load_mjcf(path)


REFUSED = {
    "curve": ('<joint name="e" joint1="shoulder" joint2="elbow" polycoef="0 1 0 .5"/>',
              r"constraint 'e': polycoef is \[0.0, 1.0, 0.0, 0.5, 0.0\]; a line is supported"),
    "curve of tendons": ('<tendon tendon1="belt" tendon2="nut" polycoef="0 1 .1"/>', "a line is supported"),
    "nan": ('<joint joint1="shoulder" polycoef="nan 1"/>', "polycoef is .nan, 1.0, .*finite numbers are"),
    "nothing": ('<tendon name="e" tendon1="nut" tendon2="half" polycoef="0 2"/>',
                "'e': it holds no coordinate"),
    "spatial": ('<tendon tendon1="string"/>', "tendon 'string': only fixed tendons"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused_is_named(tmp_path, name):
    equality, message = REFUSED[name]
    path = written(tmp_path, equality)
    more = '<fixed name="half"><joint joint="elbow" coef=".03"/></fixed>'
    if name == "spatial":
        more = '<spatial name="string"><site site="a"/><site site="b"/></spatial>'
    text = path.read_text().replace("</tendon>", more + "</tendon>", 1)
    for body, site in (('<body name="lower"', "a"), ('<body name="upper"', "b")):
        text = text.replace(body, f'<site name="{site}"/>{body}')
    path.write_text(text)
    with pytest.raises(slcp.MjcfError, match=message):
        slcp.load_mjcf(path)
    left_out = ("equality constraints", "tendons") if name == "spatial" else ("equality constraints",)
    assert len(slcp.load_mjcf(path, left_out=left_out).tendons) == (0 if name == "spatial" else 4)


def test_tendons_that_are_left_out_cannot_be_held(tmp_path):
    path = written(tmp_path, TENDONS)
    with pytest.raises(slcp.MjcfError, match="'belt': it holds a tendon, and tendons are left out"):
        slcp.load_mjcf(path, left_out=("tendons",))
    both = slcp.load_mjcf(path, left_out=("tendons", "equality constraints"))
    assert not both.tendons
    assert len(slcp.load_mjcf(written(tmp_path), left_out=("tendons",)).tendons) == 2


@pytest.mark.parametrize("how", ["inactive", "flag equality", "flag constraint"])
def test_what_does_not_act_is_left_out(tmp_path, how):
    path = written(tmp_path)
    text = path.read_text()
    if how == "inactive":
        text = text.replace('polycoef="0 .02"/>', 'polycoef="0 .02 7" active="false"/>')
    else:
        text = text.replace('".002"/>', f'".002"><flag {how.split()[1]}="disable"/></option>')
    path.write_text(text)
    assert len(slcp.load_mjcf(path).tendons) == (4 if how == "inactive" else 3)


def test_names_are_those_of_nobody_else(tmp_path):
    """Of tendons, of bodies, of coordinates, of each other without what counts controls, and none."""
    names = ("belt", "upper", "upper.angle", "a#b", "a_b", "")
    equality = "".join(f'<joint name="{name}" joint1="elbow"/>' for name in names).replace('name="" ', "")
    scene = slcp.load_mjcf(written(tmp_path, equality))
    assert [tendon.name for tendon in scene.tendons[3:]] == [
        "belt_equality", "upper_equality", "upper.angle_equality", "a_b", "a_b_equality", "equality5",
    ]  # fmt: skip


def test_ratios_of_any_size(tmp_path):
    """A huge slope holds the other coordinate, a tiny one the first."""
    for polycoef, held in (("0 1e30", "elbow"), ("0 -1e-30", "shoulder")):
        path = written(tmp_path, f'<joint joint1="shoulder" joint2="elbow" polycoef="{polycoef}"/>')
        path.write_text(path.read_text().replace("0.4490658503988659", "0.3490658503988659"))
        scene = slcp.load_mjcf(path)
        place = {"shoulder": 0, "elbow": 1}[held]
        assert abs(scene.tendons[-1].coefficients[place]) == 1.0
        for precision in ("float32", "float64"):
            sim = slcp.Simulator(scene, slcp.Options("hard"), dtype=precision, device="cpu")
            run = sim.rollout(np.zeros(6), np.zeros((1, 100, 2)))
            assert np.all(np.asarray(run.status) == slcp.Status.SOLVED)
            moved = np.abs(np.asarray(run.states).reshape(-1, 6)[:, :2]).max(axis=0)
            assert moved[place] < 1e-5 and moved[1 - place] > 0.1
