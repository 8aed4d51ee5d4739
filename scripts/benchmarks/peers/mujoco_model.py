"""MuJoCo's model of a planar scene, its step and its Jacobians.

The extra `bench` installs MuJoCo; nothing here imports it before it is asked for. The plane is MuJoCo's x-y
plane, joints are hinges about z and slides (a free body has two slides and a hinge), discs are spheres,
ellipses ellipsoids (their out-of-plane radius does not enter a planar distance), half-planes of the world
planes, those of bodies the faces of large boxes, and only the scene's contact pairs may touch, unless bodies
are given geoms of MuJoCo's own. Numbers are the scene's, options MuJoCo's defaults.
"""

import copy
import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any
from xml.etree import ElementTree as xml

import numpy as np

from slcp_warp import Body, Scene, SceneError, Shape
from slcp_warp.description.parts import JOINTS, spread

from ..shared.optional import load
from ..shared.workload import Workload
from .peer import NEAR, Deviation, deviation_of

OUT_OF_PLANE = 0.3  # radius of the ellipsoids along z [m]
POINT = 1e-12  # radius of a point: MuJoCo has no sphere of radius 0 [m]
OTHER_FRICTION = "0.005 0.0001 0.0001"  # torsional and rolling, MuJoCo's defaults: they do not act here

FAR = 100.0  # half the edge of a box whose face is a body's half-plane [m]

Geoms = dict[str | None, list[dict[str, str]]]  # attributes of geoms by body, None: the world's
Forward = Callable[[Any, np.ndarray], Iterable[Any]]


def import_mujoco() -> Any:
    """The module `mujoco` with `mujoco.rollout`, or an error that says what installs it."""
    mujoco = load("mujoco", "MuJoCo", "bench")
    load("mujoco.rollout", "MuJoCo", "bench")
    return mujoco


def _text(*numbers: float) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def mjcf(
    scene: Scene, contact: dict[str, str] | None = None, flags: tuple[str, ...] = (),
    geoms: Geoms | None = None, /, **option: str,
) -> str:  # fmt: skip
    """The scene as MJCF.

    `option` sets attributes of <option> beside the time step and gravity, `contact` the attributes solref and
    solimp of every contact and joint limit, `flags` enables flags. `geoms` stand in for the scene's shapes
    and pairs: all of them may touch, with the friction of the scene's first pair.
    """
    root = xml.Element("mujoco", model=scene.name)
    xml.SubElement(root, "compiler", angle="radian", autolimits="true")
    gravity = _text(*scene.gravity, 0.0)
    options = {"timestep": _text(scene.step_size), "gravity": gravity, **option}
    element = xml.SubElement(root, "option", options)
    xml.SubElement(element, "flag", dict.fromkeys(flags, "enable"))
    defaults = xml.SubElement(root, "default")
    xml.SubElement(defaults, "geom" if geoms else "pair", contact or {})
    xml.SubElement(defaults, "joint", {f"{name}limit": x for name, x in (contact or {}).items()})
    nodes: dict[str | None, xml.Element] = {None: xml.SubElement(root, "worldbody")}
    for body in scene.bodies:
        nodes[body.name] = _body(nodes[body.parent], body)
    if geoms is None:
        _pairs(root, nodes, scene)
    for body_name, own in (geoms or {}).items():
        for attributes in own:
            friction = (
                f"{_text(scene.all_contacts[0].friction or 0.0)} {' '.join(OTHER_FRICTION.split()[:2])}"
            )
            xml.SubElement(nodes[body_name], "geom", {"mass": "0", "friction": friction, **attributes})
    _tendons(root, scene)
    actuators = xml.SubElement(root, "actuator")
    for a in scene.actuators:
        of = {"joint": f"{a.body}.{a.dof}"} if a.tendon is None else {"tendon": a.tendon}
        xml.SubElement(actuators, "motor", of, gear=_text(a.gear))
    if scene.springs:
        raise SceneError(f"scene {scene.name!r}: the MuJoCo benchmark takes no springs between points")
    return xml.tostring(root, encoding="unicode")


def _tendons(root: xml.Element, scene: Scene) -> None:
    """The scene's tendons as fixed ones."""
    joints = [f"{b.name}.{i}" for b in scene.bodies for i in range(JOINTS[b.joint])]
    tendons = xml.SubElement(root, "tendon")
    for tendon in scene.tendons:
        own = xml.SubElement(tendons, "fixed", name=tendon.name, stiffness=_text(tendon.stiffness),
                             damping=_text(tendon.damping), springlength=_text(tendon.length))  # fmt: skip
        for name, coefficient in zip(tendon.coordinates, tendon.coefficients):
            joint = joints[scene.state_index(name)]
            xml.SubElement(own, "joint", joint=joint, coef=_text(coefficient))


def _pairs(root: xml.Element, nodes: dict[str | None, xml.Element], scene: Scene) -> None:
    """The scene's own shapes, and its pairs: nothing else may touch."""
    touching = {name for c in scene.all_contacts for name in (c.shape_a, c.shape_b)}
    for shape in (shape for shape in scene.shapes if shape.name in touching):
        _geom(nodes[shape.body], shape)
    contacts = xml.SubElement(root, "contact")
    for c in scene.all_contacts:
        mu = c.friction or 0.0
        xml.SubElement(contacts, "pair", geom1=c.shape_a, geom2=c.shape_b,
                       condim="1" if c.friction is None else "3",
                       friction=f"{_text(mu, mu)} {OTHER_FRICTION}")  # fmt: skip


