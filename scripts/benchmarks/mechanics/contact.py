"""The oracle's contacts: signed distances by search all round, touched points, and their Jacobians.

d = max over unit n of n.(c_B - c_A) - h_A(n) - h_B(-n), h the support function. Between discs, capsules and
half-planes the maximiser is elementary; with an ellipse it is sought in DIRECTIONS all round, the best peaks
are bisected, and the largest is taken. Where two differ by less than a rounding either may be the normal.
What is in a ring is as far from it as its radius is longer than the way to the far side of a disc.
"""

from dataclasses import dataclass

import numpy as np

from slcp_warp.description.kinematics import Array, across, turn
from slcp_warp.kernels.structure import PairStructure

from .aside import Block, leave
from .tree import Frame, Mechanics

DIRECTIONS, PEAKS, HALVINGS = 192, 3, 46
SIDED = ("capsule", "rectangle")
CORNERS = {2: (-1.0, -1.0), 3: (1.0, -1.0), 4: (1.0, 1.0), 5: (-1.0, 1.0)}
CHOICES = 4  # maxima of a distance that can be asked for
EQUAL = 1e-9  # maxima of a distance that differ by less are equal [m]


@dataclass(frozen=True)
class Touches:
    """All pairs of all worlds, (B, pairs): signed distance; rows J_n, J_t (B, pairs, nv); `size`, the lengths
    that the distance is the sum of, from the root on; `extent`, those from the world's origin to the centres
    and on to the surfaces; `margin`, by how much its maximum beats the next one; `bend`, size over the radius
    by which the normal turns with the shapes.
    """

    gap: Array
    normal: Array
    tangent: Array
    size: Array
    extent: Array
    margin: Array
    bend: Array


@dataclass(frozen=True)
class Placed:
    """A shape of every world: kind, centre (B, 2), angle (B,), radii (B,), lengths of its pose (B,), and a
    rectangle's corner radius (B,), with half its sizes less that as radii.
    """

    kind: str
    body: int
    at: Array
    angle: Array
    a: Array
    b: Array
    reach: Array
    corner: Array

    def support(self, angle: Array) -> tuple[Array, Array, Array]:
        """h, h' and the radius of curvature h + h'' of a disc or ellipse at a direction (B, ...)."""
        wide = (slice(None),) + (None,) * (angle.ndim - 1)
        a, b = self.a[wide], self.b[wide]
        if self.kind == "disc":
            return a + 0.0 * angle, 0.0 * angle, a + 0.0 * angle
        c, s = np.cos(angle - self.angle[wide]), np.sin(angle - self.angle[wide])
        h = np.sqrt((a * c) ** 2 + (b * s) ** 2)
        return h, (b * b - a * a) * c * s / h, (a * b) ** 2 / h**3


