"""MuJoCo's model of a planar scene of revolute bodies, its step and its Jacobians.

The extra `bench` installs MuJoCo; nothing here imports it before it is asked for. The plane is MuJoCo's x-y
plane, joints are hinges about z, ellipses are ellipsoids (their out-of-plane radius does not enter a planar
distance), and only the scene's contact pairs may touch. Numbers are the scene's, options MuJoCo's defaults.
"""

import importlib
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as xml

import numpy as np

from slcp_warp.scene import Body, Scene, SceneError

from .bench_workload import Workload

OUT_OF_PLANE = 0.3  # radius of the ellipsoids along z [m]
OTHER_FRICTION = "0.005 0.0001 0.0001"  # torsional and rolling, MuJoCo's defaults: they do not act here


def import_mujoco() -> Any:
    """The module `mujoco` with `mujoco.rollout`, or an error that says what installs it."""
    try:
        mujoco = importlib.import_module("mujoco")
        importlib.import_module("mujoco.rollout")
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "this benchmark compares with MuJoCo: pip install 'slcp-warp[bench]'", name=error.name
        ) from error
    return mujoco


def _scalar(value: tuple[float | None, ...] | float | None) -> float | None:
    """A body's number for its one degree of freedom."""
    return value[0] if isinstance(value, tuple) else value


def _text(*numbers: float) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def mjcf(scene: Scene, **option: str) -> str:
    """The scene as MJCF; `option` sets attributes of <option> beside the time step and gravity."""
    root = xml.Element("mujoco", model=scene.name)
    xml.SubElement(root, "compiler", angle="radian", autolimits="true")
    gravity = _text(*scene.gravity, 0.0)
    xml.SubElement(root, "option", {"timestep": _text(scene.step_size), "gravity": gravity, **option})
    nodes: dict[str | None, xml.Element] = {None: xml.SubElement(root, "worldbody")}
    for body in scene.bodies:
        nodes[body.name] = _body(nodes[body.parent], body)
    touching = {name for c in scene.contacts for name in (c.shape_a, c.shape_b)}
    for shape in (shape for shape in scene.shapes if shape.name in touching):
        if shape.kind == "halfplane":
            raise SceneError(f"shape {shape.name!r}: the MuJoCo benchmark takes ellipses and discs")
        radius = shape.radius if isinstance(shape.radius, tuple) else (shape.radius,)
        xml.SubElement(nodes[shape.body], "geom", name=shape.name, type="ellipsoid", mass="0", contype="0",
                       conaffinity="0", size=_text(radius[0], radius[-1], OUT_OF_PLANE),
                       pos=_text(*shape.offset, 0.0), euler=_text(0.0, 0.0, shape.angle))  # fmt: skip
    contacts = xml.SubElement(root, "contact")
    for c in scene.contacts:
        mu = c.friction or 0.0
        xml.SubElement(contacts, "pair", geom1=c.shape_a, geom2=c.shape_b,
                       condim="1" if c.friction is None else "3",
                       friction=f"{_text(mu, mu)} {OTHER_FRICTION}")  # fmt: skip
    actuators = xml.SubElement(root, "actuator")
    for a in scene.actuators:
        xml.SubElement(actuators, "motor", joint=a.body, gear=_text(a.gear))
    return xml.tostring(root, encoding="unicode")


def _body(parent: xml.Element, body: Body) -> xml.Element:
    """A body with its hinge and inertia under its parent's element."""
    if body.joint != "revolute":
        raise SceneError(f"body {body.name!r}: the benchmark takes revolute joints, not {body.joint!r}")
    node = xml.SubElement(parent, "body", name=body.name, pos=_text(*body.anchor, 0.0),
                          euler=_text(0.0, 0.0, body.angle))  # fmt: skip
    damping, lower, upper = _scalar(body.damping), _scalar(body.lower), _scalar(body.upper)
    hinge = xml.SubElement(node, "joint", name=body.name, type="hinge", axis="0 0 1")
    hinge.set("damping", _text(damping or 0.0))
    if lower is not None or upper is not None:
        hinge.set("range", _text(-1e6 if lower is None else lower, 1e6 if upper is None else upper))
    xml.SubElement(node, "inertial", pos=_text(*body.com, 0.0), mass=_text(body.mass),
                   diaginertia=_text(body.inertia, body.inertia, body.inertia))  # fmt: skip
    return node


