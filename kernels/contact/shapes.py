"""Poses of the shapes of a structure and the distance of its pairs (`distance.py` has the mathematics)."""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..mechanism.kinematics import make_types
from ..structure import CORNERS, DISC, HALFPLANE, RECTANGLE, RING, SIDED, WALLS, WORLD, Structure, layout
from .aside import make_aside
from .distance import make_distance, make_round_support
from .sided import make_core, make_sided, make_size


@cached
def make_upright(dtype: type, given: type | None = None) -> wp.Function:
    """upright(c) -> c, or 0 where the cosine or sine of a right angle, `given` in less precision or not, left
    its rounding: the normal of level ground has no part along it, by which it could move what slides on it.
    """
    ZERO, ROUNDING = dtype(0.0), dtype(4e-16 if (given or dtype) is wp.float64 else 2e-7)

    @wp.func
    def upright(c: dtype):
        return wp.where(wp.abs(c) < ROUNDING, ZERO, c)

    return upright


MADE = {wp.float64: 1.0, wp.float32: 4.0}  # roundings where distances are computed in it, too
TINY = {wp.float64: 1e-9, wp.float32: 1e-4}  # [m] distances that may be roundings, of lengths to 400 m
ROUNDS = {wp.float64: 2.0**-52, wp.float32: 2.0**-24}  # of a length, as it is given


@cached
def make_told(dtype: type, given: type, rounds: float = 1.0) -> wp.Function:
    """told(gap, n, ra, rb, pa, pb) -> a distance along n, less what rounding may have made of it, or 0:
    centres and sizes are rounded to the precision that they are given in. Radii are those of whole shapes: a
    corner or end is as uncertain as the centre and the half size that it is placed by. `rounds`: how many
    roundings of all of these there may be, if not those of the data alone.
    """
    V2, V4 = wp.types.vector(2, dtype), wp.types.vector(4, dtype)
    ROUNDING = dtype(rounds * ROUNDS[given])

    @wp.func
    def told(gap: dtype, n: V2, ra: V2, rb: V2, pa: V4, pb: V4):
        lengths = wp.abs(n[0]) * (wp.abs(pa[0]) + wp.abs(pb[0]))
        lengths += wp.abs(n[1]) * (wp.abs(pa[1]) + wp.abs(pb[1]))
        lengths += wp.max(ra[0], ra[1]) + wp.max(rb[0], rb[1])
        most = ROUNDING * lengths
        return gap - wp.clamp(gap, -most, most)

    return told


@cached
def make_shape_size(s: Structure, shape: int, dtype: type, end: int = 0) -> wp.Function:
    """world -> the numbers of a shape's size (`make_size`), or twice the radius of the disc at its end. What
    is drawn for a corner radius is no larger than half a side.
    """
    t, lay = make_types(s, dtype), layout(s)
    kind = s.shapes[shape].kind
    disc = wp.types.vector(2, dtype)
    SIZE = disc if end else make_size(kind, dtype)
    FIRST = lay.offset("radius") + 2 * shape
    CORNER = lay.offset("corner_radius") + shape if kind == RECTANGLE else FIRST

    @wp.func
    def size(world: t.World):
        if wp.static(end in CORNERS):
            r = wp.min(
                world.params[wp.static(CORNER)],
                wp.min(world.params[wp.static(FIRST)], world.params[wp.static(FIRST + 1)]),
            )
            return disc(r, r)
        out = SIZE()
        out[0] = world.params[wp.static(FIRST)]
        out[1] = world.params[wp.static(FIRST + 1)]
        if wp.static(kind == RECTANGLE):
            out[2] = wp.min(world.params[wp.static(CORNER)], wp.min(out[0], out[1]))
        return out

    return size


