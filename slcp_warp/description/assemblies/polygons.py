"""Polygons: outlines of discs and capsules, and what a plate of such an outline weighs."""

from typing import Any

import numpy as np

from ...inputs.checks import array, flag, number, shown
from ...inputs.errors import SceneError
from ..parts import Pair2, Shape

STRAIGHT = 1e-9  # sine of the turn at a vertex that is none
ENOUGH = 1e-6  # of a radius, by which rounding brings an inner outline nearer
LEAST = 1e-30  # m: what is smaller, or as much larger, has areas without digits
CORE = 0.75  # of the largest circle inside, what the disc in the middle has: what is that deep is inside
FINE = 1e-3  # of a polygon's size, to which that circle's centre is looked for
CELLS = 12  # a side of the first grid in which it is


def polygon(
    name: str, body: str | None, vertices: Any, corner_radius: float, core: bool = True
) -> tuple[Shape, ...]:
    """Shapes that keep others out of a polygon, convex or not: a disc at every corner that juts out, a
    capsule along every side, within the outline, and a disc in the middle. For `contacts="auto"`.

    Discs, capsules, rectangles and corners of others touch the sides, half-planes (with `contype=0`) the
    corners alone; of two polygons, or a polygon and a `box(sides=True)`, corners of one touch sides of the
    other. Where a side's end meets what a corner touches as well, both of them press in one place.

    Between sides and middle a polygon is hollow: what is small and fast, or put there at the start, may be
    inside and is held in. The disc in the middle, of three quarters of the largest circle that fits, makes
    that seen: what is so deep overlaps it, which gaps have and sweeps warn of. `core=False` leaves it out.

    Corners are called NAME0, NAME1, .. by their vertex, sides NAME0_1, NAME1_2, .., the disc NAME_core.

    Args:
        name: of the shapes, see above.
        body: that they are on; None: the world.
        vertices: (n, 2) in the body's frame, one after the other in either direction [m]; the outline crosses
            itself nowhere.
        corner_radius: > 0, of corners that jut out [m]. Thinner sides are passed more easily.
        core: whether there is the disc in the middle.

    Raises:
        SceneError: an outline that is none, or a radius for which a side is too short.
    """
    if not isinstance(name, str) or not name:
        raise SceneError(f"name is {shown(name)}; a name is needed")
    corners, order = _outline(vertices)
    number("corner_radius", corner_radius, 0.0, above=True, error=SceneError)
    count, inner, turn = len(corners), *_inset(corners, corner_radius, order)
    only: dict[str, Any] = {"contype": 1, "conaffinity": 0}  # touch what is touched, and never each other
    out = [
        Shape(f"{name}{order[i]}", body, "disc", corner_radius, _pair(inner[i]), **only)
        for i in range(count)
        if turn[i] > STRAIGHT
    ]
    for i in range(count):
        j = (i + 1) % count
        one, two = sorted((order[i], order[j]))
        if (one, two) == (0, count - 1):  # the side that closes the outline
            one, two = two, one
        along = inner[j] - inner[i]
        size = (corner_radius, 0.5 * float(np.hypot(*along)))
        middle, angle = _pair(0.5 * (inner[i] + inner[j])), float(np.arctan2(along[1], along[0]))
        side = f"{name}{one}_{two}"
        out.append(Shape(side, body, "capsule", size, middle, angle, contype=0, conaffinity=1))
    if flag("core", core):
        centre, radius = _largest_circle(corners)
        out.append(Shape(f"{name}_core", body, "disc", CORE * radius, _pair(centre)))
    return tuple(out)


def polygon_mass(vertices: Any, density: float) -> tuple[float, float, Pair2]:
    """Mass [kg], inertia about the centre of mass [kg m^2] and that centre [m] of a plate, as a `Body` takes
    them: `slcp.Body("part", mass, inertia, com=com, joint="free")`.

    Args:
        vertices: (n, 2) as of `polygon` [m].
        density: > 0, of the plate [kg/m^2]: that of its material times its depth.

    Raises:
        SceneError: an outline that is none.
    """
    number("density", density, 0.0, above=True, error=SceneError)
    corners = _outline(vertices)[0]
    origin = corners.mean(axis=0)
    a, b = corners - origin, np.roll(corners, -1, axis=0) - origin
    twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]  # area of the triangle with the origin, signed
    area = 0.5 * twice.sum()
    centre = ((a + b) * twice[:, None]).sum(axis=0) / (6.0 * area)
    about = (twice * np.sum(a * a + a * b + b * b, axis=1)).sum() / 12.0  # polar, about the origin
    inertia = density * (about - area * float(centre @ centre))
    return float(density * area), float(inertia), _pair(origin + centre)


def _pair(point: np.ndarray) -> Pair2:
    return float(point[0]), float(point[1])


def _outline(vertices: Any) -> tuple[np.ndarray, list[int]]:
    """The vertices counter-clockwise, and which of those that were given each is."""
    found = array("vertices", vertices, error=SceneError)
    largest = float(np.abs(found).max(initial=0.0))
    if found.size and not LEAST < largest < 1.0 / LEAST:
        raise SceneError(f"vertices has numbers of up to {largest:g} m; between {LEAST:g} and "
                         f"{1.0 / LEAST:g} is needed")  # fmt: skip
    if found.ndim != 2 or found.shape[1] != 2 or len(found) < 3:
        raise SceneError(f"vertices has shape {found.shape}; (n, 2) with at least 3 of them is needed")
    order = list(range(len(found)))
    a, b = found, np.roll(found, -1, axis=0)
    same = np.flatnonzero((a == b).all(axis=1))
    if len(same):
        i = int(same[0])
        raise SceneError(f"vertices[{i}] and vertices[{(i + 1) % len(a)}] are one point; a side needs two "
                         "(the last leads to the first by itself)")  # fmt: skip
    if (crossing := _crossing(a, b)) is not None:
        one, two = crossing
        raise SceneError(f"vertices: the sides from vertices[{one}] and from vertices[{two}] meet; "
                         "an outline that does not cross or touch itself is needed")  # fmt: skip
    area = np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    if area < 0.0:
        found, order = found[::-1], order[::-1]
    return found, order


