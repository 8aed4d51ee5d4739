"""Shapes and contact pairs of a MuJoCo model, for `reader.py`."""

import dataclasses
import math
from typing import Any

import numpy as np

from ..auto_contacts import AUTO, MOST_PAIRS, auto_contacts
from ..parts import Body, Contact, Shape
from .plane import FLAT, MjcfError, Plane, named
from .refused import is_disabled

GEOMS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
BITS = 2**31 - 1  # of contype and conaffinity that ours have; whether they say the same is looked at
Place = dict[int, tuple[str | None, float, np.ndarray]]


def read_contacts(
    m: Any,
    plane: Plane,
    place: Place,
    depth: dict[int, float],
    bodies: tuple[Body, ...],
    corner_radius: float = 0.0,
) -> dict[str, Any]:
    """Fields of the scene: shapes that may touch, and the pairs of them that MuJoCo's filters leave; "auto",
    with MuJoCo's own numbers, where it says the same.

    Args:
        depth: of every body along the plane's normal. Geoms at different ones touch planes alone.
        corner_radius: of boxes [m].
    """
    pairs = _pairs(m, place)
    at = [depth[int(m.geom_bodyid[g])] + plane.depth(m.geom_pos[g]) for g in range(m.ngeom)]
    shapes: dict[int, list[Shape]] = {}
    for geom in sorted({g for a, b, _ in pairs for g in (a, b)}):
        shapes[geom] = _shapes(m, plane, place, geom, corner_radius)
    contacts = []
    for a, b, friction in pairs:
        kinds = {_kind(m, a), _kind(m, b)}
        if kinds == {"box"} and not corner_radius:
            raise MjcfError(
                f"geoms {_name(m, a)!r} and {_name(m, b)!r}: two boxes touch each other with rounded corners "
                "only; exclude the pair, or give load_mjcf a corner_radius > 0"
            )
        if "plane" not in kinds and abs(at[a] - at[b]) > FLAT:
            raise MjcfError(
                f"geoms {_name(m, a)!r} and {_name(m, b)!r} are {abs(at[a] - at[b]):g} m apart along the "
                f"normal of the plane {plane.name}, where they do not touch as in it; exclude the pair"
            )
        contacts += [Contact(x.name, y.name, friction) for x in shapes[a] for y in shapes[b]]
    bits: dict[Any, dict[str, Any]] = {
        g: {"contype": int(m.geom_contype[g]) & BITS, "conaffinity": int(m.geom_conaffinity[g]) & BITS,
            "friction": float(m.geom_friction[g, 0]) if m.geom_condim[g] > 1 else None}
        for g in shapes
    }  # fmt: skip
    named = tuple(dataclasses.replace(s, **bits[g]) for g, group in shapes.items() for s in group)
    excluded = _excluded(m, place)
    if contacts and auto_contacts(bodies, named, None, excluded) == tuple(contacts):
        return {"shapes": named, "contacts": AUTO, "excluded": excluded}
    return {"shapes": tuple(s for group in shapes.values() for s in group), "contacts": tuple(contacts)}


def _excluded(m: Any, place: Place) -> tuple[tuple[str, str], ...]:
    """Our bodies of the pairs that are excluded; welded ones stand for what holds them."""
    ends = [divmod(int(signature), 1 << 16) for signature in m.exclude_signature]
    names = [(place[a][0], place[b][0]) for a, b in ends]
    return tuple((a, b) for a, b in names if a is not None and b is not None and a != b)


def _kind(m: Any, geom: int) -> str:
    return GEOMS[int(m.geom_type[geom])]


def _name(m: Any, geom: int) -> str:
    return named(m, "geom", geom)


