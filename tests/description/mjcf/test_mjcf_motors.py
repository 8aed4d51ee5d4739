"""Rotors and servos of MJCF models against MuJoCo itself: mass matrix, forces, and a step."""

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp

mujoco = pytest.importorskip("mujoco")
SIGNS = np.array([1, 1, -1, -1, 1, -1.0])  # our degrees of freedom against hinges about +y, and one about -y
MODEL = """<mujoco>
  <compiler angle="radian"/>
  <default><joint axis="0 1 0"/><geom type="capsule" contype="0" conaffinity="0"/></default>
  <option gravity="0 0 -9.81" timestep="0.005" integrator="implicit"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 1" contype="1" conaffinity="1"/>
    <body name="torso" pos="0 0 1.5">
      <joint type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 0 1"/>
      <joint/>
      <geom fromto="-.3 0 0 .3 0 0" size=".05"/>
      <body name="one" pos="-.3 0 0">
        <joint name="one" armature=".2" damping=".3" stiffness="4" springref=".3" ref=".1"/>
        <geom fromto="0 0 0 0 0 -.4" size=".04"/>
        <body name="two" pos="0 0 -.4">
          <joint name="two" axis="0 -1 0"/>
          <geom fromto="0 0 0 .1 0 -.3" size=".03"/>
        </body>
      </body>
      <body name="three" pos=".3 0 0">
        <joint name="three" ref="-.4" armature=".01"/>
        <geom fromto="0 0 0 0 0 -.4" size=".04"/>
      </body>
    </body>
  </worldbody>
  <actuator>ACTUATORS</actuator>
</mujoco>"""
ACTUATORS = {
    "motors": '<motor joint="one" gear="3" armature=".02" damping=".1"/><motor joint="two" gear="-2"/>',
    "position": '<position joint="one" kp="30" kv="2"/><position joint="two" kp="9" dampratio="1"/>'
    '<position joint="three" kp="12" gear="1.5"/>',
    "velocity": '<velocity joint="two" kv="3" gear="-.5"/><motor joint="two"/><velocity joint="three"/>',
    "general": '<general joint="one" gainprm="3" biastype="affine" biasprm="1 -4 -.5" gear="2"/>'
    '<general joint="three" gainprm="2" biastype="affine" biasprm="-1 -6 0"/>',
}


