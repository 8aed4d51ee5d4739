"""Description of a planar mechanism: bodies in a tree, shapes on them, pairs of shapes that may touch.

World x points right, y up, angles are counter-clockwise from +x; lengths in m, masses in kg, angles in rad
(or any self-consistent units). A scene only describes; `Simulator` makes kernels from it.
"""

import copy
import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from slcp_warp.kernels.structure import Structure, layout

from ..inputs.checks import array, instance
from ..inputs.errors import ArgumentError, ArgumentTypeError, SceneError
from ..storage.printed import Printed, Table
from . import names
from .auto_contacts import AUTO, auto_contacts, check_excluded
from .fields import Fields
from .overview import scene_line, scene_tables
from .parts import JOINTS, Actuator, Body, Contact, Pair2, Shape, Spring, Tendon, radii, spread
from .topology import contact_ends, structure_of

PARTS = {
    "bodies": Body,
    "shapes": Shape,
    "contacts": Contact,
    "actuators": Actuator,
    "springs": Spring,
    "tendons": Tendon,
}


@dataclass(frozen=True, repr=False)
class Scene(Printed):
    """A planar mechanism with its default numbers.

    Attributes:
        name: for messages, charts and files.
        bodies: parents before children.
        shapes, actuators, springs, tendons: see the classes.
        contacts: the pairs of shapes that may touch; "auto": all, but those of one body, of bodies that a
            joint ties to each other, and what `excluded` and the shapes' `contype` leave out
            (`auto_contacts.py` has the rules, which are MuJoCo's). `all_contacts` has the pairs.
        gravity: [m/s^2].
        step_size: default h > 0 [s].
        sigma: default noise level of the smoothing, > 0 [m/s, rad/s].
        initial_state: x0 = (q, v), (2 nv,), or numbers by state name, the others zero.
        period: per degree of freedom > 0, or None: q_j and q_j + period look alike.
        implicit_damping: whether dampers, of joints and of springs, act with the velocity at the end of a
            step: stable for every c h/m. False: with that at its start, the paper's r(q, v), which diverges
            for c h/m > 2.
        implicit_stiffness: whether Euler's step meets springs, of joints and between points, at q + h/2 (v' -
            v): stable for every h omega, omega^2 = k/m, (M50). False: at q, which diverges for h omega > 2.
            The trapezoidal integrator is stable by itself.
        friction: under "auto", of shapes that have none of their own, >= 0; None: without friction.
        restitution: the same of restitution, in [0, 1]; None: what meets does not bounce.
        excluded: under "auto", pairs of names of bodies that never touch.
    """

    name: str
    bodies: tuple[Body, ...]
    shapes: tuple[Shape, ...] = ()
    contacts: tuple[Contact, ...] | Literal["auto"] = ()
    actuators: tuple[Actuator, ...] = ()
    gravity: Pair2 = (0.0, -9.81)
    step_size: float = 0.01
    sigma: float = 0.1
    initial_state: tuple[float, ...] | Mapping[str, float] | None = None
    period: tuple[float | None, ...] | None = None
    springs: tuple[Spring, ...] = ()
    implicit_damping: bool = True
    friction: float | None = None
    excluded: tuple[tuple[str, str], ...] = ()
    implicit_stiffness: bool = True
    restitution: float | None = None
    tendons: tuple[Tendon, ...] = ()
    structure: Structure = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        Fields(self, "scene, ").text("name")
        fields = Fields(self, f"scene {self.name!r}: ")
        for name, kind in PARTS.items():
            if name == "contacts" and isinstance(self.contacts, str):
                fields.choice(name, (AUTO,))
            else:
                fields.objects(name, kind)
        fields.pair("gravity")
        fields.number("step_size")
        fields.number("sigma")
        fields.flag("implicit_damping")
        fields.flag("implicit_stiffness")
        fields.number("friction", optional=True)
        fields.number("restitution", optional=True)
        excluded = check_excluded(f"scene {self.name!r}: excluded", self.excluded, self.bodies)
        object.__setattr__(self, "excluded", excluded)
        if not isinstance(self.contacts, str):
            self._check_listed()
        object.__setattr__(self, "structure", self._structure())
        if isinstance(self.initial_state, Mapping):
            object.__setattr__(self, "initial_state", self._named_state(self.initial_state))
        fields.entries("initial_state", 2 * self.structure.nv)
        fields.entries("period", self.structure.nv, optional=True)

    def _named_state(self, given: Mapping[str, float]) -> tuple[float, ...]:
        """The numbers of a state of which some are given by name."""
        try:
            return tuple(self.state(given, np.zeros(2 * self.nv)).tolist())
        except (ArgumentError, ArgumentTypeError) as error:
            raise SceneError(f"scene {self.name!r}: initial_state: {error}") from None

    def _check_listed(self) -> None:
        """An error for what only "auto" looks at, but for bits, which boxes have by themselves."""
        given = [f"{name} of shape {s.name!r}" for name in ("friction", "restitution") for s in self.shapes
                 if getattr(s, name) is not None][:1]  # fmt: skip
        given += [name for name in ("friction", "restitution", "excluded")
                  if getattr(self, name) not in (None, ())]  # fmt: skip
        if given:
            raise SceneError(f"scene {self.name!r}: {given[-1]} is for contacts='auto'; contacts that are "
                             "listed say themselves what touches and how")  # fmt: skip

    def _structure(self) -> Structure:
        if not self.bodies:
            raise SceneError(f"bodies: scene {self.name!r} has none; it needs at least one")
        parts = self.bodies, self.shapes, self.all_contacts, self.actuators, self.springs, self.tendons
        return structure_of(*parts, self.implicit_damping, self.implicit_stiffness)

    def _line(self) -> str:
        return scene_line(self)

    def _tables(self) -> list[Table]:
        return scene_tables(self)

    @functools.cached_property
    def all_contacts(self) -> tuple[Contact, ...]:
        """The contacts, those of "auto" written out."""
        if isinstance(self.contacts, str):
            return auto_contacts(self.bodies, self.shapes, self.friction, self.excluded, self.restitution)
        return self.contacts

    @property
    def nv(self) -> int:
        """Degrees of freedom."""
        return self.structure.nv

    @property
    def nu(self) -> int:
        """Controls."""
        return self.structure.nu

    @property
    def x0(self) -> np.ndarray:
        """Default initial state (2 nv,); zero where none was given."""
        return np.zeros(2 * self.nv) if self.initial_state is None else np.array(self.initial_state, float)

    @property
    def state_period(self) -> np.ndarray:
        """Period of every state component, 0 where there is none, (2 nv,)."""
        period = [p or 0.0 for p in (self.period or (None,) * self.nv)]
        return np.array(period + [0.0] * self.nv)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the components of a state, (2 nv,): `body.angle`, `body.vangle`, see `names.py`."""
        return names.state_names(self.bodies)

    @property
    def state_units(self) -> tuple[str, ...]:
        """Their units, (2 nv,)."""
        return names.state_units(self.bodies)

    @property
    def control_names(self) -> tuple[str, ...]:
        """Names of the controls, (nu,): those of the degrees of freedom and tendons that they drive."""
        return names.control_names(self.bodies, self.structure, self.tendons)

    @property
    def spring_names(self) -> tuple[str, ...]:
        """Names of the springs between bodies: `body_a/body_b`, further ones #2, #3, .."""
        return names.spring_names(self.springs)

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Names of the tendons."""
        return tuple(tendon.name for tendon in self.tendons)

    @property
    def pair_names(self) -> tuple[str, ...]:
        """Names of the pairs that may touch, `shape_a/shape_b`."""
        return names.pair_names(self.shapes, self.structure.pairs)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the complementarity rows, (nr,): limits, then contacts."""
        return names.row_names(self.bodies, self.shapes, self.structure)

    def state_index(self, which: int | str) -> int:
        """The place of a state component, given by its name or its place."""
        return names.index_of("state component", which, self.state_names)

    def pair_index(self, which: int | str) -> int:
        """The place of a contact pair, given by its name, with the shapes in either order, or its place."""
        return names.pair_index("contact pair", which, self.pair_names)

    def pairs_of(self, which: int | str) -> tuple[int, ...]:
        """Places of the contact pairs that a name means, the first of these that there is: one pair; all of
        two shapes, "left/box"; all between two bodies or shapes, "hand/box", or of one, "box".
        """
        return names.pairs_named("contact pair", which, self.pair_names, self.shapes, self.structure.pairs)

    def control_index(self, which: int | str) -> int:
        """The place of a control, given by its name or its place."""
        return names.index_of("control", which, self.control_names)

    def tendon_index(self, which: int | str) -> int:
        """The place of a tendon, given by its name or its place."""
        return names.index_of("tendon", which, self.tendon_names)

    def state(self, values: Mapping[str, Any], base: Any = None) -> np.ndarray:
        """A state (2 nv,) with some components set by name; the others as in `base`, by default `x0`."""
        instance("values", values, Mapping, "a dict of numbers by state name")
        x = self.x0 if base is None else array("base", base, (2 * self.nv,)).copy()
        for name, value in values.items():
            x[self.state_index(name)] = array(f"value of {name!r}", value, ())
        return x

    def default_parameters(self) -> dict[str, np.ndarray]:
        """The scene's numbers by parameter name, shapes as in `kernels.structure.layout`."""
        s = self.structure
        per_dof = [(spread(b.damping, i, 0.0), spread(b.lower, i, None), spread(b.upper, i, None))
                   for b in self.bodies for i in range(JOINTS[b.joint])]  # fmt: skip
        pairs = [c for c in self.all_contacts for _ in contact_ends(self.shapes, c)]
        friction = [c.friction or 0.0 for c in pairs]
        extents = [radii(shape) for shape in self.shapes]
        values = {
            "step_size": np.array(self.step_size),
            "gravity": np.array(self.gravity, float),
            "sigma": np.full(s.nr, self.sigma),
            "mass": np.array([b.mass for b in self.bodies], float),
            "inertia": np.array([b.inertia for b in self.bodies], float),
            "com": np.array([b.com for b in self.bodies], float).reshape(-1, 2),
            "anchor": np.array([b.anchor for b in self.bodies], float).reshape(-1, 2),
            "angle": np.array([b.angle for b in self.bodies], float),
            "axis": np.array([b.axis for b in self.bodies], float).reshape(-1, 2),
            "damping": np.array([d for d, _, _ in per_dof], float),
            "lower": np.array([0.0 if lo is None else lo for _, lo, _ in per_dof], float),
            "upper": np.array([0.0 if up is None else up for _, _, up in per_dof], float),
            "gear": np.array([a.gear for a in self.actuators], float),
            "friction": np.array(friction, float),
            "radius": np.array(extents, float).reshape(-1, 2),
            "shape_offset": np.array([sh.offset for sh in self.shapes], float).reshape(-1, 2),
            "shape_angle": np.array([sh.angle for sh in self.shapes], float),
        }
        if s.bounces:
            values["restitution"] = np.array([c.restitution or 0.0 for c in pairs], float)
        if s.runs:
            values["surface_ratio"] = np.array(
                [sh.surface_ratio * bool(sh.driven_by) for sh in self.shapes], float
            )
        if "corner_radius" in layout(s).names:
            values["corner_radius"] = np.array([sh.corner_radius for sh in self.shapes], float)
        present = [*(("stiffness", "rest") if s.sprung else ()), *(("armature",) if s.armature else ())]
        for name in present:
            per = [spread(getattr(b, name), i, 0.0) for b in self.bodies for i in range(JOINTS[b.joint])]
            values[name] = np.array([0.0 if x is None else x for x in per], float)
        if s.springs:
            for name in ("stiffness", "damping", "length"):
                values[f"spring_{name}"] = np.array([getattr(sp, name) for sp in self.springs], float)
            values["spring_point"] = np.array([(sp.point_a, sp.point_b) for sp in self.springs], float)
        if s.tendons:
            for name in ("stiffness", "damping", "length"):
                values[f"tendon_{name}"] = np.array([getattr(t, name) for t in self.tendons], float)
            at = self.state_names.index
            ordered = [sorted(zip(map(at, t.coordinates), t.coefficients)) for t in self.tendons]
            values["tendon_coefficient"] = np.array([c for one in ordered for _, c in one], float)
            if s.limited:
                values["tendon_force_limit"] = np.array([t.force_limit or 0.0 for t in self.tendons], float)
                values["tendon_force_sigma"] = np.array([t.force_sigma for t in self.tendons], float)
        if s.uncertain:
            values["position_covariance"] = np.zeros((s.nv, s.nv))
            values["velocity_covariance"] = self.sigma**2 * np.eye(s.nv)
        return values

    def with_listed_contacts(self) -> "Scene":
        """The same scene with the contacts of "auto" as a list; what its shapes say of them goes."""
        shapes = tuple(
            replace(s, friction=None, restitution=None, contype=1, conaffinity=1) for s in self.shapes
        )
        return replace(
            self, shapes=shapes, contacts=self.all_contacts, friction=None, excluded=(), restitution=None
        )

    def with_covariances(self) -> "Scene":
        """The same scene with `position_covariance` and `velocity_covariance` among its numbers."""
        out = copy.copy(self)
        object.__setattr__(out, "structure", replace(self.structure, uncertain=True))
        return out
