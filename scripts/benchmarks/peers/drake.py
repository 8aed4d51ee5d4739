"""Drake as a peer: its discrete solvers with point contact, and Runge-Kutta of order 3 where nothing touches.

States are ours: a free body has Drake's planar joint, others its revolute and prismatic joints.
"""

import math
from typing import Any

import numpy as np

from slcp_warp import Body, Scene, SceneError, Shape
from slcp_warp.description.parts import JOINTS, spread

from ..shared.differences import forward
from ..shared.optional import load
from .mujoco_model import OUT_OF_PLANE
from .peer import Deviation, Linearization, Run, deviation_of, step_count

EPS = 1e-6  # spacing of the differences [rad, rad/s, N m]
TIMED = 1000  # world steps of a run that is timed
# name: Drake's discrete contact approximation; None: continuous, fixed steps of Runge-Kutta
SETTINGS = {"default": "lagged", "similar": "similar", "SAP": "sap", "RK3": None}
LIBRARY = ("geometry", "math", "multibody.plant", "multibody.tree", "systems.analysis",
           "systems.framework")  # fmt: skip
Array = np.ndarray


class Drake:
    """Drake on one thread, with its default contact stiffness and dissipation."""

    name = "Drake"

    def __init__(self) -> None:
        self.lib = {name.split(".")[-1]: load(f"pydrake.{name}", "Drake", "peers") for name in LIBRARY}
        self.version: str = load("importlib.metadata", "Drake", "peers").version("drake")

    def settings(self, contacts: bool) -> tuple[str, ...]:
        """The discrete contact solvers, the default (lagged) first; Runge-Kutta where nothing touches."""
        return ("default", "similar", "SAP") if contacts else ("default", "RK3")

    def prepare(self, scene: Scene, starts: Array, duration: float, h: float, setting: str) -> Run:
        """A run of the starts (B, nx). States after a step that Drake fails to solve are NaN."""
        model = Model(self.lib, scene, h, SETTINGS[setting])
        steps = step_count(duration, h)
        timed = np.resize(starts, (max(1, TIMED // steps), starts.shape[1]))

        def rollout() -> Array:
            out = np.full((len(starts), steps + 1, starts.shape[1]), np.nan)
            for x, states in zip(starts, out):
                model.start(x)
                states[0] = x
                try:
                    for k in range(steps):
                        states[k + 1] = model.advance((k + 1) * h)
                except RuntimeError:
                    continue
            return out

        def simulate() -> None:
            for x in timed:
                model.start(x)
                try:
                    model.advance(duration)
                except RuntimeError:
                    continue

        facts = {"dtype": "float64", "threads": 1, "batch": len(timed), "device": "cpu"}
        return Run(rollout, simulate, len(timed), duration, 0.0, facts)

    def linearization(self, scene: Scene, h: float, setting: str = "default") -> Linearization:
        """Its discrete step, and forward differences of it: there is no other derivative through contact."""
        model = Model(self.lib, scene, h, SETTINGS[setting])
        nx = 2 * scene.nv

        def step(z: Array) -> Array:
            out = np.full((len(z), nx), np.nan)
            for row, after in zip(z, out):
                model.start(row[:nx], row[nx:])
                after[:] = model.advance(h)
            return out

        def differences(z: Array) -> Array:
            return forward(step, z, EPS)

        return Linearization(step, {"forward differences": differences})

    def deviation(self, scene: Scene, q: Array) -> Deviation:
        """Of its model at q (K, nv); pairs that overlap by their penetration, others by their distance."""
        model = Model(self.lib, scene, scene.step_size, "lagged")
        masses = np.zeros((len(q), scene.nv, scene.nv))
        gaps = np.zeros((len(q), len(scene.all_contacts)))
        normals = np.zeros((*gaps.shape, 2))
        for i, qi in enumerate(q):
            model.start(np.concatenate([qi, 0.0 * qi]))
            masses[i] = model.mass_matrix()
            for k, c in enumerate(scene.all_contacts):
                gaps[i, k], normals[i, k] = model.pair(c.shape_a, c.shape_b)
        return deviation_of(scene, q, masses, gaps, normals)


class Model:
    """Drake's plant of a scene with its simulator."""

    def __init__(self, lib: dict[str, Any], scene: Scene, h: float, approximation: str | None) -> None:
        if scene.springs or scene.tendons:
            raise SceneError(f"scene {scene.name!r}: the Drake benchmark takes neither springs between "
                             "points nor tendons")  # fmt: skip
        self.lib, self.scene = lib, scene
        builder = lib["framework"].DiagramBuilder()
        config = lib["plant"].MultibodyPlantConfig()
        config.time_step = 0.0 if approximation is None else h
        config.contact_model = "point"
        if approximation is not None:
            config.discrete_contact_approximation = approximation
        self.plant, geometry = lib["plant"].AddMultibodyPlant(config, builder)
        self.plant.mutable_gravity_field().set_gravity_vector([*scene.gravity, 0.0])
        self.bodies: dict[str | None, Any] = {None: self.plant.world_body()}
        for body in scene.bodies:
            self._add_body(body)
        for a in scene.actuators:
            if JOINTS[next(b for b in scene.bodies if b.name == a.body).joint] == 1:
                self.plant.AddJointActuator(a.body, self.plant.GetJointByName(a.body))
        self.ids = self._add_shapes()
        declare, members = lib["geometry"].CollisionFilterDeclaration, lib["geometry"].GeometrySet
        filters = geometry.collision_filter_manager()
        filters.Apply(declare().ExcludeWithin(members(list(self.ids.values()))))
        for c in scene.all_contacts:
            pair = (members([self.ids[name]]) for name in (c.shape_a, c.shape_b))
            filters.Apply(declare().AllowBetween(*pair))
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.simulator = lib["analysis"].Simulator(self.diagram)
        if approximation is None:
            analysis = lib["analysis"].SimulatorConfig(
                integration_scheme="runge_kutta3", max_step_size=h, use_error_control=False
            )
            lib["analysis"].ApplySimulatorConfig(analysis, self.simulator)
        self.root = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.geometry_context = geometry.GetMyContextFromRoot(self.root)
        self.geometry = geometry

    def _add_body(self, body: Body) -> None:
        tree, plant = self.lib["tree"], self.plant
        com, about = np.array([*body.com, 0.0]), body.inertia / body.mass
        unit = tree.UnitInertia(about, about, about).ShiftFromCenterOfMass(com)
        link = plant.AddRigidBody(body.name, tree.SpatialInertia(body.mass, com, unit))
        base = tree.FixedOffsetFrame(f"{body.name}.base", self.bodies[body.parent].body_frame(),
                                     self._pose(body.anchor, 0.0))  # fmt: skip
        base = plant.AddFrame(base)
        frame = plant.AddFrame(tree.FixedOffsetFrame(f"{body.name}.joint", link.body_frame(),
                                                     self._pose((0.0, 0.0), -body.angle)))  # fmt: skip
        count = JOINTS[body.joint]
        damping = [spread(body.damping, i, 0.0) or 0.0 for i in range(count)]
        if body.joint == "revolute":
            joint = tree.RevoluteJoint(body.name, base, frame, [0.0, 0.0, 1.0], damping=damping[0])
        elif body.joint == "prismatic":
            joint = tree.PrismaticJoint(body.name, base, frame, [*body.axis, 0.0], damping=damping[0])
        else:
            joint = tree.PlanarJoint(body.name, base, frame, damping=damping)
        joint = plant.AddJoint(joint)
        lower, upper = ([spread(bound, i, None) for i in range(count)] for bound in (body.lower, body.upper))
        joint.set_position_limits([-math.inf if x is None else x for x in lower],
                                  [math.inf if x is None else x for x in upper])  # fmt: skip
        stiffness, rest = spread(body.stiffness, 0, None), spread(body.rest, 0, 0.0)
        if stiffness is not None:
            if count != 1:
                raise SceneError(f"body {body.name!r}: the Drake benchmark takes no springs of free bodies")
            spring = tree.RevoluteSpring if body.joint == "revolute" else tree.PrismaticSpring
            plant.AddForceElement(spring(joint, rest, stiffness))
        self.bodies[body.name] = link

    def _add_shapes(self) -> dict[str, Any]:
        friction = {
            name: c.friction or 0.0 for c in self.scene.all_contacts for name in (c.shape_a, c.shape_b)
        }
        return {
            shape.name: self._add_shape(shape, friction[shape.name])
            for shape in self.scene.shapes
            if shape.name in friction
        }

    def _add_shape(self, shape: Shape, friction: float) -> Any:
        geometry = self.lib["geometry"]
        properties = geometry.ProximityProperties()
        coulomb = self.lib["plant"].CoulombFriction(friction, friction)
        geometry.AddContactMaterial(properties=properties, friction=coulomb)
        radius = shape.radius if isinstance(shape.radius, tuple) else (shape.radius,)
        pose = self._pose(shape.offset, shape.angle)
        solid: Any
        if shape.kind == "halfplane":
            normal = [math.cos(shape.angle), math.sin(shape.angle), 0.0]
            pose = geometry.HalfSpace.MakePose(normal, [*shape.offset, 0.0])
            solid = geometry.HalfSpace()
        elif shape.kind == "disc":
            solid = geometry.Sphere(radius[0])
        elif shape.kind == "ellipse":
            solid = geometry.Ellipsoid(radius[0], radius[-1], OUT_OF_PLANE)
        else:
            raise SceneError(f"shape {shape.name!r}: the Drake benchmark takes no {shape.kind}s")
        return self.plant.RegisterCollisionGeometry(
            self.bodies[shape.body], pose, solid, shape.name, properties
        )

    def _pose(self, at: tuple[float, float], angle: float) -> Any:
        geometry_math = self.lib["math"]
        return geometry_math.RigidTransform(geometry_math.RollPitchYaw(0.0, 0.0, angle), [*at, 0.0])

    def start(self, x: Array, u: Array | None = None) -> None:
        """Put in a state (nx,) at time 0 under constant controls (nu,)."""
        self.root.SetTime(0.0)
        self.plant.SetPositionsAndVelocities(self.context, x)
        if u is not None and self.scene.actuators:
            gear = np.array([a.gear for a in self.scene.actuators])
            self.plant.get_actuation_input_port().FixValue(self.context, gear * u)
        self.simulator.Initialize()

    def advance(self, time: float) -> Array:
        """Simulate up to a time [s]; the state (nx,) there."""
        self.simulator.AdvanceTo(time)
        return self.plant.GetPositionsAndVelocities(self.context)

    def mass_matrix(self) -> Array:
        """M (nv, nv)."""
        return self.plant.CalcMassMatrix(self.context)

    def pair(self, a: str, b: str) -> tuple[float, Array]:
        """Signed distance of two shapes, and the normal (2,) from a to b."""
        query = self.geometry.get_query_output_port().Eval(self.geometry_context)
        first, second = self.ids[a], self.ids[b]
        for found in query.ComputePointPairPenetration():
            if {found.id_A, found.id_B} == {first, second}:  # nhat_BA points from B into A
                return -found.depth, found.nhat_BA_W[:2] * (1.0 if found.id_B == first else -1.0)
        near = query.ComputeSignedDistancePairClosestPoints(first, second)
        return near.distance, near.nhat_BA_W[:2] * (1.0 if near.id_B == first else -1.0)