@pytest.fixture(params=sorted(ACTUATORS))
def models(request, tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(MODEL.replace("ACTUATORS", ACTUATORS[request.param]))
    return slcp.load_mjcf(path), mujoco.MjModel.from_xml_path(str(path))


def states(model, count):
    rng = np.random.default_rng(0)
    shape = count, model.nv
    return (
        0.5 * rng.standard_normal(shape),
        rng.standard_normal(shape),
        rng.standard_normal((count, model.nu)),
    )


def full_matrix(model, data):
    out = np.zeros((model.nv, model.nv))
    if hasattr(data, "qM"):
        mujoco.mj_fullM(model, out, data.qM)
    else:
        mujoco.mj_fullM(model, data, out)
    return SIGNS[:, None] * out * SIGNS


def test_same_mass_matrix_and_forces(models):
    scene, model = models
    data, oracle = mujoco.MjData(model), Oracle(scene)
    for q, v, u in zip(*states(model, 20)):
        data.qpos[:], data.qvel[:], data.ctrl[:] = model.qpos0 + SIGNS * q, SIGNS * v, u
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(oracle.mass_matrix(q), full_matrix(model, data), atol=1e-12)
        force = SIGNS * (data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator)
        np.testing.assert_allclose(oracle.force(q, v, u), force, atol=1e-11)


def moved(model, data, q, v, u, h):
    """MuJoCo's state a tenth of a second on, in our coordinates, its steps, and what its actuators gave."""
    model.opt.timestep, steps = h, round(0.1 / h)
    mujoco.mj_resetData(model, data)
    data.qpos[:], data.qvel[:], data.ctrl[:] = model.qpos0 + SIGNS * q, SIGNS * v, u
    forces = np.empty((steps, model.nu))
    for force in forces:
        mujoco.mj_step(model, data)
        force[:] = data.actuator_force
    return np.array([*(SIGNS * (data.qpos - model.qpos0)), *(SIGNS * data.qvel)]), steps, forces


def test_same_motion(models):
    """A tenth of a second, to the first order in h that both integrators have: the error halves with h."""
    scene, model = models
    data = mujoco.MjData(model)
    (q,), (v,), (u,) = states(model, 1)
    errors = []
    for h in (1e-3, 5e-4):
        there, steps, _ = moved(model, data, q, v, u, h)
        sim = slcp.Simulator(scene, device="cpu", dtype="float64", strategy="generic")
        run = sim.rollout([*q, *v], np.tile(u, (1, steps, 1)), sim.params.replace(step_size=h))
        errors.append(np.abs(np.ravel(run.states)[-2 * model.nv :] - there).max())
    assert errors[0] < 0.05 and 0.4 < errors[1] / errors[0] < 0.6


def test_forceranges_of_motors_limit_their_controls(tmp_path):
    """MuJoCo clamps gain u; of a servo, whose force is not the control's alone, nothing is said. Ranges that
    differ from side to side are not read.
    """
    path = tmp_path / "model.xml"
    actuators = (
        '<motor joint="one" gear="3" forcerange="-4 6"/>'
        '<general joint="two" gainprm="-2" forcerange="-4 6" ctrlrange="-1 9" ctrllimited="true"/>'
        '<position joint="three" kp="12" forcerange="-1 1"/>'
    )
    path.write_text(MODEL.replace("ACTUATORS", actuators))
    lower, upper = slcp.mjcf_control_limits(path)
    assert lower.tolist() == [-4.0, -1.0, -np.inf] and upper.tolist() == [6.0, 2.0, np.inf]
    with pytest.raises(slcp.MjcfError, match="actuator .*: forcerange is limited; .* but where it is alike"):
        slcp.load_mjcf(path)
    assert slcp.load_mjcf(path, left_out=("forcerange",)).nu == 3
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for i, bound in ((0, lower), (0, upper), (1, upper)):
        forces = []
        for far in (1.0, 1.5):
            data.ctrl[:] = 0.0
            data.ctrl[i] = far * bound[i]
            mujoco.mj_forward(model, data)
            forces.append(data.actuator_force[i])
        assert forces[0] == forces[1] != 0.0


LIMITED = (
    '<position name="p" joint="one" kp="300" kv="2" forcerange="-5 5" gear="1.5"/>'
    '<motor joint="two" gear="2" forcerange="-3 3"/>'
    '<position joint="three" kp="120" dampratio="1" forcerange="-4 4"/>'
)


def test_servos_with_a_range_of_force_move_as_in_mujoco(tmp_path):
    """A tenth of a second at the limit of one, two or three of them; the error halves with h."""
    path = tmp_path / "model.xml"
    path.write_text(MODEL.replace("ACTUATORS", LIMITED))
    scene, model = slcp.load_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    assert scene.control_names == ("p", "actuator1", "actuator2")
    assert [t.force_limit for t in scene.tendons] == [5.0, 3.0, 4.0]
    data, sim = mujoco.MjData(model), slcp.Simulator(scene, device="cpu", dtype="float64")
    limits, at_limit = np.array([5.0, 3.0, 4.0]), np.zeros(3)
    for q, v, u in zip(*states(model, 3)):
        u, errors = u * [1.0, 4.0, 1.0], []
        for h in (1e-3, 5e-4):
            there, steps, forces = moved(model, data, q, v, u, h)
            at_limit += (np.abs(forces) >= limits).sum(axis=0)
            run = sim.rollout([*q, *v], np.tile(u, (steps, 1)), sim.params.replace(step_size=h))
            errors.append(np.abs(run.states[-1] - there).max())
        assert errors[0] < 0.1 and 0.4 < errors[1] / errors[0] < 0.6
    assert (at_limit > 100).all()


def test_a_range_of_force_needs_no_push_by_itself(tmp_path):
    path = tmp_path / "model.xml"
    pushes = '<general joint="one" biastype="affine" biasprm="1 0 -2" forcerange="-5 5"/>'
    path.write_text(MODEL.replace("ACTUATORS", pushes))
    with pytest.raises(slcp.MjcfError, match="it pushes by 1 without a control; with forcerange"):
        slcp.load_mjcf(path)
    assert slcp.mjcf_control_limits(path)[1].tolist() == [np.inf]
