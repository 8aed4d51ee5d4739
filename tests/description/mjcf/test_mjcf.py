"""Planar MJCF against MuJoCo itself: mass matrix, bias forces, distances; and what is refused."""

import pathlib

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp

mujoco = pytest.importorskip("mujoco")
HOPPER = pathlib.Path(__file__).parents[3] / "examples" / "scenes" / "hopper.xml"
FLIP = np.array([1, 1, 1, -1, 1, 1, 1, 1.0])  # the hip turns about +y


@pytest.fixture(scope="module")
def pair():
    return slcp.load_mjcf(HOPPER), mujoco.MjModel.from_xml_path(str(HOPPER))


def states(model, count=20):
    rng = np.random.default_rng(0)
    q, v = 0.3 * rng.standard_normal((count, model.nv)), rng.standard_normal((count, model.nv))
    q[:, 5] += 1.0  # the crate off the ground
    return q, v


def test_structure(pair):
    scene, model = pair
    assert [b.name for b in scene.bodies] == ["torso", "thigh", "shin", "crate"]  # the pack is welded on
    assert scene.nv == model.nv and scene.nu == 2 and scene.step_size == 0.01
    assert scene.bodies[2].stiffness == (200.0,) and scene.bodies[2].rest == (0.02,)
    assert scene.bodies[1].lower == pytest.approx((-np.pi / 3,))
    touching = {frozenset((c.shape_a, c.shape_b)) for c in scene.all_contacts}
    assert frozenset(("floor", "foot")) in touching and frozenset(("floor", "crate")) in touching
    assert not any("pack" in pair for pair in touching)
    assert all(c.friction == 0.8 or c.friction == 1.0 for c in scene.all_contacts)


def test_same_mass_matrix_and_forces(pair):
    scene, model = pair
    data, oracle = mujoco.MjData(model), Oracle(scene)
    q, v = states(model)
    mass, force = oracle.mass_matrix(q), oracle.force(q, v)
    for i in range(len(q)):
        data.qpos[:], data.qvel[:] = FLIP * q[i], FLIP * v[i]
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full) if _new_order() else mujoco.mj_fullM(model, full, data.qM)
        np.testing.assert_allclose(mass[i], FLIP[:, None] * full * FLIP, atol=1e-9)
        np.testing.assert_allclose(force[i], FLIP * (data.qfrc_passive - data.qfrc_bias), atol=1e-7)


def test_motors_push_as_hard_as_in_mujoco(pair):
    """Gears of different sizes, on joints of both senses of turning."""
    scene, model = pair
    data, oracle = mujoco.MjData(model), Oracle(scene)
    q, v = states(model, 1)
    for u in np.eye(model.nu):
        data.qpos[:], data.qvel[:], data.ctrl[:] = FLIP * q[0], FLIP * v[0], u
        mujoco.mj_forward(model, data)
        push = oracle.force(q[0], v[0], u) - oracle.force(q[0], v[0], 0.0 * u)
        np.testing.assert_allclose(push, FLIP * data.qfrc_actuator, atol=1e-9)
        assert np.abs(push).max() > 10.0


def _new_order():
    return "qM" not in dir(mujoco.MjData)


def test_same_distances(pair):
    scene, model = pair
    data, oracle = mujoco.MjData(model), Oracle(scene)
    q, _ = states(model, 10)
    names = [(c.shape_a, c.shape_b) for c in scene.all_contacts]
    foot = next(k for k, n in enumerate(names) if set(n) == {"floor", "foot"})
    corners = [k for k, n in enumerate(names) if any("crate" in x for x in n)]
    first = scene.structure.pairs  # capsules make two pairs: count pairs, not contacts
    kinds = [
        scene.shapes[p.shape_b if scene.shapes[p.shape_a].kind == "halfplane" else p.shape_a].name
        for p in first
    ]
    foot, corners = kinds.index("foot"), [k for k, n in enumerate(kinds) if n.startswith("crate")]
    gaps = np.stack([oracle.contact_jacobian(q, k)[0] for k in range(len(first))], -1)
    for i in range(len(q)):
        data.qpos[:] = FLIP * q[i]
        mujoco.mj_forward(model, data)
        segment = np.zeros(6)
        floor, ball, crate = (model.geom(n).id for n in ("floor", "foot", "crate"))
        assert gaps[i, foot] == pytest.approx(
            mujoco.mj_geomDistance(model, data, floor, ball, 10.0, segment), abs=1e-6
        )
        box = mujoco.mj_geomDistance(model, data, floor, crate, 10.0, segment)
        assert gaps[i, corners].min() == pytest.approx(box, abs=1e-6)