def _left_of(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
    """Positive where r is to the left of the way from p to q."""
    return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))


def _crossing(a: np.ndarray, b: np.ndarray) -> tuple[int, int] | None:
    """The first two sides, from a[i] to b[i], that meet other than at their common vertex; None: none do."""
    count, side = len(a), _left_of

    def within(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> bool:
        return side(p, q, r) == 0.0 and float((r - p) @ (r - q)) <= 0.0

    for i in range(count):
        for j in range(i + 1, count):
            if j == i + 1 or (i == 0 and j == count - 1):  # neighbours: one may turn back on the other
                one, other = (a[i], b[j]) if j == i + 1 else (b[i], a[j])
                middle = b[i] if j == i + 1 else a[i]
                if side(one, middle, other) == 0.0 and float((one - middle) @ (other - middle)) > 0.0:
                    return i, j
                continue
            apart = side(a[i], b[i], a[j]) * side(a[i], b[i], b[j])
            across = side(a[j], b[j], a[i]) * side(a[j], b[j], b[i])
            ends = (a[i], b[i], a[j]), (a[i], b[i], b[j]), (a[j], b[j], a[i]), (a[j], b[j], b[i])
            if (apart < 0.0 and across < 0.0) or any(within(*each) for each in ends):
                return i, j
    return None


def _inset(corners: np.ndarray, radius: float, order: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """The vertices of the outline moved inwards by a radius, and the sine of the turn at each, positive where
    it juts out.
    """
    ahead = np.roll(corners, -1, axis=0) - corners
    ahead /= np.hypot(*ahead.T)[:, None]
    before = np.roll(ahead, 1, axis=0)
    turn = before[:, 0] * ahead[:, 1] - before[:, 1] * ahead[:, 0]
    inward = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    both = inward + np.roll(inward, 1, axis=0)
    inner = corners + radius * both / (0.5 * np.sum(both**2, axis=1))[:, None]
    left = np.sum((np.roll(inner, -1, axis=0) - inner) * ahead, axis=1)
    if not (left > 0.0).all():
        i = int(np.argmin(left))
        one, two = order[i], order[(i + 1) % len(order)]
        raise SceneError(f"corner_radius is {radius}; the side between vertices[{one}] and vertices[{two}] "
                         "is too short for it")  # fmt: skip
    if (narrow := _narrow(inner, corners, radius)) is not None:
        raise SceneError(f"corner_radius is {radius}; the outline is too narrow for it beside vertices"
                         f"[{order[narrow]}] and vertices[{order[(narrow + 1) % len(order)]}]")  # fmt: skip
    return inner, turn


def _narrow(inner: np.ndarray, corners: np.ndarray, radius: float) -> int | None:
    """The first side of an inner outline that comes nearer than a radius to the outer one, or leaves it;
    None: none does.
    """
    most = radius * (1.0 - ENOUGH)
    outer = np.roll(corners, -1, axis=0)
    for i, (one, two) in enumerate(zip(inner, np.roll(inner, -1, axis=0), strict=True)):
        ends = _depth(np.stack([one, two]), corners)
        along = two - one
        share = np.clip((corners - one) @ along / (along @ along), 0.0, 1.0)
        away = np.hypot(*(corners - one - share[:, None] * along).T)
        left = np.array([_left_of(one, two, corner) for corner in corners])
        cross = (left * np.roll(left, -1) < 0.0) & np.array(
            [_left_of(a, b, one) * _left_of(a, b, two) < 0.0 for a, b in zip(corners, outer, strict=True)]
        )
        if ends.min() < most or away.min() < most or cross.any():
            return i
    return None


def _depth(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """How deep points (m, 2) are inside of an outline, negative outside."""
    a, b = corners[:, None], np.roll(corners, -1, axis=0)[:, None]
    along = b - a
    share = np.clip(np.sum((points - a) * along, axis=2) / np.sum(along**2, axis=2), 0.0, 1.0)
    away = np.linalg.norm(points - a - share[..., None] * along, axis=2).min(axis=0)
    level = (a[..., 1] > points[:, 1]) != (b[..., 1] > points[:, 1])
    rise = np.where(level, along[..., 1], 1.0)
    left = points[:, 0] < a[..., 0] + (points[:, 1] - a[..., 1]) / rise * along[..., 0]
    inside = np.count_nonzero(level & left, axis=0) % 2 == 1
    return np.where(inside, away, -away)


def _largest_circle(corners: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the largest circle inside, by cells that are cut as long as it may be in them."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = 0.5 * float((high - low).max()) / CELLS
    steps = [np.arange(a + half, b + half, 2.0 * half) for a, b in zip(low, high)]
    points = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
    best, centre = -np.inf, points[0]
    end = FINE * float((high - low).max())
    while half > 0.5 * end and len(points):
        depth = _depth(points, corners)
        if depth.max() > best:
            best, centre = float(depth.max()), points[depth.argmax()]
        points = points[depth + half * np.sqrt(2.0) > best]
        half *= 0.5
        quarters = half * np.array([(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)])
        points = (points[:, None] + quarters).reshape(-1, 2)
    return centre, best
