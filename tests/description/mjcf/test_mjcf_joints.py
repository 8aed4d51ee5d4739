"""Bodies of MJCF with several joints: a chain of bodies here, whose masses and forces are MuJoCo's."""

import mujoco_beside
import numpy as np
import pytest

import slcp_warp as slcp

mujoco = pytest.importorskip("mujoco")
LAWS = {
    "smoothed": slcp.Options(),
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}
CHAINS = ("slide slide", "hinge hinge", "slide hinge", "hinge slide", "hinge", "slide", "slide hinge slide",
          "slide slide hinge", "hinge slide slide", "hinge hinge slide")  # fmt: skip


def random_model(seed, bodies=3, floor=True):
    """A tree of bodies with one to three joints in any order, with all that joints may have."""
    rng, joints, actuators = np.random.default_rng(seed), [], []

    def joint(body, number, kind):
        name = f"j{body}{number}"
        joints.append(name)
        angle = rng.uniform(0, 2 * np.pi)
        axis = f"{np.cos(angle)} 0 {np.sin(angle)}" if kind == "slide" else f"0 {rng.choice([-1, 1])} 0"
        at = "{} 0 {}".format(*rng.uniform(-0.2, 0.2, 2))
        more = f'damping="{rng.uniform(0.1, 1)}" armature="{rng.uniform(0, 0.02)}" '
        more += f'ref="{rng.uniform(-0.3, 0.3)}"'
        if rng.random() < 0.5:
            low, high = rng.uniform(0.2, 1.0, 2) * [-1, 1]
            more += f' limited="true" range="{low} {high}"'
        if rng.random() < 0.5:
            more += f' stiffness="{rng.uniform(1, 20)}" springref="{rng.uniform(-0.2, 0.2)}"'
        if rng.random() < 0.4:
            actuators.append(f'<motor joint="{name}" gear="{rng.uniform(-3, 3)}"/>')
        if rng.random() < 0.4:
            actuators.append(f'<position joint="{name}" kp="{rng.uniform(1, 9)}" kv=".2" gear=".8"/>')
        return f'<joint name="{name}" type="{kind}" axis="{axis}" pos="{at}" {more}/>'

    text, ends = "", ""
    for body in range(bodies):
        kinds = CHAINS[rng.integers(len(CHAINS))].split()
        x, z = rng.uniform(-0.4, 0.4, 2)
        euler = f"0 {rng.uniform(-np.pi, np.pi)} {rng.choice([0.0, np.pi])}"
        text += f'<body name="b{body}" pos="{x} 0 {z}" euler="{euler}">'
        text += "".join(joint(body, i, kind) for i, kind in enumerate(kinds))
        size, mass = rng.uniform(0.03, 0.1), rng.uniform(0.1, 2)
        text += f'<geom name="g{body}" type="sphere" size="{size}" mass="{mass}" pos="{x / 2} 0 .1"/>'
        if rng.random() < 0.4:
            text += "</body>"
        else:
            ends += "</body>"
    coefficients = "".join(f'<joint joint="{n}" coef="{rng.uniform(-1, 1)}"/>' for n in joints[:3])
    ground = '<geom name="floor" type="plane" pos="0 0 -1.2" size="9 9 1"/>' if floor else ""
    return f"""<mujoco model="random">
  <compiler angle="radian" eulerseq="xyz"/><option timestep=".005"/>
  <default><geom contype="1" conaffinity="1" friction=".6"/></default>
  <worldbody>{ground}<body name="root" pos="0 0 1"><joint name="root" type="slide" axis="0 0 1"/>
    <geom name="root" type="sphere" size=".1" mass="1" contype="0" conaffinity="0"/>{text}{ends}</body>
  </worldbody>
  <tendon><fixed name="t" stiffness="3" damping=".2" springlength=".1">{coefficients}</fixed></tendon>
  <actuator><motor joint="root" gear="10"/>{"".join(actuators)}</actuator></mujoco>"""


def read(folder, text, **options):
    path = folder / "model.xml"
    path.write_text(text)
    return slcp.load_mjcf(path, **options), mujoco.MjModel.from_xml_path(str(path))