@pytest.mark.parametrize("change, message", [
    (('axis="0 1 0"', 'axis="1 0 0"'), "joint 'hip': its axis .* is not normal"),
    (('type="sphere" pos="0 0 -0.3" size="0.05"', 'type="cylinder" pos="0 0 -0.3" size="0.05 0.1"'),
     "geom 'foot'"),
    (('<motor joint="hip" gear="20"/>', '<damper joint="hip" kv="20" ctrlrange="0 1"/>'), "only a motor"),
    (('<motor joint="hip" gear="20"/>', '<general joint="hip" biastype="affine" biasprm="2 0 0"/>'),
     "joint 'hip': an actuator pushes it by 2 without a control"),
    (('gravity="0 0 -9.81"', 'gravity="0 1 -9.81"'), "gravity: .* points out of the plane"),
    (('0.04" contype="0" conaffinity="0"/>', '0.04"/>'), "and an ellipse cannot touch"),
    (("</worldbody>", ""), "XML"),
    (('damping="0.1"', 'damping="0.1 2"'), "nonlinear damping is .2.0, 0.0."),
    (('stiffness="200"', 'stiffness="200 5"'), "joint 'knee': nonlinear stiffness"),
    (('axis="0 1 0" range', 'axis="0 1 0" actuatorfrcrange="-1 1" range'), "joint 'hip': actuatorfrcrange"),
    (('<body name="thigh"', '<body name="thigh" gravcomp="1"'), "body 'thigh': gravcomp is 1.0"),
    (('timestep="0.01"', 'timestep="0"'), "option timestep is 0; a positive number is needed"),
    (('timestep="0.01"', 'timestep="0.01" density="1.2"'), "option density is 1.2"),
    (('timestep="0.01"', 'timestep="0.01" viscosity="1e-3"'), "option viscosity is 0.001"),
    (('gravity="0 0 -9.81"/>', 'gravity="0 0 -9.81"><flag constraint="disable"/></option>'),
     "flag constraint is disabled"),
    (('gravity="0 0 -9.81"/>', 'gravity="0 0 -9.81"><flag override="enable"/></option>'), "flag override"),
    (('timestep="0.01"', 'timestep="0.01" actuatorgroupdisable="0"'), "its group 0 is disabled"),
    (('gear="20"/>', 'gear="20" forcerange="-1 2"/>'), "forcerange is limited"),
    (('damping="0.1"', 'damping="0.1" frictionloss="1"'), "frictionloss is 1.0"),
    (('<contact>', '<contact><pair geom1="floor" geom2="foot" condim="3" friction="0.9 0.1"/>'),
     "'floor' and 'foot': its coefficients of sliding are .0.9, 0.1."),
])  # fmt: skip
def test_what_is_refused_is_named(tmp_path, change, message):
    text = HOPPER.read_text()
    assert change[0] in text
    path = tmp_path / "bad.xml"
    path.write_text(text.replace(change[0], change[1], 1))
    with pytest.raises(slcp.SceneError, match=message):
        slcp.load_mjcf(path)


def test_missing_file_and_plane(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.xml"):
        slcp.load_mjcf(tmp_path / "nowhere.xml")
    with pytest.raises(ValueError, match="choose one of .'xz', 'xy'"):
        slcp.load_mjcf(HOPPER, plane="yz")
