"""Ways of writing the same planar model: slides, planes apart, flags, what is left out."""

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp

mujoco = pytest.importorskip("mujoco")

WALKER = """
<mujoco model="walker">
  <option timestep="0.0025"/>
  <default>
    <joint damping=".1" armature=".01"/><geom contype="1" conaffinity="0" friction=".7 .1 .1"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" conaffinity="1" size="9 1 .1"/>
    <body name="torso" pos="0 0 1.3" {turned}>
      {slides}
      <joint name="tilt" axis="0 1 0" armature="0" damping="0" ref="20"/>
      <geom name="torso" type="capsule" size=".07 .3"/>
      <body name="right" pos="0 -.05 -.3"><joint name="hip" axis="0 -1 0" range="-20 100" limited="true"/>
        <geom name="right" type="capsule" pos="0 0 -.2" size=".05 .2"/></body>
      <body name="left" pos="0 .05 -.3"><joint axis="0 -1 0" pos="0 0 .1"/>
        <geom name="left" type="capsule" pos="0 .02 -.2" size=".05 .2"/></body>
    </body>
  </worldbody>
  <actuator><motor joint="hip" gear="3"/>{motor}</actuator>
</mujoco>
"""
PLAIN = 'armature="0" damping="0"'
X, Z = (
    f'<joint name="{name}" type="slide" axis="{axis}" {PLAIN}/>'
    for name, axis in (("x", "1 0 0"), ("z", "0 0 1"))
)
BACK = X.replace("1 0 0", "-1 0 0")
TURN = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])  # a turn about +y, seen in xz


def read(tmp_path, **parts):
    text = WALKER.format(**{"slides": X + Z, "turned": "", "motor": ""} | parts)
    path = tmp_path / "model.xml"
    path.write_text(text)
    return path


def compare(path, turn, **options):
    """M, and forces of gravity, springs, dampers and motors in MuJoCo's model and ours, q = turn q_mujoco."""
    scene, model = slcp.load_mjcf(path, **options), mujoco.MjModel.from_xml_path(str(path))
    data, oracle, rng = mujoco.MjData(model), Oracle(scene), np.random.default_rng(0)
    for _ in range(10):
        q, v, u = (0.4 * rng.standard_normal(n) for n in (model.nv, model.nv, model.nu))
        data.qpos[:], data.qvel[:], data.ctrl[:] = model.qpos0 + q, v, u
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full) if "qM" not in dir(mujoco.MjData) else mujoco.mj_fullM(
            model, full, data.qM
        )
        ours = (turn @ q)[None], (turn @ v)[None]
        force = data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator
        np.testing.assert_allclose(oracle.mass_matrix(ours[0])[0], turn @ full @ turn.T, atol=1e-9)
        np.testing.assert_allclose(oracle.force(*ours, u[None])[0], turn @ force, atol=1e-8)
    return scene, model


@pytest.mark.parametrize(
    "slides, turn",
    [
        (X + Z, [[1, 0], [0, 1]]),
        (Z + X, [[0, 1], [1, 0]]),
        (Z + BACK, [[0, -1], [1, 0]]),
        (BACK + Z, [[-1, 0], [0, 1]]),
    ],
)
def test_slides_in_any_order(tmp_path, slides, turn):
    """With a motor, a limit and a spring on one of them; legs in planes of their own, over the floor."""
    slides = slides.replace('name="z"', 'name="z" stiffness="30" springref=".2" range="-.5 2" limited="true"')
    whole = np.diag([1.0, 1.0, -1.0, 1.0, 1.0])
    whole[:2, :2] = turn
    path = read(tmp_path, slides=slides, motor='<motor joint="x" gear="7"/><motor joint="z" gear="5"/>')
    scene, model = compare(path, whole)
    assert scene.bodies[0].lower[:2] == (None, -0.5) and scene.bodies[0].upper[:2] == (None, 2.0)
    assert {frozenset((c.shape_a, c.shape_b)) for c in scene.all_contacts} == {
        frozenset(("floor", name)) for name in ("torso", "right", "left")
    }
    key = np.arange(1.0, 6.0)
    text = " ".join(map(str, model.qpos0 + key))
    path.write_text(
        path.read_text().replace("</mujoco>", f'<keyframe><key qpos="{text}"/></keyframe></mujoco>')
    )
    np.testing.assert_allclose(slcp.load_mjcf(path).x0[:5], whole @ key)


def test_slides_that_are_turned(tmp_path):
    """By the body's own frame: the same body in other coordinates."""
    whole = np.diag([1.0, 1.0, -1.0, 1.0, 1.0])
    whole[:2, :2] = TURN.T
    path = read(tmp_path, turned=f'euler="0 {-np.degrees(0.3)} 0"')
    compare(path, whole)
    whole[:2, :2] = np.eye(
        2
    )  # what is said of one of them, or slides at other angles: coordinates of their own
    for changes in (
        {"motor": '<motor joint="z"/>'},
        {"slides": X.replace('damping="0"', 'damping="1"') + Z},
        {"slides": X + Z.replace('name="z"', 'name="z" stiffness="1"')},
        {"slides": X + Z.replace("0 0 1", "0.6 0 0.8")},
    ):
        scene, _ = compare(read(tmp_path, turned='euler="0 20 0"', **changes), whole)
        assert scene.state_names[:3] == ("x.shift", "z.shift", "torso.angle")


