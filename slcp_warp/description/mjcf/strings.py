"""Spatial tendons of a MuJoCo model that go straight from one site to another, for `reader.py`.

Their spring and damper are a `Spring`, the upper end of their range a rope, the lower one two discs that keep
the sites apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..assemblies.ropes import rope
from ..parts import Contact, Shape, Spring
from .names import Names, named
from .plane import FLAT, MjcfError, Place, Plane
from .refused import HINT

SAME = 1e-12  # lengths of a spring that are one [m]


@dataclass
class Strings:
    """What straight tendons are here."""

    springs: list[Spring] = field(default_factory=list)
    shapes: list[Shape] = field(default_factory=list)
    contacts: list[Contact] = field(default_factory=list)


def is_straight(m: Any, i: int) -> bool:
    """Whether tendon i goes from one site to another, over nothing."""
    import mujoco

    first = int(m.tendon_adr[i])
    kinds = m.wrap_type[first : first + int(m.tendon_num[i])]
    return len(kinds) == 2 and bool((kinds == mujoco.mjtWrap.mjWRAP_SITE).all())


def read_strings(m: Any, plane: Plane, place: Mapping[int, Place], names: Names) -> Strings:
    """The straight tendons of the model.

    Raises:
        MjcfError: sites that are apart along the plane's normal, or a spring that is slack.
    """
    import mujoco

    data = mujoco.MjData(m)
    mujoco.mj_kinematics(m, data)
    out = Strings()
    for i in (i for i in range(m.ntendon) if is_straight(m, i)):
        label = f"tendon {named(m, 'tendon', i)!r}"
        sites = [int(m.wrap_objid[int(m.tendon_adr[i]) + end]) for end in range(2)]
        beside = abs(plane.depth(data.site_xpos[sites[1]] - data.site_xpos[sites[0]]))
        if beside > FLAT:
            raise MjcfError(f"{label}: its sites are {beside:g} m apart along the normal of the plane "
                            f"{plane.name}; none is supported{HINT}")  # fmt: skip
        (one, at), (other, its) = (_end(m, plane, place, site) for site in sites)
        if one == other:
            continue  # of one length for ever
        stiffness, damping = float(m.tendon_stiffness[i]), float(m.tendon_damping[i])
        if stiffness or damping:
            length = _length(m, i, label) if stiffness else 0.0
            out.springs.append(Spring(one, other, at, its, stiffness, damping, length))
        if m.tendon_limited[i]:
            least, most = (float(x) for x in m.tendon_range[i])
            _limit(out, names.shape("tendon", i), (one, other), (at, its), least, most)
    return out


def _end(
    m: Any, plane: Plane, place: Mapping[int, Place], site: int
) -> tuple[str | None, tuple[float, float]]:
    """The body here that holds a site, and its place there."""
    held = place[int(m.site_bodyid[site])]
    x, y = held.point(plane.point(m.site_pos[site]))
    return held.holder, (float(x), float(y))


def _length(m: Any, i: int, label: str) -> float:
    low, high = (float(x) for x in m.tendon_lengthspring[i])
    if not np.isclose(low, high, rtol=0.0, atol=SAME):
        raise MjcfError(f"{label}: its spring is slack from {low:g} to {high:g}; one length is supported")
    return low


def _limit(
    out: Strings,
    name: str,
    bodies: tuple[str | None, str | None],
    points: tuple[tuple[float, float], tuple[float, float]],
    least: float,
    most: float,
) -> None:
    """Add what keeps two points at a distance between `least` and `most`."""
    ends, contact = rope(name, *bodies, most, *points)
    out.shapes += ends
    out.contacts.append(contact)
    if least > 0.0:
        discs = [
            Shape(f"{name}_{side}", body, "disc", least / 2.0, point)
            for side, body, point in zip(("from", "to"), bodies, points, strict=True)
        ]
        out.shapes += discs
        out.contacts.append(Contact(discs[0].name, discs[1].name))