def _geom(parent: xml.Element, shape: Shape) -> None:
    """A half-plane, disc, capsule, ellipse or rectangle as a plane or box, sphere, capsule, ellipsoid or box
    of its body; boxes are sharp.
    """
    geom = xml.SubElement(parent, "geom", name=shape.name, mass="0", contype="0", conaffinity="0",
                          pos=_text(*shape.offset, 0.0))  # fmt: skip
    radius = shape.radius if isinstance(shape.radius, tuple) else (shape.radius,)
    along = (math.cos(shape.angle), math.sin(shape.angle))
    if shape.kind == "halfplane" and shape.body is not None:
        geom.set("type", "box")
        geom.set("size", _text(FAR, FAR, FAR))
        geom.set("euler", _text(0.0, 0.0, shape.angle))
        geom.set("pos", _text(*(x - FAR * n for x, n in zip(shape.offset, along)), 0.0))
    elif shape.kind == "halfplane":
        geom.set("type", "plane")
        geom.set("size", "0 0 1")
        geom.set("zaxis", _text(*along, 0.0))
    elif shape.kind == "capsule":
        geom.set("type", "capsule")
        geom.set("size", _text(radius[0], radius[-1]))
        geom.set("zaxis", _text(*along, 0.0))
    elif shape.kind == "rectangle":
        geom.set("type", "box")
        geom.set("size", _text(*radius, OUT_OF_PLANE))
        geom.set("euler", _text(0.0, 0.0, shape.angle))
    elif shape.kind == "disc":
        geom.set("type", "sphere")
        geom.set("size", _text(max(radius[0], POINT)))
    elif shape.kind == "ellipse":
        geom.set("type", "ellipsoid")
        geom.set("size", _text(radius[0], radius[-1], OUT_OF_PLANE))
        geom.set("euler", _text(0.0, 0.0, shape.angle))
    else:
        raise SceneError(f"shape {shape.name!r}: the MuJoCo benchmark takes no {shape.kind}s")


def _body(parent: xml.Element, body: Body) -> xml.Element:
    """A body with its joints and inertia under its parent's element; joints are named body.dof."""
    node = xml.SubElement(parent, "body", name=body.name, pos=_text(*body.anchor, 0.0),
                          euler=_text(0.0, 0.0, body.angle))  # fmt: skip
    slides = {"revolute": (), "prismatic": (body.axis,), "free": ((1.0, 0.0), (0.0, 1.0))}[body.joint]
    c, s = math.cos(body.angle), math.sin(body.angle)
    axes = [("slide", (c * x + s * y, c * y - s * x, 0.0)) for x, y in slides]  # in the body's own frame
    if body.joint != "prismatic":
        axes.append(("hinge", (0.0, 0.0, 1.0)))
    for i, (kind, axis) in enumerate(axes):
        joint = xml.SubElement(node, "joint", name=f"{body.name}.{i}", type=kind, axis=_text(*axis))
        joint.set("damping", _text(spread(body.damping, i, 0.0) or 0.0))
        joint.set("armature", _text(spread(body.armature, i, None) or 0.0))
        lower, upper = spread(body.lower, i, None), spread(body.upper, i, None)
        if lower is not None or upper is not None:
            joint.set("range", _text(-1e6 if lower is None else lower, 1e6 if upper is None else upper))
        stiffness = spread(body.stiffness, i, None)
        if stiffness is not None:
            joint.set("stiffness", _text(stiffness))
            joint.set("springref", _text(spread(body.rest, i, 0.0) or 0.0))
    xml.SubElement(node, "inertial", pos=_text(*body.com, 0.0), mass=_text(body.mass),
                   diaginertia=_text(body.inertia, body.inertia, body.inertia))  # fmt: skip
    return node


class Peer:
    """MuJoCo's model of a scene with one data per thread.

    Attributes:
        mujoco: the module.
        model: mjModel.
        data: one mjData per thread.
    """

    def __init__(
        self, scene: Scene, threads: int = 1, contact: dict[str, str] | None = None,
        flags: tuple[str, ...] = (), geoms: Geoms | None = None, /, **option: str,
    ) -> None:  # fmt: skip
        self.mujoco = import_mujoco()
        self.scene = scene
        self.model = self.mujoco.MjModel.from_xml_string(mjcf(scene, contact, flags, geoms, **option))
        self.data = [self.mujoco.MjData(self.model) for _ in range(threads)]
        self._physics = self.mujoco.mjtState.mjSTATE_FULLPHYSICS

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

    def deviation(self, q: np.ndarray, forward: Forward | None = None) -> Deviation:
        """Deviation of M and of all pairs' distances and normals from the scene's own, at q (K, nv).

        `forward` stands in for mj_forward: it gives an mjData for each configuration, contacts included.
        """
        model = copy.copy(self.model)
        model.pair_margin[:] = 1.01 * NEAR  # contacts are made as far away
        masses = np.zeros((len(q), model.nv, model.nv))
        gaps = np.full((len(q), len(self.scene.all_contacts)), np.inf)
        normals = np.zeros((*gaps.shape, 2))
        pairs = [
            tuple(model.geom(name).id for name in (c.shape_a, c.shape_b)) for c in self.scene.all_contacts
        ]
        for i, data in enumerate((forward or self._forward)(model, q)):
            self.mujoco.mj_fullM(model, data, masses[i])
            for touch in data.contact:
                ends = tuple(touch.geom.tolist())
                k = pairs.index(ends if ends in pairs else ends[::-1])
                if touch.dist < gaps[i, k]:
                    gaps[i, k] = touch.dist
                    normals[i, k] = touch.frame[:2] if ends in pairs else -touch.frame[:2]
        return deviation_of(self.scene, q, masses, gaps, normals)

    def _forward(self, model: Any, q: np.ndarray) -> Iterator[Any]:
        data = self.mujoco.MjData(model)
        for qi in q:
            data.qpos[:] = qi
            self.mujoco.mj_forward(model, data)
            yield data

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