def test_round_shapes_touch_in_one_plane_only(tmp_path):
    path = read(tmp_path)
    text = path.read_text().replace('contype="1" conaffinity="0"', 'contype="1" conaffinity="1"')
    path.write_text(text)
    with pytest.raises(
        slcp.SceneError, match="'right' and 'left' are 0.12 m apart along the normal of the plane"
    ):
        slcp.load_mjcf(path)
    path.write_text(text.replace('pos="0 .05 -.3"', 'pos="0 -.07 -.3"'))
    pairs = {frozenset((c.shape_a, c.shape_b)) for c in slcp.load_mjcf(path).all_contacts}
    assert frozenset(("right", "left")) in pairs and len(pairs) == 4


REACHER = """
<mujoco model="reacher">
  <option timestep="0.02"/>
  <default><joint damping=".01"/></default>
  <worldbody>
    <geom name="wall" type="plane" pos="-.3 0 .02" zaxis="1 0 0" size=".1 .1 .1"/>
    <body name="arm" pos="0 0 .01"><joint name="shoulder" axis="0 0 1"/>
      <geom type="capsule" fromto="0 0 0 .12 0 0" size=".01"/>
      <body name="hand" pos=".12 0 .05"><joint name="wrist" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/></body></body>
  </worldbody>
  <actuator><motor joint="wrist" gear=".05"/></actuator>
</mujoco>
"""


def test_the_plane_is_that_of_the_hinges(tmp_path):
    """Gravity along its normal, which the joints hold, and a hand above its arm."""
    path = tmp_path / "reacher.xml"
    path.write_text(REACHER)
    scene, _ = compare(path, np.eye(2))
    assert scene.gravity == (0.0, 0.0) and len(scene.all_contacts) == 2
    with pytest.raises(slcp.SceneError, match="'shoulder': its axis .* is not normal to the plane xz"):
        slcp.load_mjcf(path, "xz")
    path.write_text(REACHER.replace('timestep="0.02"', 'timestep="0.02" gravity="1 0 -9"'))
    with pytest.raises(slcp.SceneError, match="gravity: .* points out of the plane xy"):
        slcp.load_mjcf(path)


def test_gravity_may_be_off(tmp_path):
    path = read(tmp_path)
    text = '<option timestep="0.0025"><flag gravity="disable"/></option>'
    path.write_text(path.read_text().replace('<option timestep="0.0025"/>', text))
    scene, _ = compare(path, np.diag([1.0, 1.0, -1.0, 1.0, 1.0]))
    assert scene.gravity == (0.0, 0.0)


def test_what_has_no_counterpart_is_left_out_where_that_is_said(tmp_path):
    path = read(tmp_path)
    more = (
        (' damping=".1"', ' damping=".1" frictionloss="1"', "frictionloss"),
        ("</worldbody>", '<site name="a"/><site name="c" pos="0 0 1"/></worldbody><tendon><spatial>'
         '<site site="a"/><site site="b"/><site site="c"/></spatial></tendon>', "tendons"),
        ("<option ", '<option density="1.2" ', "density"),
    )  # fmt: skip
    text = path.read_text().replace('name="torso" type', 'name="torso" type', 1)
    text = text.replace('<body name="right"', '<site name="b"/><body name="right"', 1)
    for before, after, word in more:
        assert before in text
        text = text.replace(before, after, 1)
        path.write_text(text)
        with pytest.raises(slcp.SceneError, match=f"{word}.*load_mjcf can leave it out"):
            slcp.load_mjcf(path, left_out=[w for *_, w in more if w != word])
    left = slcp.load_mjcf(path, left_out=("frictionloss", "tendons", "density"))
    assert repr(left) == repr(slcp.load_mjcf(read(tmp_path)))
    with pytest.raises(ValueError, match="left_out is 'tendon'"):
        slcp.load_mjcf(path, left_out=("tendon",))


def test_what_has_no_name_gets_one_that_nobody_has(tmp_path):
    text = REACHER.replace('<body name="hand"', "<body").replace('name="arm"', 'name="body2"')
    text = text.replace(
        '<geom type="capsule" fromto="0 0 0 .12', '<geom name="geom2" type="capsule" fromto="0 0 0 .12'
    )
    path = tmp_path / "reacher.xml"
    path.write_text(text)
    scene = slcp.load_mjcf(path)
    assert [body.name for body in scene.bodies] == ["body2", "body2_"]
    assert [shape.name for shape in scene.shapes] == ["wall", "geom2", "geom2_"]
