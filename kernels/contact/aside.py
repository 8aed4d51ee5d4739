"""Where two rectangles overlap (M62): the side of A by which a corner of B leaves, as the whole of B does.

By its own distance a corner leaves by the nearest side. Of two boxes of one height side by side, pushed into
each other by more than their corners are rounded, those at the top would leave upwards and those at the
bottom downwards, and no velocity does both. The whole of B leaves along the axis, of A's and B's, on which
they overlap least (separating axes: Gottschalk et al. 1996), if neither reaches beyond the other there: a
corner that this frees leaves by that side of A, any other by the nearest.
"""

import warp as wp

from ..factories import cached
from .sided import ENDS, make_core

MOST = 1.5  # times the least overlap: as far as a corner goes the way of the whole


@cached
def make_aside(dtype: type) -> wp.Function:
    """aside(size_a, size_b, pa, pb, corner, n, first) -> n, or the normal of the side by which B leaves A.

    pa and pb are poses of the centres of A and B, `corner` of the disc at a corner of B, which overlaps A
    with the nearest normal n, beside a side of A. Of two in the same place A goes one way if it is `first`,
    and the other if not.
    """
    V2, V3, V4 = wp.types.vector(2, dtype), wp.types.vector(3, dtype), wp.types.vector(4, dtype)
    ZERO, ONE, FAR, FEW = dtype(0.0), dtype(1.0), dtype(MOST), dtype(ENDS[dtype])
    core = make_core(dtype)

    @wp.func
    def along(p: V4, x: dtype, y: dtype):
        """A vector in the axes of a pose."""
        return V2(x * p[2] + y * p[3], y * p[2] - x * p[3])

    @wp.func
    def overlap(own: V3, other: V3, d: V2, cosine: dtype, sine: dtype):
        """Of two rectangles along both axes of one: half widths of both less the distance of the centres;
        and how far one reaches beyond the other, where it does.
        """
        half = core(other)
        x = other[2] + cosine * half[0] + sine * half[1]
        y = other[2] + sine * half[0] + cosine * half[1]
        far = V2(wp.abs(d[0]), wp.abs(d[1]))
        beyond = V2(wp.abs(own[0] - x) - far[0], wp.abs(own[1] - y) - far[1])
        return V4(own[0] + x - far[0], own[1] + y - far[1], beyond[0], beyond[1])

    @wp.func
    def aside(size_a: V3, size_b: V3, pa: V4, pb: V4, corner: V4, n: V2, first: int):
        cosine = wp.abs(pa[2] * pb[2] + pa[3] * pb[3])
        sine = wp.abs(pa[2] * pb[3] - pa[3] * pb[2])
        dx = pb[0] - pa[0]
        dy = pb[1] - pa[1]
        d = along(pa, dx, dy)
        by_a = overlap(size_a, size_b, d, cosine, sine)
        by_b = overlap(size_b, size_a, along(pb, dx, dy), cosine, sine)
        least_a = wp.min(by_a[0], by_a[1])
        least_b = wp.min(by_b[0], by_b[1])
        across = by_a[0] <= by_a[1]  # along A's first axis
        beyond = wp.where(across, by_a[2], by_a[3])
        if least_b < least_a:
            first_b = by_b[0] <= by_b[1]
            beyond = wp.where(first_b, by_b[2], by_b[3])
            across = first_b == (cosine > sine)
        if beyond > FEW * size_b[0]:
            return n
        place = along(pa, corner[0] - pa[0], corner[1] - pa[1])
        way = wp.where(across, d[0], d[1])
        sign = wp.where(way < ZERO, ZERO - ONE, ONE)
        if way == ZERO and first == 0:
            sign = ZERO - ONE
        deep = wp.where(across, size_a[0] - sign * place[0], size_a[1] - sign * place[1]) + size_b[2]
        if deep > FAR * wp.min(least_a, least_b):
            return n
        if across:
            return V2(sign * pa[2], sign * pa[3])
        return V2(-sign * pa[3], sign * pa[2])

    return aside
