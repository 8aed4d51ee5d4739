"""Where the shapes of a contact pair are, and what their supports are at its solved normal, with the kinds of
shapes known at run time; the formulas are those of `contact/derivatives.py`.
"""

import warp as wp

from ...contact.distance import CENTRE, make_distance, make_round_support
from ...factories import cached
from ...structure import CAPSULE, DISC, ELLIPSE, RECTANGLE, RING
from ..contact import make_contact
from ..topology import BLOCK, HOLLOW, LONG, PLANE, Topology
from ..work import V2, V4, WORK, Slot

LEAST = 1e-12  # of the curvature of a distance


@wp.struct
class Touch:
    """A pair at its normal."""

    n: V2
    pa: V4
    pb: V4
    ha: V4  # h and its derivatives by the normal's angle
    hb: V4
    curvature: WORK  # R of (M28), away from zero
    flat: int  # 1: A is a half-plane, or touched beside one of its sides; 2: by an end of one


@cached
def make_touched(given: type, residual: str) -> wp.Function:
    """touched(t, k, pair) -> Touch."""
    contact = make_contact(given, residual)
    disc, ellipse, capsule, rectangle, ring = (
        make_round_support(kind, WORK) for kind in (DISC, ELLIPSE, CAPSULE, RECTANGLE, RING)
    )
    where, where_block = (make_distance(kind, DISC, WORK).flat for kind in (CAPSULE, RECTANGLE))
    ZERO, ONE, EPS, NOWHERE = WORK(0.0), WORK(1.0), WORK(LEAST), WORK(CENTRE)

    @wp.func
    def support(radii: V2, pose: V4, n: V2, end: int):
        if end != 0:
            return disc(radii, pose, n)
        return ellipse(radii, pose, n)

    @wp.func
    def touched(t: wp.ref[Topology], k: wp.ref[Slot], pair: int):
        out = Touch()
        n = k.normal[pair]
        pa = contact.pose_a(t, k, pair)
        pb = contact.pose_b(t, k, pair)
        ra = contact.radii_a(t, k, pair)
        hb = support(contact.radii_b(t, k, pair), pb, n, t.pair_ends[2 * pair + 1])
        ha = V4()
        flat = int(0)
        if t.pair_kind[pair] == PLANE:
            flat = 1
        elif t.pair_kind[pair] == LONG:
            ha = capsule(ra, pa, n)
            flat = where(ra, pa, pb)
        elif t.pair_kind[pair] == BLOCK:
            size = contact.size(t, k, t.pair_a[pair])
            ha = rectangle(size, pa, n)
            flat = where_block(size, pa, pb)
        elif t.pair_kind[pair] == HOLLOW:
            ha = ring(ra, pa, n)
        else:
            ha = support(ra, pa, n, t.pair_ends[2 * pair])
        dx = pb[0] - pa[0]
        dy = pb[1] - pa[1]
        reach = n[0] * dx + n[1] * dy
        out.curvature = ONE
        if flat > 0:
            ha = V4(ha[0], n[0] * dy - n[1] * dx - hb[1], ha[2], ha[3])
        if flat == 1:
            ha = V4(ha[0], ha[1], ZERO, ZERO)
        if flat != 1:
            curvature = reach + ha[2] + hb[2]
            floor = EPS * (wp.abs(ha[0]) + wp.abs(hb[0]) + wp.abs(reach)) + EPS
            out.curvature = wp.where(wp.abs(curvature) > floor, curvature, floor)
            if t.pair_kind[pair] == HOLLOW and wp.abs(curvature) <= floor:
                out.curvature = NOWHERE
        out.n = n
        out.pa = pa
        out.pb = pb
        out.ha = ha
        out.hb = hb
        out.flat = flat
        return out

    return touched