def _pairs(m: Any, place: Place) -> list[tuple[int, int, float | None]]:
    """(geom, geom, friction or None) by MuJoCo's rules: flags, bits, parents, excludes, explicit pairs."""
    if is_disabled(m, "CONTACT") or is_disabled(m, "CONSTRAINT"):
        return []
    with_parents = is_disabled(m, "FILTERPARENT")
    out = []
    for i in range(m.npair):
        a, b, sliding = int(m.pair_geom1[i]), int(m.pair_geom2[i]), m.pair_friction[i, :2]
        if m.pair_dim[i] > 1 and sliding[0] != sliding[1]:
            raise MjcfError(
                f"pair of geoms {_name(m, a)!r} and {_name(m, b)!r}: its coefficients of sliding are "
                f"{sliding.tolist()}; one in all directions is supported"
            )
        out.append((a, b, float(sliding[0]) if m.pair_dim[i] > 1 else None))
    explicit = {frozenset(p[:2]) for p in out}
    names = {name: i for i, name in enumerate({place[b][0] for b in range(m.nbody)})}
    body = np.asarray(m.geom_bodyid, np.int64)
    holder = np.array([names[place[b][0]] for b in range(m.nbody)])[body]
    weld = np.asarray(m.body_weldid)[body]
    above = np.asarray(m.body_weldid)[np.asarray(m.body_parentid)[weld]]
    for a in range(m.ngeom):
        rest = slice(a + 1, None)
        bits = (m.geom_contype[a] & m.geom_conaffinity[rest]) | (m.geom_contype[rest] & m.geom_conaffinity[a])
        related = ((weld[a] == above[rest]) & (weld[a] != 0)) | ((weld[rest] == above[a]) & (weld[rest] != 0))
        related &= not with_parents
        signature = ((body[a] << 16) + body[rest], (body[rest] << 16) + body[a])
        excluded = np.isin(signature, m.exclude_signature).any(axis=0)
        touching = (bits != 0) & (holder[a] != holder[rest]) & ~related & ~excluded
        for b in (a + 1 + np.flatnonzero(touching)).tolist():
            if frozenset((a, b)) not in explicit:
                out.append((a, b, _friction(m, a, b)))
        if len(out) > MOST_PAIRS:
            raise MjcfError(f"more than {MOST_PAIRS:,} pairs of geoms may touch; exclude some")
    return out


def _friction(m: Any, a: int, b: int) -> float | None:
    """Friction of two geoms: of the one with priority, or the larger of both; None: frictionless."""
    if m.geom_priority[a] != m.geom_priority[b]:
        leader = a if m.geom_priority[a] > m.geom_priority[b] else b
        dim, mu = m.geom_condim[leader], m.geom_friction[leader, 0]
    else:
        dim = max(m.geom_condim[a], m.geom_condim[b])
        mu = max(m.geom_friction[a, 0], m.geom_friction[b, 0])
    return float(mu) if dim > 1 else None


def _shapes(m: Any, plane: Plane, place: Place, geom: int, corner_radius: float) -> list[Shape]:
    kind, name = _kind(m, geom), _name(m, geom)
    label = f"geom {name!r}"
    holder, turn, origin = place[int(m.geom_bodyid[geom])]
    axes = plane.matrix(m.geom_quat[geom])
    size = [float(x) for x in m.geom_size[geom]]
    local = plane.point(m.geom_pos[geom])
    c, s = math.cos(turn), math.sin(turn)
    centre = origin + np.array([c * local[0] - s * local[1], s * local[0] + c * local[1]])
    offset = (float(centre[0]), float(centre[1]))

    def angle(axis: int) -> float:
        x, y = plane.vector(axes[:, axis], label)
        return math.atan2(y, x) + turn

    def normal_axis() -> int:
        along = np.abs(plane.normal @ axes)
        if abs(along.max() - 1.0) > FLAT:
            raise MjcfError(f"{label}: a {kind} must have an axis normal to the plane {plane.name}")
        return int(along.argmax())

    if kind == "plane":
        return [Shape(name, holder, "halfplane", offset=offset, angle=angle(2))]
    if kind == "sphere":
        return [Shape(name, holder, "disc", size[0], offset)]
    if kind in ("capsule", "cylinder") and abs(float(plane.normal @ axes[:, 2])) > 1.0 - FLAT:
        return [Shape(name, holder, "disc", size[0], offset)]
    if kind == "capsule":
        return [Shape(name, holder, "capsule", (size[0], size[1]), offset, angle(2))]
    if kind == "ellipsoid":
        first, second = (axis for axis in range(3) if axis != normal_axis())
        return [Shape(name, holder, "ellipse", (size[first], size[second]), offset, angle(first))]
    if kind == "box":
        first, second = (axis for axis in range(3) if axis != normal_axis())
        if corner_radius > min(size[first], size[second]):
            raise MjcfError(f"{label}: corner_radius is {corner_radius}; at most half of its shorter side is "
                            f"needed, {min(size[first], size[second])}")  # fmt: skip
        half = (size[first], size[second])
        return [Shape(name, holder, "rectangle", half, offset, angle(first), corner_radius=corner_radius)]
    raise MjcfError(f"{label}: a {kind} is not supported; use sphere, capsule, ellipsoid, box or plane")
