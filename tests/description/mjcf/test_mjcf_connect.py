"""MuJoCo's connect and weld: pins, and tendons of angles, that pull nothing where MuJoCo's are met."""

import mujoco_beside
import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp

mujoco = pytest.importorskip("mujoco")
LAWS = {
    "smoothed": slcp.Options(),
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}
# a tree with a mirrored body, bodies that are welded on, a free one, and sites on all of them
TREE = """
<mujoco model="tree">
  <option timestep=".002"/><default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="post" pos=".1 0 .2" euler="0 30 0"><geom size=".01"/><site name="post" pos=".1 0 .05"/></body>
    <body name="upper" pos="0 .1 1">
      <joint name="shoulder" axis="0 1 0" ref="20"/>
      <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="1"/>
      <body name="plate" pos=".2 0 0" euler="0 40 0"><geom size=".02" mass=".1"/></body>
      <body name="lower" pos=".3 0 0" euler="0 90 180">
        <joint name="slip" type="slide" axis="1 0 0"/><joint name="elbow" axis="0 -1 0" pos=".02 0 0"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .25 0 0" mass=".5"/>
        <site name="lower" pos=".25 .1 .03" euler="0 25 0"/>
        <body name="tip" pos=".25 0 .1" euler="0 -70 0"><geom size=".02" mass=".1"/></body>
      </body>
    </body>
    <body name="ball" pos=".5 .1 .8">
      <joint type="slide" axis="1 0 0" ref=".5"/><joint type="slide" axis="0 0 1"/>
      <joint axis="0 -1 0" ref="5"/><site name="far" pos="0 .2 0"/>
      <geom size=".1" mass=".7"/><site name="ball" pos="-.1 -.1 0" euler="0 -15 180"/>
    </body>
  </worldbody>
  <equality>EQUALITY</equality>
</mujoco>
"""
HELD = {
    "bodies": '<connect name="e" body1="upper" body2="ball" anchor=".2 0 .1"/>',
    "mirrored": '<connect name="e" body1="lower" body2="ball" anchor=".2 0 .1"/>',
    "parts": '<connect name="e" body1="tip" body2="plate" anchor=".1 0 .05"/>',
    "world": '<connect name="e" body1="tip" anchor=".1 0 .05"/>',
    "post": '<connect name="e" body1="post" body2="upper" anchor=".3 0 .1"/>',
    "sites": '<connect name="e" site1="lower" site2="ball"/>',
    "weld": '<weld name="e" body1="plate" body2="ball"/>',
    "weld mirrored": '<weld name="e" body1="lower" body2="ball" anchor=".1 0 .2"/>',
    "weld turned": '<weld name="e" body1="upper" body2="ball" relpose=".1 0 .2 1 0 .5 0" anchor=".1 0 0"/>',
    "weld world": '<weld name="e" body1="tip" torquescale=".3"/>',
    "weld sites": '<weld name="e" site1="lower" site2="ball"/>',
    "weld free to turn": '<weld name="e" body1="upper" body2="ball" torquescale="0"/>',
}


def read(folder, text, **options):
    path = folder / "model.xml"
    path.write_text(text)
    return slcp.load_mjcf(path, **options), mujoco.MjModel.from_xml_path(str(path))


def missed(model, data):
    """MuJoCo's residuals of its equality constraints."""
    mujoco.mj_fwdPosition(model, data)
    rows = np.asarray(data.efc_type) == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    return np.asarray(data.efc_pos)[rows]


def apart(scene, oracle, q):
    """From one point of the scene's first pin to the other, (.., 2)."""
    spring, other = scene.springs[:2]
    names = {body.name: i for i, body in enumerate(scene.bodies)} | {None: -1}
    middle = np.array([other.point_a[0], spring.point_a[1]])
    at = oracle.point(q, names[spring.body_a], middle)
    return oracle.point(q, names[spring.body_b], np.array(spring.point_b)) - at