@cached
def make_shape_pose(s: Structure, shape: int, end: int, dtype: type) -> wp.Function:
    """pose -> (c_x, c_y, e_x, e_y): centre and axis of a shape (a half-plane's point and outward normal), or
    of the disc at an end of a capsule or a corner of a rectangle.
    """
    t = make_types(s, dtype)
    lay = layout(s)
    V4 = wp.types.vector(4, dtype)
    ZERO, ONE = dtype(0.0), dtype(1.0)
    OFFSET, ANGLE = lay.offset("shape_offset") + 2 * shape, lay.offset("shape_angle") + shape
    HALF_LENGTH, END = lay.offset("radius") + 2 * shape + 1, dtype(float(end))
    SIGN_X, SIGN_Y = map(dtype, CORNERS.get(end, (0.0, 0.0)))
    size, core = make_shape_size(s, shape, dtype), make_core(dtype)
    body, turned = s.shapes[shape].body, s.shapes[shape].turned
    upright = make_upright(dtype)

    @wp.func
    def pose(world: t.World, fr: t.FRAMES):
        x = world.params[wp.static(OFFSET)]
        y = world.params[wp.static(OFFSET + 1)]
        ex = ONE
        ey = ZERO
        if wp.static(turned):
            ex = upright(wp.cos(world.params[wp.static(ANGLE)]))
            ey = upright(wp.sin(world.params[wp.static(ANGLE)]))
        if wp.static(end in CORNERS):
            half = core(size(world))
            x += SIGN_X * half[0] * ex - SIGN_Y * half[1] * ey
            y += SIGN_X * half[0] * ey + SIGN_Y * half[1] * ex
        elif wp.static(end != 0):
            x += END * world.params[wp.static(HALF_LENGTH)] * ex
            y += END * world.params[wp.static(HALF_LENGTH)] * ey
        if wp.static(body == WORLD):
            return V4(x, y, ex, ey)
        c = fr[wp.static(max(body, 0)), 0]
        sn = fr[wp.static(max(body, 0)), 1]
        px = fr[wp.static(max(body, 0)), 2] + c * x - sn * y
        py = fr[wp.static(max(body, 0)), 3] + sn * x + c * y
        return V4(px, py, c * ex - sn * ey, sn * ex + c * ey)

    return pose


def oriented_pair(s: Structure, pair: int) -> tuple[int, int]:
    """(shape_a, shape_b) with a half-plane, a ring, or a whole shape with sides, first.

    The swap turns n and t both, so that J_n and J_t do not change.
    """
    p = s.pairs[pair]
    return (p.shape_b, p.shape_a) if _swapped(s, pair) else (p.shape_a, p.shape_b)


def oriented_ends(s: Structure, pair: int) -> tuple[int, int]:
    """(end_a, end_b) in the same order."""
    p = s.pairs[pair]
    return (p.end_b, p.end_a) if _swapped(s, pair) else (p.end_a, p.end_b)


def _swapped(s: Structure, pair: int) -> bool:
    p = s.pairs[pair]
    kind = s.shapes[p.shape_b].kind
    return kind in WALLS or (kind in SIDED and p.end_b == 0)


