"""A scene that was read from MJCF beside MuJoCo's own model: the same states, mass matrices and forces."""

import numpy as np
import pytest
from oracle import Oracle

mujoco = pytest.importorskip("mujoco")


def turn_of(model, plane="xz"):
    """Our coordinates by MuJoCo's, (nv, nv), where slides of free bodies are the axes x and y of the plane,
    in this order: hinges against the plane's normal change their sign.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    normal = np.array({"xz": (0.0, -1.0, 0.0), "xy": (0.0, 0.0, 1.0)}[plane])
    hinges = np.asarray(model.jnt_type) == int(mujoco.mjtJoint.mjJNT_HINGE)
    return np.diag(np.where(hinges, np.sign(np.asarray(data.xaxis).reshape(-1, 3) @ normal), 1.0))


def full_matrix(model, data):
    """MuJoCo's mass matrix."""
    columns = []
    for unit in np.eye(model.nv):
        columns.append(np.zeros(model.nv))
        mujoco.mj_mulM(model, data, columns[-1], unit)
    return np.stack(columns, axis=-1)


def compare(scene, model, turn, count=20, spread=0.5):
    """The largest differences of mass matrices and of forces in random states, each of the largest number."""
    data, oracle, rng = mujoco.MjData(model), Oracle(scene), np.random.default_rng(0)
    worst = np.zeros(2)
    for _ in range(count):
        q, v, u = (
            spread * rng.normal(size=model.nv),
            rng.normal(size=model.nv),
            rng.uniform(-1.0, 1.0, model.nu),
        )
        data.qpos[:], data.qvel[:], data.ctrl[:] = model.qpos0 + q, v, u
        mujoco.mj_forward(model, data)
        theirs = (
            turn @ full_matrix(model, data) @ turn.T,
            turn @ (data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator),
        )
        ours = oracle.mass_matrix(turn @ q), oracle.force(turn @ q, turn @ v, u)
        worst = np.maximum(
            worst, [np.abs(a - b).max() / (np.abs(b).max() or 1.0) for a, b in zip(ours, theirs)]
        )
    return worst
