"""A shape A with straight sides against a disc B: the side, or the end, that B touches.

Beside a side A acts like a half-plane on its body; beyond it is the disc at its end.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..structure import CAPSULE

SIDED = (CAPSULE,)
ENDS = {wp.float64: 1e-14, wp.float32: 1e-5}  # of a capsule's half length: roundings beyond its ends
BORDERS = {wp.float64: 1e-9, wp.float32: 1e-5}  # and what is by an end, where derivatives are those of a mean


@cached
def make_sided(dtype: type) -> SimpleNamespace:
    """Warp functions of the radii and pose of a capsule A and the pose of B: normal; beside, whether B touches a
    side; height of that side above the centre; flat, as beside, for derivatives.
    """
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
