"""What an adjoint step keeps of a world beside the workspace of its solution, in global memory."""

from typing import Any

import warp as wp

from ...factories import cached
from ...generic import topology
from ...generic.derivatives import tables
from ...generic.derivatives.tables import Slopes
from ...generic.work import V3, WORK
from ...structure import DISC, Structure, layout

DUAL, OLD, NEW, ROW = 0, 1, 2, 3  # joint rates: P, v, v', and M^-1 J_i' of one row


@wp.struct
class Room:
    """Numbers of every world that has a slot, (slots, items); a world works on views of its own."""

    q: wp.array2d(dtype=WORK)  # (nv) by dof, before the step
    rates: wp.array2d(dtype=WORK)  # (4 nv) by dof, DUAL to ROW
    twist: wp.array2d(dtype=wp.vec3d)  # (4 nb) rate of turning and velocity of a body's origin under each
    acceleration: wp.array2d(dtype=wp.vec2d)  # (nb) of a body's origin at constant rates v
    by_twist: wp.array2d(dtype=wp.vec3d)  # slopes of the scalar by these
    by_acceleration: wp.array2d(dtype=wp.vec2d)
    by_frame: wp.array2d(dtype=wp.vec3d)  # (nb) by a body's origin and angle
    by_arm: wp.array2d(dtype=wp.vec2d)  # (nb) by the way from the parent's origin to the body's
    by_q: wp.array2d(dtype=WORK)  # (nv)
    by_v: wp.array2d(dtype=WORK)
    by_lead: wp.array2d(dtype=WORK)  # (nv) by what the leapfrog predicts, this and the next of it alone
    held: wp.array2d(dtype=WORK)  # (3 nv) slopes of its whole step by q and v, and P
    weight: wp.array2d(dtype=WORK)  # (2 nv) of the state after the step
    target: wp.array2d(dtype=V3)  # (blocks) of v'
    p: wp.array2d(dtype=V3)  # (blocks) -P
    y: wp.array2d(dtype=WORK)  # (nr) this and what follows by row
    rho: wp.array2d(dtype=WORK)  # (nr) weight of J_i v' + d/h
    slides: wp.array2d(dtype=wp.int32)  # (nr) 1: rho weighs J_n instead of J_i (Coulomb's friction)
    grad: wp.array2d(dtype=WORK)  # (width) by every column of the parameter table
    factor: Slopes  # of these `FACTOR` only
    disc: wp.array(dtype=wp.int32)  # (shapes) of all worlds; 1: its radius is the first of the two


KINDS = {"twist": wp.vec3d, "by_twist": wp.vec3d, "by_frame": wp.vec3d, "slides": wp.int32} | dict.fromkeys(
    ("acceleration", "by_acceleration", "by_arm"), wp.vec2d
)
KINDS |= {"target": V3, "p": V3}
FACTOR = ("upper", "row", "share", "yielding", "slides", "of_contact", "gap_by_q", "before", "bounced")


@cached
def of_factor(s: Structure) -> dict[str, tuple[int, Any]]:
    """Items of its arrays, and what they are; of one pair where one at a time is looked at."""
    sizes, most = tables.lengths(s), tables.widths(s)[1]
    out = {name: sizes[name] for name in FACTOR}
    return out | {name: (most, sizes[name][1]) for name in ("of_contact", "gap_by_q")}


@cached
def lengths(s: Structure) -> dict[str, int]:
    """Items of every array of a structure."""
    by_body = {"twist": 4 * s.nb, "by_twist": 4 * s.nb}
    by_body |= dict.fromkeys(("acceleration", "by_acceleration", "by_frame", "by_arm"), s.nb)
    by_dof = {"rates": 4 * s.nv, "weight": 2 * s.nv, "held": 3 * s.nv}
    by_dof |= dict.fromkeys(("q", "by_q", "by_v", "by_lead"), s.nv)
    by_dof |= dict.fromkeys(("target", "p"), topology.tables(s)[1].blocks)
    return by_body | by_dof | dict.fromkeys(("y", "rho", "slides"), s.nr) | {"grad": layout(s).width}


def allocate_room(s: Structure, slots: int, device: Any) -> Room:
    """Room for `slots` worlds: neighbours in memory are items on a CPU, worlds on a GPU."""
    out = Room()

    def room(length: int, kind: Any) -> Any:
        if wp.get_device(device).is_cpu:
            return wp.zeros((slots, length), dtype=kind, device=device)
        return wp.zeros((length, slots), dtype=kind, device=device).transpose()

    for name, length in lengths(s).items():
        setattr(out, name, room(length, KINDS.get(name, WORK)))
    for name, items in of_factor(s).items():
        setattr(out.factor, name, room(*items))
    discs = [int(shape.kind == DISC) for shape in s.shapes]
    out.disc = wp.array(discs, dtype=wp.int32, device=device)
    return out


def bytes_per_world(s: Structure) -> int:
    """Memory of one slot."""
    kinds = [(length, KINDS.get(name, WORK)) for name, length in lengths(s).items()]
    kinds += of_factor(s).values()
    return sum(length * wp.types.type_size_in_bytes(kind) for length, kind in kinds)


def with_factor(given: Room, factor: Slopes) -> Room:
    """The same room with workspaces of the first-order expansion, of which it has only some itself."""
    out = Room()
    for name in Room.cls.__annotations__:
        setattr(out, name, factor if name == "factor" else getattr(given, name))
    return out


@wp.struct
class View:
    """One world's part of a `Room`."""

    q: wp.array(dtype=WORK)
    rates: wp.array(dtype=WORK)
    twist: wp.array(dtype=wp.vec3d)
    acceleration: wp.array(dtype=wp.vec2d)
    by_twist: wp.array(dtype=wp.vec3d)
    by_acceleration: wp.array(dtype=wp.vec2d)
    by_frame: wp.array(dtype=wp.vec3d)
    by_arm: wp.array(dtype=wp.vec2d)
    by_q: wp.array(dtype=WORK)
    by_v: wp.array(dtype=WORK)
    by_lead: wp.array(dtype=WORK)
    held: wp.array(dtype=WORK)
    weight: wp.array(dtype=WORK)
    target: wp.array(dtype=V3)
    p: wp.array(dtype=V3)
    y: wp.array(dtype=WORK)
    rho: wp.array(dtype=WORK)
    slides: wp.array(dtype=wp.int32)
    grad: wp.array(dtype=WORK)


@wp.func
def view_of(room: wp.ref[Room], b: int):
    """The part of the world in slot b."""
    out = View()
    out.q = room.q[b]
    out.rates = room.rates[b]
    out.twist = room.twist[b]
    out.acceleration = room.acceleration[b]
    out.by_twist = room.by_twist[b]
    out.by_acceleration = room.by_acceleration[b]
    out.by_frame = room.by_frame[b]
    out.by_arm = room.by_arm[b]
    out.by_q = room.by_q[b]
    out.by_v = room.by_v[b]
    out.by_lead = room.by_lead[b]
    out.held = room.held[b]
    out.weight = room.weight[b]
    out.target = room.target[b]
    out.p = room.p[b]
    out.y = room.y[b]
    out.rho = room.rho[b]
    out.slides = room.slides[b]
    out.grad = room.grad[b]
    return out
