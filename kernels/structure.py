"""Compile-time structure of a planar mechanism: what selects a specialised kernel.

Everything here is hashable and holds no physical number: topology, joint kinds, which limits exist, shape
kinds, which pairs touch and whether they have friction. Masses, lengths, radii and the like are run-time
numbers in a parameter table whose columns `Layout` assigns.

Notation used by all kernels: nv degrees of freedom, nu controls, nr rows of the complementarity problem.
Rows come in this order: for every degree of freedom its lower then its upper limit, then for every contact
pair either one frictionless row n or the two rows n + mu t and n - mu t (Anitescu's relaxation, the paper's
[9]).
"""

import functools
from dataclasses import dataclass, field

from .factories import cached

REVOLUTE, PRISMATIC = "revolute", "prismatic"
DISC, ELLIPSE, HALFPLANE, CAPSULE = "disc", "ellipse", "halfplane", "capsule"
RECTANGLE = "rectangle"
RING = "ring"  # solid outside: discs, and the ends of what has sides, are inside of it
WALLS = (HALFPLANE, RING)  # what has an inside without end, or an outside; of two of them neither is round
SIDED = (CAPSULE, RECTANGLE)  # shapes that are flat beside their sides, and have discs at their ends
CORNERS = {2: (-1, -1), 3: (1, -1), 4: (1, 1), 5: (-1, 1)}  # of a rectangle, as ends, along its axes
WORLD = -1

STEP_SIZE = 0  # column of the parameter table, see `layout`
MOST_ROWS = 31  # of a specialised kernel: a set of rows, and one of pairs, is the bits of one int


class CapacityError(ValueError):
    """More rows than a specialised kernel has bits for."""


def check_capacity(s: "Structure") -> None:
    """Raise CapacityError unless sets of the rows and pairs fit in an int (a pair has one row or two)."""
    if s.nr > MOST_ROWS:
        raise CapacityError(f"a specialised kernel takes at most {MOST_ROWS} rows; the scene has {s.nr}")


@dataclass(frozen=True)
class BodyStructure:
    """One body: index of its parent (WORLD = -1), joint kind and the degrees of freedom of that joint."""

    parent: int
    joint: str
    dofs: tuple[int, ...]


@dataclass(frozen=True)
class ShapeStructure:
    """One shape: its body (WORLD = -1), kind, and whether it is turned against its body's axes; the degree of
    freedom with whose rate its surface runs (-1: none).
    """

    body: int
    kind: str
    turned: bool = False
    driver: int = field(default=-1, repr=False)


@dataclass(frozen=True)
class PairStructure:
    """Two shapes that may touch; the normal points from shape_a to shape_b.

    An end of +1 or -1 stands for the disc at that end of a capsule, one of `CORNERS` for that at a corner of
    a rectangle, 0 for the whole shape.
    """

    shape_a: int
    shape_b: int
    friction: bool
    end_a: int = 0
    end_b: int = 0
    restitution: bool = field(default=False, repr=False)  # whether it gives back some of what it is met with


@dataclass(frozen=True)
class RowStructure:
    """One complementarity row: a joint limit (dof, sign) or a contact (pair, sign of the tangent).

    The sign of a frictionless contact is 0.
    """

    kind: str
    index: int
    sign: int