@dataclass
class Deviation:
    """Largest differences between MuJoCo's model and the scene's own numbers over some states."""

    mass_matrix: float
    distance: float


class Peer:
    """MuJoCo's model of a scene with one data per thread.

    Attributes:
        mujoco: the module. model: mjModel. data: one mjData per thread.
    """

    def __init__(self, scene: Scene, threads: int = 1, **option: str) -> None:
        self.mujoco = import_mujoco()
        self.scene = scene
        self.model = self.mujoco.MjModel.from_xml_string(mjcf(scene, **option))
        self.data = [self.mujoco.MjData(self.model) for _ in range(threads)]
        self._physics = self.mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._control = self.mujoco.mjtState.mjSTATE_CTRL

    @property
    def version(self) -> str:
        """MuJoCo's version."""
        return self.mujoco.__version__

    def full_states(self, x: np.ndarray) -> np.ndarray:
        """States (B, nx) as MuJoCo's rows (B, nstate): time, then q and v, which are ours unchanged."""
        size = self.mujoco.mj_stateSize(self.model, self._physics)
        out = np.zeros((len(x), size))
        out[:, 1 : 1 + x.shape[1]] = x
        return out

    def rollout(self, work: Workload) -> np.ndarray:
        """States after every step (B, N, nx); one thread per entry of `data`."""
        rollout = self.mujoco.rollout.rollout
        data = self.data if len(self.data) > 1 else self.data[0]
        states, _ = rollout(self.model, data, self.full_states(work.x0), work.controls)
        return states[:, :, 1 : 1 + work.x0.shape[1]]

    def set_state(self, x: np.ndarray, u: np.ndarray) -> None:
        """Put a state (nx,) and a control (nu,) into the first data, with no warm start."""
        data = self.data[0]
        data.qpos[:], data.qvel[:], data.ctrl[:] = x[: self.model.nq], x[self.model.nq :], u
        data.qacc_warmstart[:] = 0.0

    def touching(self, x: np.ndarray) -> np.ndarray:
        """Whether MuJoCo makes a contact at each state (..., nx): a pair's distance is negative."""
        data, flat = self.data[0], x.reshape(-1, x.shape[-1])
        out = np.zeros(len(flat), bool)
        for i, state in enumerate(flat):
            self.set_state(state, np.zeros(self.model.nu))
            self.mujoco.mj_fwdPosition(self.model, data)
            out[i] = data.ncon > 0
        return out.reshape(x.shape[:-1])

    def deviation(self, q: np.ndarray, mass_matrix: np.ndarray, distance: np.ndarray) -> Deviation:
        """Largest deviation of M and of the first pair's distance from given ones, at q (B, nv)."""
        mujoco, model, data = self.mujoco, self.model, self.data[0]
        worst_m = worst_d = 0.0
        full, ends = np.zeros((model.nv, model.nv)), np.zeros(6)
        names = (self.scene.contacts[0].shape_a, self.scene.contacts[0].shape_b)
        first, second = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in names)
        for i, qi in enumerate(q):
            data.qpos[:], data.qvel[:] = qi, 0.0
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, full)
            d = mujoco.mj_geomDistance(model, data, first, second, 100.0, ends)
            worst_m = max(worst_m, float(np.abs(full - mass_matrix[i]).max()))
            worst_d = max(worst_d, abs(d - float(distance[i])))
        return Deviation(worst_m, worst_d)

    def finite_differences(
        self, x: np.ndarray, u: np.ndarray, centred: bool = False, eps: float = 1e-6
    ) -> np.ndarray:
        """Jacobians (B, nx, nx + nu) of one step at x (B, nx), u (B, nu) by mjd_transitionFD."""
        nx, nu = x.shape[1], u.shape[1]
        a, b = np.zeros((nx, nx)), np.zeros((nx, nu))
        out = np.zeros((len(x), nx, nx + nu))
        for i in range(len(x)):
            self.set_state(x[i], u[i])
            self.mujoco.mjd_transitionFD(self.model, self.data[0], eps, centred, a, b, None, None)
            out[i, :, :nx], out[i, :, nx:] = a, b
        return out
