"""A shape A with straight sides against a disc B: the side, or the end, that B touches.

Beside a side A acts like a half-plane on its body; beyond it is the disc at its end, or at a corner. What B's
centre is near is the core: a capsule's segment, a rectangle less its corner radius all around. Inside of a
rectangle's core the nearest side counts.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..structure import RECTANGLE

ENDS = {wp.float64: 1e-14, wp.float32: 1e-5}  # of a half length: roundings beyond its ends
BORDERS = {wp.float64: 1e-9, wp.float32: 1e-5}  # and what is by an end, where derivatives are those of a mean


def make_sided(kind: str, dtype: type) -> SimpleNamespace:
    """Warp functions of the size and pose of A, of one of the `SIDED`, and the pose of B: normal; beside,
    whether B touches a side; height of that side above the centre; flat, as beside, for derivatives: 1, 0
    beyond the ends, 2 by one, where the curvature jumps.
    """
    return _make_rectangle(dtype) if kind == RECTANGLE else _make_capsule(dtype)


@cached
def _make_capsule(dtype: type) -> SimpleNamespace:
    V2, V4 = wp.types.vector(2, dtype), wp.types.vector(4, dtype)
    ZERO, ONE, NEARLY = dtype(0.0), dtype(1.0), dtype(1.0 + ENDS[dtype])
    BORDER = dtype(BORDERS[dtype])

    @wp.func
    def along_axis(pa: V4, pb: V4):
        return (pb[0] - pa[0]) * pa[2] + (pb[1] - pa[1]) * pa[3]

    @wp.func
    def is_beside(along: dtype, half: dtype):
        """Not beyond the ends, nor so little that rounding tells which end a normal points to."""
        return wp.abs(along) <= NEARLY * half

    @wp.func
    def beside(ra: V2, pa: V4, pb: V4):
        return is_beside(along_axis(pa, pb), ra[1])

    @wp.func
    def height(ra: V2, pa: V4, n: V2):
        return ra[0]

    @wp.func
    def flat(ra: V2, pa: V4, pb: V4):
        """1: the centre of B lies beside the segment of a capsule A, 0: beyond its ends, 2: by one, where the
        curvature jumps.
        """
        over = wp.abs(along_axis(pa, pb)) - ra[1]
        if wp.abs(over) <= BORDER * ra[1]:
            return int(2)
        return wp.where(over < ZERO, 1, 0)

    @wp.func
    def normal(ra: V2, pa: V4, pb: V4):
        # from the nearest point of the segment to the centre of B
        dx = pb[0] - pa[0]
        dy = pb[1] - pa[1]
        along = dx * pa[2] + dy * pa[3]
        if is_beside(along, ra[1]):
            side = wp.where(pa[2] * dy - pa[3] * dx < ZERO, ZERO - ONE, ONE)
            return V2(-side * pa[3], side * pa[2])
        end = wp.where(along < ZERO, -ra[1], ra[1])
        dx -= end * pa[2]
        dy -= end * pa[3]
        norm = wp.sqrt(dx * dx + dy * dy)
        if not norm > ZERO:
            return V2(-pa[3], pa[2])
        return V2(dx / norm, dy / norm)

    return SimpleNamespace(normal=normal, beside=beside, height=height, flat=flat)


@cached
def make_size(kind: str, dtype: type) -> type:
    """The numbers of a shape's size: radii, and a rectangle's corner radius."""
    return wp.types.vector(3 if kind == RECTANGLE else 2, dtype)


@cached
def make_core(dtype: type) -> wp.Function:
    """core(size) -> half sizes of a rectangle less its corner radius."""
    V2, V3 = wp.types.vector(2, dtype), wp.types.vector(3, dtype)

    @wp.func
    def core(size: V3):
        return V2(size[0] - size[2], size[1] - size[2])

    return core


@cached
def _make_rectangle(dtype: type) -> SimpleNamespace:
    V2, V3, V4 = wp.types.vector(2, dtype), wp.types.vector(3, dtype), wp.types.vector(4, dtype)
    ZERO, ONE, FEW, BORDER = dtype(0.0), dtype(1.0), dtype(ENDS[dtype]), dtype(BORDERS[dtype])
    core = make_core(dtype)

    @wp.func
    def place(pa: V4, pb: V4):
        """B's centre along both axes of A."""
        dx = pb[0] - pa[0]
        dy = pb[1] - pa[1]
        return V2(dx * pa[2] + dy * pa[3], dy * pa[2] - dx * pa[3])

    @wp.func
    def over(size: V3, p: V2):
        """How far a place is beyond the core along both axes."""
        half = core(size)
        return V2(wp.abs(p[0]) - half[0], wp.abs(p[1]) - half[1])

    @wp.func
    def is_beside(size: V3, o: V2):
        return not (o[0] > FEW * size[0] and o[1] > FEW * size[1])

    @wp.func
    def beside(size: V3, pa: V4, pb: V4):
        return is_beside(size, over(size, place(pa, pb)))

    @wp.func
    def height(size: V3, pa: V4, n: V2):
        half = core(size)
        return size[2] + wp.where(wp.abs(n[0] * pa[2] + n[1] * pa[3]) > dtype(0.5), half[0], half[1])

    @wp.func
    def flat(size: V3, pa: V4, pb: V4):
        o = over(size, place(pa, pb))
        x = BORDER * size[0]
        y = BORDER * size[1]
        if o[0] > x and o[1] > y:
            return int(0)
        if (o[0] > x and wp.abs(o[1]) <= y) or (o[1] > y and wp.abs(o[0]) <= x):
            return int(2)
        return int(1)

    @wp.func
    def normal(size: V3, pa: V4, pb: V4):
        p = place(pa, pb)
        o = over(size, p)
        sx = wp.where(p[0] < ZERO, ZERO - ONE, ONE)
        sy = wp.where(p[1] < ZERO, ZERO - ONE, ONE)
        x = sx * o[0]
        y = sy * o[1]
        if is_beside(size, o):
            x = wp.where(o[0] > o[1], sx, ZERO)
            y = wp.where(o[0] > o[1], ZERO, sy)
        norm = wp.sqrt(x * x + y * y)
        return V2((x * pa[2] - y * pa[3]) / norm, (x * pa[3] + y * pa[2]) / norm)

    return SimpleNamespace(normal=normal, beside=beside, height=height, flat=flat)