@pytest.mark.filterwarnings("ignore:model.xml. equality constraint")
@pytest.mark.parametrize("name", HELD)
def test_what_is_held_is_mujocos(tmp_path, name):
    """In random states points are as far apart as MuJoCo says, and as far turned from what a weld holds."""
    scene, m = read(tmp_path, TREE.replace("EQUALITY", HELD[name]))
    data, oracle, rng = mujoco.MjData(m), Oracle(scene), np.random.default_rng(0)
    turn, tendons = mujoco_beside.turn_of(m), scene.tendons
    assert len(scene.springs) == 2 and len(tendons) == (name.startswith("weld") and "free" not in name)
    for q in 0.6 * rng.normal(size=(10, m.nv)):
        data.qpos[:] = m.qpos0 + turn @ q
        theirs = missed(m, data)
        gap = np.linalg.norm(theirs[:3])
        assert np.linalg.norm(apart(scene, oracle, q)) == pytest.approx(gap, abs=1e-12)
        for tendon in tendons:
            along = sum(c * q[scene.state_index(n)] for n, c in zip(tendon.coordinates, tendon.coefficients))
            scale = 0.3 if name == "weld world" else 1.0
            half = np.linalg.norm(theirs[3:]) / scale  # MuJoCo's is the sine of half the angle
            assert np.abs(np.sin((along - tendon.length) / 2.0)) == pytest.approx(half, abs=1e-9)


LINKAGE = """
<mujoco model="linkage">
  <option timestep=".001"/><default><geom type="capsule" size=".01" contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="ground" type="plane" pos="0 0 .005" size="1 1 1" contype="1" conaffinity="1"/>
    <body name="crank"><joint name="crank" axis="0 1 0"/><geom fromto="0 0 0 0 0 .2" mass=".3"/>
      <body name="coupler" pos="0 0 .2"><joint name="coupler" axis="0 -1 0"/>
        <geom fromto="0 0 0 .4 0 .1" mass=".5"/>
        <geom name="foot" type="sphere" size=".02" pos=".5 0 -.1" mass=".05" contype="1" conaffinity="1"/>
      </body></body>
    <body name="rocker" pos=".4 0 0"><joint name="rocker" axis="0 1 0"/>
      <geom fromto="0 0 0 0 0 .3" mass=".4"/></body>
  </worldbody>
  <equality>{equality}</equality>
  <actuator><motor joint="crank"/></actuator>
</mujoco>
"""
PIN = '<connect name="pin" body1="rocker" body2="coupler" anchor="0 0 .3"/>'
CUT = '<connect name="pin" body1="rocker" anchor="0 0 0"/>'


def test_linkage_is_solved_and_closed(tmp_path, dtype):
    """Driven at random, with a foot on the ground, under each law; MuJoCo's own loop opens wider."""
    scene, m = read(tmp_path, LINKAGE.format(equality=PIN))
    rng, oracle, data = np.random.default_rng(0), Oracle(scene), mujoco.MjData(m)
    u = np.repeat(rng.normal(size=(16, 10, 1)), 40, axis=1)
    theirs = []
    for controls in u[0]:
        data.ctrl[:] = controls
        mujoco.mj_step(m, data)
        theirs.append(np.linalg.norm(missed(m, data)[:3]))
    for law, options in LAWS.items():
        sim = slcp.Simulator(scene, options, dtype=dtype.__name__, device="cpu")
        run = sim.rollout(np.tile(scene.x0, (16, 1)), u, record="gap")
        assert np.all(np.asarray(run.status) == slcp.Status.SOLVED)
        assert law == "smoothed" or np.asarray(run.gap).min() < 1e-4
        states = np.asarray(run.states, float)
        assert np.abs(apart(scene, oracle, states[..., :3])).max() < 1e-3
        assert np.ptp(states[..., 0]) > 1.0
        assert np.abs(apart(scene, oracle, states[0, :, :3])).max() < 0.2 * np.max(theirs)


WELDED = """
<mujoco model="welded">
  <option timestep=".001"/><default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="arm" pos="0 0 1"><joint name="arm" axis="0 1 0"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass=".4"/>{child}</body>
    {other}
  </worldbody>
  <equality>{equality}</equality>
</mujoco>
"""
LOAD = (
    '<body name="load" pos="{at}" euler="0 35 0">{joints}'
    '<geom type="box" size=".05 .02 .03" mass=".3"/></body>'
)


