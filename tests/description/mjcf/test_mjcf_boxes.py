"""Boxes of MJCF against round geoms and each other: distances are MuJoCo's own."""

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp

mujoco = pytest.importorskip("mujoco")
MODEL = """
<mujoco model="shove">
  <option timestep="0.01"/>
  <worldbody>
    <geom name="ledge" type="box" pos="0.9 0 0.1" euler="0 20 0" size="0.2 0.3 0.1"/>
    <body name="arm" pos="-0.4 0 0.5">
      <joint name="shoulder" type="hinge" axis="0 -1 0"/>
      <geom name="link" type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
      <body name="hand" pos="0.4 0 0">
        <joint name="wrist" type="hinge" axis="0 -1 0"/>
        <geom name="tip" type="sphere" pos="0.2 0 0" size="0.05" mass="0.3"/>
      </body>
    </body>
    <body name="crate" pos="0.2 0 0.3">
      <joint type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 0 1"/>
      <joint type="hinge" axis="0 -1 0"/>
      <geom name="crate" type="box" euler="0 -35 0" size="0.15 0.2 0.1" mass="0.7"/>
    </body>
  </worldbody>
</mujoco>
"""


def written(folder, text=MODEL):
    path = folder / "shove.xml"
    path.write_text(text)
    return path


def test_same_distances_from_round_geoms(tmp_path):
    """A capsule's nearest point may be its own end or a corner of the box; a sphere may be inside."""
    text = MODEL.replace('name="ledge" type="box"', 'name="ledge" type="box" contype="0" conaffinity="0"')
    scene = slcp.load_mjcf(written(tmp_path, text))
    model = mujoco.MjModel.from_xml_string(text)
    data, oracle = mujoco.MjData(model), Oracle(scene)
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, (300, 5)) * [1.5, 1.5, 0.4, 0.3, 3.0]
    assert [shape.kind for shape in scene.shapes if shape.name == "crate"] == ["rectangle"]
    pairs = scene.structure.pairs
    both_of = [{scene.shapes[i].name for i in (p.shape_a, p.shape_b)} for p in pairs]
    found = {name: [k for k, both in enumerate(both_of) if name in both] for name in ("link", "tip")}
    assert [len(rows) for rows in found.values()] == [6, 1]
    gaps = np.stack([oracle.contact_jacobian(q, k)[0] for k in range(len(pairs))], -1)
    ours = np.asarray(
        slcp.Simulator(scene, device="cpu", strategy="generic").step(np.hstack([q, 0.0 * q])).gap
    )
    np.testing.assert_allclose(ours[:, :: scene.structure.nr // len(pairs)], gaps, atol=1e-12)
    compared = 0
    for i, place in enumerate(q):
        data.qpos[:] = place
        mujoco.mj_forward(model, data)
        for name, rows in found.items():
            away = mujoco.mj_geomDistance(
                model, data, model.geom(name).id, model.geom("crate").id, 10.0, np.zeros(6)
            )
            if away > (-0.04 if name == "tip" else 1e-3):
                assert gaps[i, rows].min() == pytest.approx(away, abs=1e-6)
                compared += 1
    assert compared > 400


def test_two_boxes_need_a_corner_radius(tmp_path):
    path = written(tmp_path)
    with pytest.raises(slcp.SceneError, match="'ledge' and 'crate': two boxes .* corner_radius > 0"):
        slcp.load_mjcf(path)
    scene = slcp.load_mjcf(path, corner_radius=0.01)
    assert {s.corner_radius for s in scene.shapes if s.kind == "rectangle"} == {0.01}
    assert sum("ledge" in pair and "crate" in pair for pair in scene.pair_names) == 8
    with pytest.raises(slcp.SceneError, match="geom 'ledge': corner_radius is 0.2; at most half"):
        slcp.load_mjcf(path, corner_radius=0.2)
