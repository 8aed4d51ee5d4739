"""Where the shapes of any scene are, by its tables, their sizes, and the distances of its pairs."""

from types import SimpleNamespace

import warp as wp

from ..contact.aside import make_aside
from ..contact.distance import make_distance
from ..contact.shapes import make_told, make_upright
from ..contact.sided import make_core, make_sided
from ..factories import cached
from ..structure import CAPSULE, DISC, ELLIPSE, HALFPLANE, RECTANGLE, RING, WORLD
from .motion.mechanism import COLUMN, make_mechanism
from .topology import BLOCK, HOLLOW, LONG, PLANE, Topology
from .work import V2, V3, V4, WORK, Slot


@cached
def make_shapes(given: type) -> SimpleNamespace:
    """Warp functions: place_shapes in their bodies, move_shapes with these; pose_a, pose_b, radii_a, radii_b
    of a pair's shapes; geometry(t, k, pair); bound(t, k, pair, ra, rb, pa, pb) <= its distance.
    """
    dtype = WORK
    number = make_mechanism(given).number
    ZERO, ONE = dtype(0.0), dtype(1.0)
    RADIUS, CORNER, OFFSET, TURNED = (
        COLUMN[n] for n in ("radius", "corner_radius", "shape_offset", "shape_angle")
    )
    upright, told = make_upright(dtype, given), make_told(dtype, given)
    GEO = wp.types.vector(8, dtype)
    long_distance = make_distance(CAPSULE, DISC, dtype)
    block_distance = make_distance(RECTANGLE, DISC, dtype)
    hollow_distance = make_distance(RING, DISC, dtype)
    beside_block, aside = make_sided(RECTANGLE, dtype).beside, make_aside(dtype)
    core = make_core(dtype)
    plane_distance = make_distance(HALFPLANE, ELLIPSE, dtype)
    round_distance = make_distance(ELLIPSE, ELLIPSE, dtype)

    @wp.func
    def place_shapes(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Centre and axis of every shape in its body: once for all steps."""
        for i in range(t.shapes):
            ex = ONE
            ey = ZERO
            if t.shape_turned[i] == 1:
                angle = number(t, k, TURNED, i)
                ex = upright(wp.cos(angle))
                ey = upright(wp.sin(angle))
            k.shape[t.shapes + i] = V4(number(t, k, OFFSET, 2 * i), number(t, k, OFFSET, 2 * i + 1), ex, ey)

    @wp.func
    def move_shapes(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Centre and axis of every shape in the world."""
        for i in range(t.shapes):
            p = k.shape[t.shapes + i]
            body = t.shape_body[i]
            if body == WORLD:
                k.shape[i] = p
            else:
                f = k.frame[body]
                x = f[2] + f[0] * p[0] - f[1] * p[1]
                y = f[3] + f[1] * p[0] + f[0] * p[1]
                k.shape[i] = V4(x, y, f[0] * p[2] - f[1] * p[3], f[1] * p[2] + f[0] * p[3])

    @wp.func
    def size(t: wp.ref[Topology], k: wp.ref[Slot], shape: int):
        """Half sizes and corner radius, which is no larger than these, of a rectangle."""
        x = number(t, k, RADIUS, 2 * shape)
        y = number(t, k, RADIUS, 2 * shape + 1)
        return V3(x, y, wp.min(number(t, k, CORNER, shape), wp.min(x, y)))

    @wp.func
    def pose(t: wp.ref[Topology], k: wp.ref[Slot], shape: int, end: int):
        """Centre and axis of a shape, or of the disc at an end of a capsule or a corner of a rectangle."""
        p = k.shape[shape]
        if end > 1:
            half = core(size(t, k, shape))
            x = wp.where(end == 2 or end == 5, -half[0], half[0])
            y = wp.where(end < 4, -half[1], half[1])
            return V4(p[0] + x * p[2] - y * p[3], p[1] + x * p[3] + y * p[2], p[2], p[3])
        if end != 0:
            reach = dtype(end) * number(t, k, RADIUS, 2 * shape + 1)
            return V4(p[0] + reach * p[2], p[1] + reach * p[3], p[2], p[3])
        return p

    @wp.func
    def radii(t: wp.ref[Topology], k: wp.ref[Slot], shape: int, end: int):
        if end > 1:
            corner = size(t, k, shape)[2]
            return V2(corner, corner)
        r = number(t, k, RADIUS, 2 * shape)
        if end != 0:
            return V2(r, r)
        return V2(r, number(t, k, RADIUS, 2 * shape + 1))

    @wp.func
    def pose_a(t: wp.ref[Topology], k: wp.ref[Slot], pair: int):
        return pose(t, k, t.pair_a[pair], t.pair_ends[2 * pair])

    @wp.func
    def pose_b(t: wp.ref[Topology], k: wp.ref[Slot], pair: int):
        return pose(t, k, t.pair_b[pair], t.pair_ends[2 * pair + 1])

    @wp.func
    def radii_a(t: wp.ref[Topology], k: wp.ref[Slot], pair: int):
        return radii(t, k, t.pair_a[pair], t.pair_ends[2 * pair])

    @wp.func
    def radii_b(t: wp.ref[Topology], k: wp.ref[Slot], pair: int):
        return radii(t, k, t.pair_b[pair], t.pair_ends[2 * pair + 1])

    @wp.func
    def parts(t: wp.ref[Topology], k: wp.ref[Slot], pair: int, g: GEO, pa: V4, pb: V4):
        """What `geometry` gives back."""
        n = V2(g[0], g[1])
        k.normal[pair] = n
        ra = radii(t, k, t.pair_a[pair], 0)
        rb = radii(t, k, t.pair_b[pair], 0)
        return g[0], g[1], told(g[2], n, ra, rb, pa, pb), g[3], g[4], g[5], g[6]

    @wp.func
    def block_geometry(t: wp.ref[Topology], k: wp.ref[Slot], pair: int, rb: V2, pa: V4, pb: V4):
        a = t.pair_a[pair]
        b = t.pair_b[pair]
        block = size(t, k, a)
        g = block_distance.geometry(block, rb, pa, pb, V2())
        if t.pair_ends[2 * pair + 1] > 1 and g[2] < ZERO and beside_block(block, pa, pb):
            n = aside(block, size(t, k, b), pa, k.shape[b], pb, V2(g[0], g[1]), wp.where(a < b, 1, 0))
            g = block_distance.at(block, rb, pa, pb, n)
        return g

    @wp.func(inline=False)
    def geometry(t: wp.ref[Topology], k: wp.ref[Slot], pair: int):
        """GEO of a pair without its last entry, its distance as far as the data tell it; the search starts at
        the last normal, which it replaces. Numbers one by one: a vector goes through memory, and a processor
        waits where it is written in parts and read as a whole.
        """
        pa = pose_a(t, k, pair)
        pb = pose_b(t, k, pair)
        ra = radii_a(t, k, pair)
        rb = radii_b(t, k, pair)
        if t.pair_kind[pair] == PLANE:
            return parts(t, k, pair, plane_distance.geometry(ra, rb, pa, pb, V2()), pa, pb)
        if t.pair_kind[pair] == LONG:
            return parts(t, k, pair, long_distance.geometry(ra, rb, pa, pb, V2()), pa, pb)
        if t.pair_kind[pair] == BLOCK:
            return parts(t, k, pair, block_geometry(t, k, pair, rb, pa, pb), pa, pb)
        if t.pair_kind[pair] == HOLLOW:
            return parts(t, k, pair, hollow_distance.geometry(ra, rb, pa, pb, V2()), pa, pb)
        return parts(t, k, pair, round_distance.geometry(ra, rb, pa, pb, k.normal[pair]), pa, pb)

    @wp.func
    def bound(t: wp.ref[Topology], k: wp.ref[Slot], pair: int, ra: V2, rb: V2, pa: V4, pb: V4):
        if t.pair_kind[pair] == PLANE:
            return plane_distance.bound(ra, rb, pa, pb)
        if t.pair_kind[pair] == LONG:
            return long_distance.bound(ra, rb, pa, pb)
        if t.pair_kind[pair] == BLOCK:
            return block_distance.bound(size(t, k, t.pair_a[pair]), rb, pa, pb)
        if t.pair_kind[pair] == HOLLOW:
            return hollow_distance.bound(ra, rb, pa, pb)
        return round_distance.bound(ra, rb, pa, pb)

    return SimpleNamespace(
        place_shapes=place_shapes,
        move_shapes=move_shapes,
        pose_a=pose_a,
        pose_b=pose_b,
        radii_a=radii_a,
        radii_b=radii_b,
        size=size,
        geometry=geometry,
        bound=bound,
    )
