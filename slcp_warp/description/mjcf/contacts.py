"""Shapes and contact pairs of a MuJoCo model, for `reader.py`."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..auto_contacts import AUTO, MOST_PAIRS, auto_contacts
from ..parts import Body, Contact, Shape
from .names import named
from .plane import FLAT, MjcfError, Place, Plane
from .refused import is_disabled

GEOMS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
BITS = 2**31 - 1  # of contype and conaffinity that ours have; whether they say the same is looked at
Places = Mapping[int, Place]


def read_contacts(
    m: Any,
    plane: Plane,
    place: Places,
    depth: dict[int, float],
    bodies: tuple[Body, ...],
    apart: Sequence[tuple[str, str]],
    corner_radius: float = 0.0,
) -> dict[str, Any]:
    """Fields of the scene: shapes that may touch, and the pairs of them that MuJoCo's filters leave; "auto",
    with MuJoCo's own numbers, where it says the same.

    Args:
        depth: of every body along the plane's normal. Geoms at different ones touch planes alone.
        apart: pairs of bodies that several joints tie to each other.
        corner_radius: of boxes [m].
    """
    at = [depth[b] + place[b].side * plane.depth(m.geom_pos[g]) for g, b in enumerate(m.geom_bodyid.tolist())]
    pairs = [pair for pair in _pairs(m, place) if not _never_touch(m, plane, place, at, pair[0], pair[1])]
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
    with_parents = is_disabled(m, "FILTERPARENT")
    excluded = tuple(dict.fromkeys(_excluded(m, place) + (() if with_parents else tuple(apart))))
    if contacts and auto_contacts(bodies, named, None, excluded) == tuple(contacts):
        return {"shapes": named, "contacts": AUTO, "excluded": excluded}
    return {"shapes": tuple(s for group in shapes.values() for s in group), "contacts": tuple(contacts)}


def _never_touch(m: Any, plane: Plane, place: Places, at: Sequence[float], a: int, b: int) -> bool:
    """Whether two geoms never touch: two planes, or a wall along the plane of motion and what is beside it.

    Args:
        at: where every geom is along the normal.
    """
    kinds = [_kind(m, geom) for geom in (a, b)]
    if kinds == ["plane", "plane"]:
        return True
    if kinds[1] == "plane":
        a, b = b, a
    along = _along(m, plane, place, a)[2]
    if "plane" not in kinds or abs(along) < 1.0 - FLAT:
        return False
    gap = along * (at[b] - at[a]) - _reach(m, b, np.abs(_along(m, plane, place, b)))
    if gap <= 0.0:
        raise MjcfError(
            f"geoms {_name(m, a)!r} and {_name(m, b)!r}: the first is a wall along the plane {plane.name}, "
            f"{abs(gap):g} m of the other are in it; only what is beside it is supported; exclude the pair"
        )
    return True


def _along(m: Any, plane: Plane, place: Places, geom: int) -> np.ndarray:
    """Components of a geom's axes along the normal, (3,)."""
    side = place[int(m.geom_bodyid[geom])].side
    return np.asarray(side * plane.normal @ plane.matrix(m.geom_quat[geom]))


def _reach(m: Any, geom: int, along: np.ndarray) -> float:
    """How far a geom reaches along the normal from its centre, by its axes' components there."""
    kind, size = _kind(m, geom), m.geom_size[geom]
    if kind in ("sphere", "capsule"):
        return float(size[0] + size[1] * along[2] * (kind == "capsule"))
    if kind == "ellipsoid":
        return float(np.linalg.norm(size * along))
    if kind == "box":
        return float(size @ along)
    return float(m.geom_rbound[geom])


def _excluded(m: Any, place: Places) -> tuple[tuple[str, str], ...]:
    """Our bodies of the pairs that are excluded; welded ones stand for what holds them."""
    ends = [divmod(int(signature), 1 << 16) for signature in m.exclude_signature]
    names = [(place[a].holder, place[b].holder) for a, b in ends]
    return tuple((a, b) for a, b in names if a is not None and b is not None and a != b)


def _kind(m: Any, geom: int) -> str:
    return GEOMS[int(m.geom_type[geom])]


def _name(m: Any, geom: int) -> str:
    return named(m, "geom", geom)


def _pairs(m: Any, place: Places) -> list[tuple[int, int, float | None]]:
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
    names = {name: i for i, name in enumerate({place[b].holder for b in range(m.nbody)})}
    body = np.asarray(m.geom_bodyid, np.int64)
    holder = np.array([names[place[b].holder] for b in range(m.nbody)])[body]
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


def _shapes(m: Any, plane: Plane, place: Places, geom: int, corner_radius: float) -> list[Shape]:
    kind, name = _kind(m, geom), _name(m, geom)
    label = f"geom {name!r}"
    at = place[int(m.geom_bodyid[geom])]
    axes = plane.matrix(m.geom_quat[geom])
    size = [float(x) for x in m.geom_size[geom]]
    centre = at.point(plane.point(m.geom_pos[geom]))
    offset = (float(centre[0]), float(centre[1]))

    def angle(axis: int) -> float:
        x, y = at.axes @ plane.vector(axes[:, axis], label)
        return math.atan2(y, x)

    def normal_axis() -> int:
        along = np.abs(plane.normal @ axes)
        if abs(along.max() - 1.0) > FLAT:
            raise MjcfError(f"{label}: a {kind} must have an axis normal to the plane {plane.name}")
        return int(along.argmax())

    if kind == "plane":
        return [Shape(name, at.holder, "halfplane", offset=offset, angle=angle(2))]
    if kind == "sphere":
        return [Shape(name, at.holder, "disc", size[0], offset)]
    if kind in ("capsule", "cylinder") and abs(float(plane.normal @ axes[:, 2])) > 1.0 - FLAT:
        return [Shape(name, at.holder, "disc", size[0], offset)]
    if kind == "capsule":
        return [Shape(name, at.holder, "capsule", (size[0], size[1]), offset, angle(2))]
    if kind == "ellipsoid":
        first, second = (axis for axis in range(3) if axis != normal_axis())
        return [Shape(name, at.holder, "ellipse", (size[first], size[second]), offset, angle(first))]
    if kind == "box":
        first, second = (axis for axis in range(3) if axis != normal_axis())
        if corner_radius > min(size[first], size[second]):
            raise MjcfError(f"{label}: corner_radius is {corner_radius}; at most half of its shorter side is "
                            f"needed, {min(size[first], size[second])}")  # fmt: skip
        half = (size[first], size[second])
        return [Shape(name, at.holder, "rectangle", half, offset, angle(first), corner_radius=corner_radius)]
    raise MjcfError(f"{label}: a {kind} is not supported; use sphere, capsule, ellipsoid, box or plane")