@pytest.mark.parametrize("seed", range(12))
def test_random_trees_are_mujocos(tmp_path, seed):
    """Mass matrix, forces and limits, to rounding: the masses between weigh less than that."""
    scene, m = read(tmp_path, random_model(seed))
    turn = mujoco_beside.turn_of(m)
    assert scene.nv == m.nv == len(scene.bodies) > m.nbody - 1
    assert mujoco_beside.compare(scene, m, turn).max() < 1e-13
    for joint, (body, sense) in enumerate(zip(scene.bodies, np.diag(turn))):
        if m.jnt_limited[joint]:
            ends = sorted(sense * (m.jnt_range[joint] - m.qpos0[joint]))
            assert (*body.lower, *body.upper) == pytest.approx(tuple(ends))
        else:
            assert body.lower == body.upper == (None,)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_motion_is_mujocos(tmp_path, seed):
    """To the first order in h that both integrators have: the error halves with h."""
    text = random_model(seed, floor=False).replace('limited="true"', 'limited="false"')
    scene, m = read(tmp_path, text.replace('conaffinity="1"', 'conaffinity="0"', 1))
    data, turn, rng = mujoco.MjData(m), mujoco_beside.turn_of(m), np.random.default_rng(seed)
    q, v, u = 0.2 * rng.normal(size=m.nv), rng.normal(size=m.nv), rng.uniform(-1, 1, m.nu)
    sim = slcp.Simulator(scene, slcp.Options("hard"), device="cpu", dtype="float64", strategy="generic")
    errors = []
    for h in (1e-3, 5e-4):
        m.opt.timestep, steps = h, round(0.1 / h)
        mujoco.mj_resetData(m, data)
        data.qpos[:], data.qvel[:], data.ctrl[:] = m.qpos0 + q, v, u
        for _ in range(steps):
            mujoco.mj_step(m, data)
        start = [*(turn @ q), *(turn @ v)]
        run = sim.rollout(start, np.tile(u, (1, steps, 1)), sim.params.replace(step_size=h))
        there = [*(turn @ (data.qpos - m.qpos0)), *(turn @ data.qvel)]
        errors.append(np.abs(np.ravel(run.states)[-2 * m.nv :] - there).max())
    assert errors[0] < 0.1 and 0.4 < errors[1] / errors[0] < 0.6


def test_next_to_nothing_is_solved(tmp_path, dtype):
    """Falling on a floor, with all that joints may have, under each law: no mass upsets a solver's scales."""
    kinds = set()
    for seed in range(4):
        scene, _ = read(tmp_path, random_model(seed))
        kinds |= {body.joint for body in scene.bodies}
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.normal(size=(16, 8, scene.nu)), 25, axis=1)
        x = np.tile(scene.x0, (16, 1))
        for law in LAWS.values():
            sim = slcp.Simulator(scene, law, dtype=dtype.__name__, device="cpu", strategy="generic")
            run = sim.rollout(x, u, record="gap")
            assert np.all(np.asarray(run.status) == slcp.Status.SOLVED)
            assert np.asarray(run.gap).min() < 0.05
    assert kinds == {"revolute", "prismatic"}