def place(m: Mechanics, frames: list[Frame], shape: int, end: int) -> Placed:
    """A shape, or the disc at an end of a capsule or a corner of a rectangle."""
    kind, body = m.s.shapes[shape].kind, m.s.shapes[shape].body
    offset, angle = m.p["shape_offset"][:, shape], m.p["shape_angle"][:, shape]
    radius, half = m.p["radius"][:, shape, 0], m.p["radius"][:, shape, 1]
    corner = np.zeros(1)
    if kind == "rectangle":
        corner = m.p["corner_radius"][:, shape]
        radius, half = radius - corner, half - corner
        if end:
            sign = np.array(CORNERS[end])
            offset = offset + turn(angle, sign * np.stack([radius, half], -1))
            kind, radius, half = "disc", corner, corner
    elif end:
        offset = offset + end * half[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
        kind = "disc"
    elif kind in ("disc", "ring"):
        half = radius
    worlds = len(frames[0].at)
    if body < 0:
        at, reach = offset + np.zeros((worlds, 2)), np.abs(offset).sum(-1)
        angle = angle + np.zeros(worlds)
    else:
        frame = frames[body]
        at, angle = frame.at + turn(frame.angle, offset + 0.0 * frame.at), frame.angle + angle
        reach = frame.reach + np.abs(offset).sum(-1)
    flat = 0.0 * angle
    return Placed(kind, body, at, angle, radius + flat, half + flat, reach + flat, corner + flat)


def direction(angle: Array) -> Array:
    """Unit vectors (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def search(a: Placed, b: Placed, directions: int = DIRECTIONS, peaks: int = PEAKS) -> tuple[Array, Array]:
    """Angles (B, peaks) of the best normals between round shapes, best first, and their distances; minus
    infinity where there are no more maxima.
    """
    delta = b.at - a.at
    grid = np.broadcast_to(2 * np.pi * np.arange(directions) / directions, (len(delta), directions))

    def value(angle: Array) -> tuple[Array, Array]:
        ha, da, _ = a.support(angle)
        hb, db, _ = b.support(angle + np.pi)
        c, s = np.cos(angle), np.sin(angle)
        x, y = delta[:, :1], delta[:, 1:]
        return c * x + s * y - ha - hb, c * y - s * x - da - db

    tried = value(grid)[0]
    peak = (tried >= np.roll(tried, 1, -1)) & (tried > np.roll(tried, -1, -1))
    peak[~peak.any(-1), 0] = True  # concentric discs: all directions alike
    best = np.argpartition(np.where(peak, -tried, np.inf), peaks, -1)[:, :peaks]
    real = np.take_along_axis(peak, best, -1)
    middle = np.take_along_axis(grid, best, -1)
    lo, hi = middle - 2 * np.pi / directions, middle + 2 * np.pi / directions
    for _ in range(HALVINGS):
        mid = 0.5 * (lo + hi)
        rising = value(mid)[1] > 0.0
        lo, hi = np.where(rising, mid, lo), np.where(rising, hi, mid)
    angle = 0.5 * (lo + hi)
    tops = np.where(real, value(angle)[0], -np.inf)
    order = np.argsort(-tops, -1)
    return np.take_along_axis(angle, order, -1), np.take_along_axis(tops, order, -1)


def nearest(a: Placed, b: Placed) -> tuple[Array, Array]:
    """Unit normal (B, 2) and signed distance (B,) of a shape with sides or disc A and a disc B, or turned."""
    if a.kind == "rectangle":
        return _outside(a, b)
    if b.kind in SIDED:
        n, gap = nearest(b, a)
        return -n, gap
    half = a.b if a.kind == "capsule" else np.zeros(len(a.at))
    axis = direction(a.angle)
    along = np.clip(np.sum((b.at - a.at) * axis, -1), -half, half)
    delta = b.at - a.at - along[:, None] * axis
    length = np.linalg.norm(delta, axis=-1)
    safe = np.where(length > 0.0, length, 1.0)
    n = np.where(length[:, None] > 0.0, delta / safe[:, None], across(axis))
    return n, length - a.a - b.a


def _outside(a: Placed, b: Placed) -> tuple[Array, Array]:
    """As `nearest`, of a rectangle A: from the nearest point of its core, or through its nearest side."""
    local, half = turn(-a.angle, b.at - a.at), np.stack([a.a, a.b], -1)
    away = local - np.clip(local, -half, half)
    length = np.linalg.norm(away, axis=-1)
    depth = half - np.abs(local)
    sign = np.where(local < 0.0, -1.0, 1.0)
    side = np.where((depth[:, :1] < depth[:, 1:]), sign * [1.0, 0.0], sign * [0.0, 1.0])
    out = length > 0.0
    n = np.where(out[:, None], away / np.where(out, length, 1.0)[:, None], side)
    return turn(a.angle, n), np.where(out, length, -depth.min(-1)) - a.corner - b.a


def _around(ring: Placed, disc: Placed) -> tuple[Array, Array, Array, Array]:
    """Unit normal from a ring to a disc in it, distance, and the points where they are nearest."""
    out = disc.at - ring.at
    length = np.linalg.norm(out, axis=-1)
    away = np.where(length[:, None] > 0.0, out / np.where(length > 0.0, length, 1.0)[:, None], [-1.0, 0.0])
    return -away, ring.a - length - disc.a, ring.at + ring.a[:, None] * away, disc.at + disc.a[:, None] * away


def touch(a: Placed, b: Placed, directions: int = DIRECTIONS, choice: int = 0) -> tuple[Array, ...]:
    """Of a pair: normal (B, 2), gap, points on A and B (B, 2), margin of the maximum, radius of turning.

    `choice`: which of several maxima is taken, where that many differ by less than EQUAL; else the best.
    """
    infinite = np.full(len(a.at), np.inf)
    if "halfplane" in (a.kind, b.kind):
        plane, body, side = (a, b, 1.0) if a.kind == "halfplane" else (b, a, -1.0)
        out = direction(plane.angle)  # outwards of the half-plane
        h, slope, _ = body.support(plane.angle + np.pi)
        point = body.at - h[:, None] * out - slope[:, None] * across(out)
        gap = np.sum(out * (point - plane.at), -1)
        foot = point - gap[:, None] * out
        pa, pb = (foot, point) if side > 0.0 else (point, foot)
        return side * out, gap, pa, pb, infinite, infinite
    if "ring" in (a.kind, b.kind):
        radius = np.linalg.norm(b.at - a.at, axis=-1)
        if a.kind == "ring":
            return *_around(a, b), infinite, radius
        n, gap, outer, inner = _around(b, a)
        return -n, gap, inner, outer, infinite, radius
    if "ellipse" not in (a.kind, b.kind):
        n, gap = nearest(a, b)
        first, second = (side.corner if side.kind == "rectangle" else side.a for side in (a, b))
        radius = gap + first + second  # 0 where the centres are in one place
        if not {a.kind, b.kind} & set(SIDED):
            return n, gap, a.at + a.a[:, None] * n, b.at - b.a[:, None] * n, infinite, radius
        disc, at = (b, b.at - b.a[:, None] * n) if a.kind in SIDED else (a, a.at + a.a[:, None] * n)
        shift = gap[:, None] * n
        return (n, gap, at - shift, at, infinite, radius) if disc is b else (
            n, gap, at, at + shift, infinite, radius)  # fmt: skip
    angles, tops = search(a, b, directions, max(PEAKS, choice + 1))
    margin = tops[:, 0] - tops[:, 1]
    angle = np.where(tops[:, choice] >= tops[:, 0] - EQUAL, angles[:, choice], angles[:, 0])
    n = direction(angle)
    ha, da, ra = a.support(angle)
    hb, db, rb = b.support(angle + np.pi)
    pa = a.at + ha[:, None] * n + da[:, None] * across(n)
    pb = b.at - hb[:, None] * n - db[:, None] * across(n)
    gap = np.sum(n * (b.at - a.at), -1) - ha - hb
    return n, gap, pa, pb, margin, gap + ra + rb


def meet(
    m: Mechanics, frames: list[Frame], pair: PairStructure, directions: int = DIRECTIONS, choice: int = 0
) -> tuple[Placed, Placed, tuple[Array, ...]]:
    """Both shapes of a pair, or the discs at their ends, and what `touch` says of them; corners of rectangles
    that overlap leave as the whole does.
    """
    a, b = place(m, frames, pair.shape_a, pair.end_a), place(m, frames, pair.shape_b, pair.end_b)
    met = touch(a, b, directions, choice)
    if {m.s.shapes[i].kind for i in (pair.shape_a, pair.shape_b)} != {"rectangle"}:
        return a, b, met
    one, other = (pair.shape_a, pair.shape_b) if pair.end_b else (pair.shape_b, pair.shape_a)
    wholes = [place(m, frames, shape, 0) for shape in (one, other)]
    blocks = [Block(each.at, each.angle, np.stack([each.a, each.b], -1), each.corner) for each in wholes]
    disc, sign = (b, 1.0) if pair.end_b else (a, -1.0)
    n, gap, margin = leave(blocks[0], blocks[1], disc.at, sign * met[0], met[1], one < other)
    at = disc.at - disc.a[:, None] * n
    points = (at - gap[:, None] * n, at) if pair.end_b else (at, at - gap[:, None] * n)
    moved = gap != met[1]
    first, second = (np.where(moved[:, None], new, old) for new, old in zip(points, met[2:4]))
    return a, b, (np.where(moved[:, None], sign * n, met[0]), gap, first, second, margin, met[5])


def gaps(m: Mechanics, q: Array, directions: int = DIRECTIONS) -> Array:
    """Signed distances (B, pairs) alone."""
    frames = m.frames(q)
    out = [meet(m, frames, pair, directions)[2][1] for pair in m.s.pairs]
    return np.stack(out, -1) if out else np.zeros((len(q), 0))


def touches(m: Mechanics, q: Array, directions: int = DIRECTIONS, choice: int = 0) -> Touches:
    """Distances and rows of all pairs at positions q (B, nv); `choice` as `touch` has it."""
    frames, nv = m.frames(q), m.s.nv
    out: list[tuple[Array, ...]] = []
    for pair in m.s.pairs:
        a, b, (n, gap, pa, pb, margin, radius) = meet(m, frames, pair, directions, choice)
        jac = np.zeros((len(q), 2, nv))
        for sign, shape, point in ((-1.0, a, pa), (1.0, b, pb)):
            if shape.body >= 0:
                frame = frames[shape.body]
                jac += sign * frame.jacobian(point - frame.at)
        radii = np.maximum(a.a, a.b) + np.maximum(b.a, b.b)
        size, extent = a.reach + b.reach + radii, np.abs(a.at).sum(-1) + np.abs(b.at).sum(-1) + radii
        projected = [np.einsum("bi,bij->bj", along, jac) for along in (n, across(n))]
        for i in (pair.shape_a, pair.shape_b) if m.s.runs else ():  # zero where a surface does not run
            projected[1][:, m.s.shapes[i].driver] -= m.p["surface_ratio"][:, i]
        out.append((
            gap, *projected, size, extent, margin,
            size / np.maximum(np.abs(radius), 1e-30),
        ))  # fmt: skip
    if not out:
        none = np.zeros((len(q), 0))
        rows = np.zeros((len(q), 0, nv))
        return Touches(none, rows, rows, none, none, none, none)
    return Touches(*(np.stack(part, 1) for part in zip(*out)))