@cached
def make_pair(s: Structure, pair: int, dtype: type) -> SimpleNamespace:
    """Warp functions of one contact pair: geometry, a cheap lower bound of d, and support derivatives.

    `local_geometry` has a normal of (0, 0) where it takes a global search to find it.
    `flat` tells whether a capsule or rectangle A is touched beside a side, where it acts like a half-plane on
    its body.
    """
    a, b = oriented_pair(s, pair)
    end_a, end_b = oriented_ends(s, pair)
    kind_a, kind_b = DISC if end_a else s.shapes[a].kind, DISC if end_b else s.shapes[b].kind
    plane = kind_a == HALFPLANE
    t = make_types(s, dtype)
    pose_a, pose_b = make_shape_pose(s, a, end_a, dtype), make_shape_pose(s, b, end_b, dtype)
    distance = make_distance(kind_a, kind_b, dtype)
    V2, V4, GEO = wp.types.vector(2, dtype), wp.types.vector(4, dtype), wp.types.vector(8, dtype)
    ZERO = dtype(0.0)
    radii_a, radii_b = make_shape_size(s, a, dtype, end_a), make_shape_size(s, b, dtype, end_b)
    told, RADIUS = make_told(dtype, dtype, MADE[dtype]), layout(s).offset("radius")
    NEAR = dtype(TINY[dtype])

    @wp.func
    def whole(world: t.World, first: int):
        return V2(world.params[first], world.params[first + 1])

    def make_pair_support(radii: wp.Function, kind: str) -> wp.Function:
        round_support = make_round_support(kind, dtype)

        @wp.func
        def support(world: t.World, pose: wp.types.vector(4, dtype), n: V2):
            return wp.static(round_support)(wp.static(radii)(world), pose, n)

        return support

    blocks = kind_a == RECTANGLE and end_b in CORNERS
    beside, aside = make_sided(kind_a, dtype).beside, make_aside(dtype)
    whole_b, size_b = make_shape_pose(s, b, 0, dtype), make_shape_size(s, b, dtype)

    @wp.func
    def of_blocks(world: t.World, fr: t.FRAMES, g: GEO, pa: V4, pb: V4):
        """GEO of a corner of B, or where it overlaps A, by the side by which B leaves."""
        if g[2] < ZERO:
            size_a = wp.static(radii_a)(world)
            if beside(size_a, pa, pb):
                n = V2(g[0], g[1])
                n = aside(
                    size_a,
                    wp.static(size_b)(world),
                    pa,
                    wp.static(whole_b)(world, fr),
                    pb,
                    n,
                    wp.static(int(a < b)),
                )
                return wp.static(distance.at)(size_a, wp.static(radii_b)(world), pa, pb, n)
        return g

    @wp.func
    def flat(world: t.World, pa: V4, pb: V4):
        return wp.static(distance.flat)(wp.static(radii_a)(world), pa, pb)

    @wp.func
    def bound(world: t.World, fr: t.FRAMES):
        """A lower bound of d (exact for half-planes, capsules, rings and discs)."""
        pa = wp.static(pose_a)(world, fr)
        pb = wp.static(pose_b)(world, fr)
        return wp.static(distance.bound)(wp.static(radii_a)(world), wp.static(radii_b)(world), pa, pb)

    def make_geometry(found: wp.Function) -> wp.Function:
        @wp.func
        def geometry(world: t.World, fr: t.FRAMES, warm: V2):
            """GEO of the pair; `warm` starts the search (0, 0: from the line of centres)."""
            pa = wp.static(pose_a)(world, fr)
            pb = wp.static(pose_b)(world, fr)
            g = wp.static(found)(wp.static(radii_a)(world), wp.static(radii_b)(world), pa, pb, warm)
            if wp.static(blocks):
                g = wp.static(of_blocks)(world, fr, g, pa, pb)
            if wp.static(len(s.pairs) > 1):  # a single pair has nothing on the other side
                if wp.abs(g[2]) < NEAR:
                    wide_a = whole(world, wp.static(RADIUS + 2 * a))
                    wide_b = whole(world, wp.static(RADIUS + 2 * b))
                    g[2] = told(g[2], V2(g[0], g[1]), wide_a, wide_b, pa, pb)
            return g

        return geometry

    return SimpleNamespace(
        bound=bound,
        geometry=make_geometry(distance.geometry),
        local_geometry=make_geometry(distance.local),
        pose_a=pose_a,
        pose_b=pose_b,
        support_a=make_pair_support(radii_a, kind_a),
        support_b=make_pair_support(radii_b, kind_b),
        plane=plane,
        sided=kind_a in SIDED,
        hollow=kind_a == RING,
        flat=flat,
        body_a=s.shapes[a].body,
        body_b=s.shapes[b].body,
        exact_bound=distance.exact,
    )