def test_what_is_welded_moves_as_one(tmp_path):
    """As a body that is a part of the arm, to the first order in h."""
    joints = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 -1 0"/>'
    other = LOAD.format(at=".3 0 1.1", joints=joints.replace("1 0 0", "1 0 0", 1))
    fixed = LOAD.format(at=".3 0 .1", joints="")
    tied = '<weld body1="arm" body2="load"/>'
    aligned = other.replace(' euler="0 35 0"', "").replace('type="box"', 'type="box" euler="0 35 0"')
    scene, _ = read(tmp_path, WELDED.format(child="", other=aligned, equality=tied))
    whole, _ = read(tmp_path, WELDED.format(child=fixed, other="", equality=""))
    errors = []
    for h in (1e-3, 5e-4):
        ends = []
        for each in (scene, whole):
            sim = slcp.Simulator(
                each, slcp.Options("hard"), dtype="float64", device="cpu", strategy="generic"
            )
            run = sim.rollout(each.x0, steps=round(0.4 / h), params=sim.params.replace(step_size=h))
            ends.append(np.asarray(run.states).reshape(-1, 2 * each.nv))
        q = ends[0][:, :4]
        assert np.abs(q[:, 0] - q[:, 3]).max() < 1e-3 and np.ptp(q[:, 0]) > 0.5
        errors.append(np.abs(q[-1, 0] - ends[1][-1, 0]))
    assert errors[0] < 5e-3 and errors[1] < 0.6 * errors[0]


def test_a_weld_holds_the_turn_that_it_starts_with(tmp_path):
    """A keyframe a whole turn on is where it holds, as in MuJoCo."""
    text = WELDED.format(child="", other=LOAD.format(at=".3 0 1.1", joints='<joint axis="0 -1 0"/>'),
                         equality='<weld name="e" body1="arm" body2="load"/>')  # fmt: skip
    for turns in (0, 1, -2):
        key = f'<keyframe><key qpos="0 {turns * 2 * np.pi}"/></keyframe></mujoco>'
        scene, _ = read(tmp_path, text.replace("</mujoco>", key))
        (tendon,) = scene.tendons
        assert tendon.name == "e" and tendon.length == pytest.approx(2 * np.pi * turns)
        assert dict(zip(tendon.coordinates, tendon.coefficients)) == {"arm.angle": -1.0, "load.angle": 1.0}


REFUSED = {
    "beside": (
        '<connect name="e" site1="post" site2="far"/>',
        "its points are 0.3.* m apart along the normal",
    ),
    "turned": ('<weld name="e" body1="upper" body2="ball" relpose="0 0 0 1 .2 0 0"/>', "out of the plane xz"),
    "nothing": ('<connect name="e" body1="post" body2="world" anchor="0 0 0"/>', "no joint moves its points"),
    "itself": (
        '<connect name="e" body1="upper" body2="plate" anchor=".1 0 0"/>',
        "no joint moves its points",
    ),
    "a hinge": ('<connect name="e" body1="upper" anchor="0 0 0"/>', "no joint moves its points"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused_is_named(tmp_path, name):
    equality, message = REFUSED[name]
    with pytest.raises(slcp.MjcfError, match=f"equality constraint 'e': .*{message}.*left_out"):
        read(tmp_path, TREE.replace("EQUALITY", equality))
    scene, _ = read(tmp_path, TREE.replace("EQUALITY", equality), left_out=("equality constraints",))
    assert not scene.springs and not scene.tendons


def test_a_weld_of_what_never_turns(tmp_path):
    slides = '<joint type="slide" axis="1 0 0"/>'
    text = WELDED.replace('<joint name="arm" axis="0 1 0"/>', slides)
    weld = '<weld name="e" body1="arm" body2="load" {}/>'
    parts = {"child": "", "other": LOAD.format(at=".3 0 1.1", joints=slides)}
    scene, _ = read(tmp_path, text.format(equality=weld.format(""), **parts))
    assert len(scene.springs) == 2 and not scene.tendons
    with pytest.raises(
        slcp.MjcfError, match="no joint turns its bodies against each other, which its relpose"
    ):
        read(tmp_path, text.format(equality=weld.format('relpose=".3 0 .1 1 0 .1 0"'), **parts))


def test_start_that_is_apart_is_said(tmp_path):
    text = LINKAGE.format(equality=PIN)
    key = '<keyframe><key qpos="0 0 .2"/></keyframe></mujoco>'
    with pytest.warns(RuntimeWarning, match="equality constraint 'pin' is missed by 0.0599 at the start"):
        read(tmp_path, text.replace("</mujoco>", key))
    scene, _ = read(tmp_path, LINKAGE.format(equality=CUT.replace("/>", ' active="false"/>')))
    assert not scene.springs