POINT = """
<mujoco model="point">
  <option timestep=".02"><flag contact="disable"/></option>
  <default><joint type="slide" limited="true" range="-.29 .29" damping="1"/></default>
  <worldbody>
    <geom name="ground" type="plane" size="1 1 1"/>
    <body name="point" pos="0 0 .01">
      <joint {x} axis="1 0 0"/><joint {y} axis="0 1 0"/><geom name="ball" type="sphere" size=".01" mass=".3"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="t1"><joint joint="x" coef="1"/><joint joint="y" coef="0"/></fixed>
    <fixed name="t2"><joint joint="x" coef="0"/><joint joint="y" coef="1"/></fixed>
  </tendon>
  <actuator><motor tendon="t1" gear=".1"/><motor tendon="t2" gear=".1"/></actuator>
  <keyframe><key qpos=".1 .2" qvel="3 4"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_point_that_two_slides_carry(tmp_path, precision):
    """By specialised kernels, into its limits."""
    scene, m = read(tmp_path, POINT.format(x='name="x"', y='name="y"'))
    assert scene.state_names == ("x.shift", "point.shift", "x.vshift", "point.vshift")
    assert scene.control_names == ("t1", "t2") and scene.x0.tolist() == [0.1, 0.2, 3.0, 4.0]
    assert mujoco_beside.compare(scene, m, np.eye(2)).max() < 1e-15
    for law in LAWS.values():
        sim = slcp.Simulator(scene, law, dtype=precision, device="cpu")
        run = sim.rollout(np.zeros((1, 4)), np.tile([9.0, -20.0], (1, 200, 1)))
        assert np.all(np.asarray(run.status) == slcp.Status.SOLVED)
        end = np.asarray(run.states).reshape(-1, 4)[-1]
        if law is not LAWS["smoothed"]:
            assert end == pytest.approx([0.29, -0.29, 0.0, 0.0], abs=1e-5)


def test_names_of_what_joints_have_for_themselves(tmp_path):
    """The joint's; not a body's, a geom's or a tendon's."""
    text = POINT.replace("<tendon>", "<tendon><fixed><joint joint='tendon0' coef='1'/></fixed>")
    for x in ("point", "ball", "t2", "tendon0", "world"):
        named = text.format(x=f'name="{x}"', y='name="y"').replace('joint="x"', f'joint="{x}"')
        scene, _ = read(tmp_path, named.replace("joint='tendon0'", f"joint='{x}'"))
        assert [body.name for body in scene.bodies] == [f"{x}_joint", "point"]
        assert scene.tendons[1].coordinates == (f"{x}_joint.shift", "point.shift")
    untied = POINT[: POINT.index("<tendon>")] + "</mujoco>"
    scene, _ = read(tmp_path, untied.format(x="", y=""))
    assert [body.name for body in scene.bodies] == ["joint0", "point"]
    tied = POINT.replace('name="t1"', 'name="x.shift"').replace('tendon="t1"', 'tendon="x.shift"')
    scene, _ = read(tmp_path, tied.format(x='name="x"', y='name="y"'))
    assert scene.control_names == ("x.shift_tendon", "t2")


@pytest.mark.parametrize("joints", [
    '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="-1 0 0"/>',
    '<joint axis="0 1 0"/><joint axis="0 1 0"/>',
    '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint type="slide" axis="1 0 1"/>',
    '<joint axis="0 1 0"/><joint axis="0 1 0" pos=".1 0 0"/><joint axis="0 1 0" pos=".3 0 .1"/>'
    '<joint axis="0 1 0" pos="0 0 .1"/>',
])  # fmt: skip
def test_joints_that_move_a_body_alike(tmp_path, joints, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where MuJoCo may log
    text = (
        '<mujoco><worldbody><body name="b">JOINTS<geom size=".1" pos=".2 0 .1"/></body></worldbody></mujoco>'
    )
    path = tmp_path / "model.xml"
    path.write_text(text.replace("JOINTS", joints))
    with pytest.raises(slcp.MjcfError, match=r"body 'b': its \d joints move it alike"):
        slcp.load_mjcf(path)
    path.write_text(text.replace("JOINTS", joints.replace("<joint", '<joint armature=".1"')))
    scene, m = slcp.load_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    assert mujoco_beside.compare(scene, m, mujoco_beside.turn_of(m)).max() < 1e-12


def test_pairs_are_mujocos(tmp_path):
    """A body and what holds it by two joints do not touch, unless a flag says so; "auto" says the same."""
    text = """<mujoco><option>FLAG</option><worldbody><geom name="floor" type="plane" size="1 1 1"/>
      <body name="a" pos="0 0 1"><joint axis="0 1 0"/><geom name="a" size=".1"/>
      <body name="b" pos=".3 0 0"><joint type="slide" axis="1 0 0"/><joint axis="0 1 0"/>
      <geom name="b" size=".1"/>
      <body name="c" pos=".3 0 0"><joint axis="0 1 0"/><joint type="slide" axis="1 0 0"/>
      <geom name="c" size=".1"/></body></body></body></worldbody></mujoco>"""
    for flag, apart in (("", {"a", "c"}), ('<flag filterparent="disable"/>', None)):
        scene, _ = read(tmp_path, text.replace("FLAG", flag))
        pairs = {frozenset(pair.split("/")) for pair in scene.pair_names} - {
            frozenset(("floor", name)) for name in "abc"
        }
        assert scene.contacts == "auto"
        assert pairs == ({frozenset(apart)} if apart else {frozenset(p) for p in ("ab", "bc", "ac")})