@dataclass(frozen=True)
class Structure:
    """A mechanism's topology.

    Bodies come parents first, so that degrees of freedom are ordered along every chain.
    """

    bodies: tuple[BodyStructure, ...]
    shapes: tuple[ShapeStructure, ...]
    pairs: tuple[PairStructure, ...]
    lower: tuple[bool, ...]
    upper: tuple[bool, ...]
    actuators: tuple[int, ...]  # the degree of freedom that each drives, or -1 less its tendon
    sprung: tuple[int, ...] = ()  # degrees of freedom with a joint spring
    springs: tuple[tuple[int, int], ...] = ()  # bodies that a spring ties
    uncertain: bool = False  # whether there are covariances of the state, eq. (18)
    implicit_damping: bool = False  # whether dampers act with the velocity at the end of a step
    implicit_stiffness: bool = False  # whether Euler's step meets springs half a step on; only where some are
    armature: tuple[int, ...] = ()  # degrees of freedom whose coordinate has an inertia of its own
    tendons: tuple[tuple[int, ...], ...] = ()  # the degrees of freedom of each, once and ascending
    limited: tuple[int, ...] = field(default=(), repr=False)  # tendons whose force has a limit

    @property
    def nb(self) -> int:
        return len(self.bodies)

    @property
    def nv(self) -> int:
        return len(self.lower)

    @property
    def nu(self) -> int:
        return len(self.actuators)

    @property
    def nr(self) -> int:
        return len(self.rows)

    @functools.cached_property
    def rows(self) -> tuple[RowStructure, ...]:
        """The complementarity rows in order."""
        limits = [
            RowStructure("limit", j, sign)
            for j in range(self.nv)
            for sign, present in ((1, self.lower[j]), (-1, self.upper[j]))
            if present
        ]
        contacts = [
            RowStructure("contact", k, sign)
            for k, pair in enumerate(self.pairs)
            for sign in ((1, -1) if pair.friction else (0,))
        ]
        return tuple(limits + contacts)

    @functools.cached_property
    def dof_kind(self) -> tuple[str, ...]:
        """REVOLUTE or PRISMATIC for every degree of freedom."""
        kinds: list[str] = []
        for body in self.bodies:
            kinds += {
                "revolute": [REVOLUTE],
                "prismatic": [PRISMATIC],
                "free": [PRISMATIC, PRISMATIC, REVOLUTE],
            }[body.joint]
        return tuple(kinds)

    @functools.cached_property
    def dof_body(self) -> tuple[int, ...]:
        """The body that each degree of freedom moves directly."""
        return tuple(b for b, body in enumerate(self.bodies) for _ in body.dofs)

    def in_chain(self, body: int, dof: int) -> bool:
        """Whether `dof` moves `body`."""
        while body != WORLD:
            if dof in self.bodies[body].dofs:
                return True
            body = self.bodies[body].parent
        return False

    def turns(self, body: int, dof: int) -> bool:
        """Whether `dof` turns `body`."""
        return self.in_chain(body, dof) and self.dof_kind[dof] == REVOLUTE

    @property
    def runs(self) -> bool:
        """Whether the surface of a shape runs with a degree of freedom."""
        return any(shape.driver >= 0 for shape in self.shapes)

    def mover(self, shape: int) -> int:
        """The body by which a shape's contacts are moved: its own, or of one on the world its driver's."""
        own = self.shapes[shape]
        return own.body if own.body != WORLD or own.driver < 0 else self.dof_body[own.driver]

    @property
    def bounces(self) -> bool:
        """Whether a pair has a coefficient of restitution."""
        return any(pair.restitution for pair in self.pairs)

    @property
    def ties(self) -> tuple[tuple[int, int], ...]:
        """Bodies that a spring ties in what stands for M."""
        return self.springs if self.implicit_damping or self.implicit_stiffness else ()

    @property
    def joined(self) -> tuple[tuple[int, ...], ...]:
        """Degrees of freedom that a tendon ties in what stands for M."""
        return self.tendons if self.implicit_damping or self.implicit_stiffness else ()

    def tendon_start(self, tendon: int) -> int:
        """Where the coefficients of a tendon begin among those of all."""
        return sum(len(dofs) for dofs in self.tendons[:tendon])

    def driven_tendon(self, actuator: int) -> int:
        """The tendon that an actuator drives; -1: it drives a degree of freedom."""
        return max(-1, -1 - self.actuators[actuator])

    def driven(self, actuator: int) -> tuple[int, ...]:
        """The degrees of freedom that an actuator drives."""
        dof = self.actuators[actuator]
        return (dof,) if dof >= 0 else self.tendons[-1 - dof]

    @property
    def driven_bodies(self) -> frozenset[int]:
        """The bodies of the joints that actuators drive."""
        return frozenset(self.dof_body[dof] for i in range(self.nu) for dof in self.driven(i))

    def coupled(self, i: int, j: int) -> bool:
        """Whether M[i, j], or what stands for M, can differ from zero.

        It can where both move some body, or the ends of some spring that is met late, or such a tendon.
        """
        if any(i in dofs and j in dofs for dofs in self.joined):
            return True
        groups = [{b} for b in range(self.nb)]
        groups += [set(spring) for spring in self.ties]
        return any(
            any(self.in_chain(b, i) for b in group) and any(self.in_chain(b, j) for b in group)
            for group in groups
        )

    @property
    def couples(self) -> bool:
        """Whether M, or what stands for M, can have entries beside its diagonal."""
        return any(self.coupled(i, j) for i in range(self.nv) for j in range(i))


@dataclass(frozen=True)
class Layout:
    """Columns of the parameter table, one row per world: name -> (first column, shape)."""

    columns: tuple[tuple[str, int, tuple[int, ...]], ...]
    width: int

    def offset(self, name: str) -> int:
        """First column of `name`."""
        return next(start for key, start, _ in self.columns if key == name)

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of one world's value of `name`."""
        return next(shape for key, _, shape in self.columns if key == name)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(key for key, _, _ in self.columns)


@cached
def layout(s: Structure) -> Layout:
    """The parameter table's columns for a structure (SI units; see `slcp_warp.params` for their meaning)."""
    nb, ns = s.nb, len(s.shapes)
    shapes: dict[str, tuple[int, ...]] = {
        "step_size": (),
        "gravity": (2,),
        "sigma": (s.nr,),
        "mass": (nb,),
        "inertia": (nb,),
        "com": (nb, 2),
        "anchor": (nb, 2),
        "angle": (nb,),
        "axis": (nb, 2),
        "damping": (s.nv,),
        "lower": (s.nv,),
        "upper": (s.nv,),
        "gear": (s.nu,),
        "friction": (len(s.pairs),),
        "radius": (ns, 2),
        "shape_offset": (ns, 2),
        "shape_angle": (ns,),
    }
    if any(shape.kind == RECTANGLE for shape in s.shapes):
        shapes |= {"corner_radius": (ns,)}
    if s.bounces:
        shapes |= {"restitution": (len(s.pairs),)}
    if s.runs:
        shapes |= {"surface_ratio": (ns,)}
    if s.sprung:
        shapes |= {"stiffness": (s.nv,), "rest": (s.nv,)}
    if s.springs:
        n = len(s.springs)
        shapes |= {
            "spring_stiffness": (n,),
            "spring_damping": (n,),
            "spring_length": (n,),
            "spring_point": (n, 2, 2),
        }
    if s.tendons:
        n = len(s.tendons)
        shapes |= {"tendon_stiffness": (n,), "tendon_damping": (n,), "tendon_length": (n,)}
        shapes |= {"tendon_coefficient": (sum(map(len, s.tendons)),)}
        if s.limited:
            shapes |= {"tendon_force_limit": (n,), "tendon_force_sigma": (n,)}
    if s.armature:
        shapes |= {"armature": (s.nv,)}
    if s.uncertain:
        shapes |= {"position_covariance": (s.nv, s.nv), "velocity_covariance": (s.nv, s.nv)}
    columns, start = [], 0
    for name, shape in shapes.items():
        size = 1
        for extent in shape:
            size *= extent
        columns.append((name, start, shape))
        start += size
    return Layout(tuple(columns), start)
