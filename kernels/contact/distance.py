"""Signed distance of two convex shapes from their numbers: radii, centre and axis.

d = max over unit n of n.(c_B - c_A) - h_A(n) - h_B(-n) (M4), with h the support function: positive when
separated, negative when penetrating. With the angle alpha of n, n = (cos alpha, sin alpha) and t = dn/dalpha,
the distance is stationary where t.(c_B - c_A) - h_A' - h_B' = 0, and its curvature there is -(d + rho_A +
rho_B) (M5). A local search is trusted when it ends at d > -R, R = the sum of both shapes' smallest radii of
curvature: the circle of radius R rolls freely inside the Minkowski sum of the shapes (Blaschke's theorem), so
no other point of its boundary is nearer than a stationary one at depth < R. Deeper, the circle is searched.

A pose is (c_x, c_y, e_x, e_y): centre and first axis (a half-plane's point and outward normal). GEO = (n_x,
n_y, d, h_A, h_A', h_B, h_B', _) at the solution. For a half-plane A: h_A = 0 and h_A' is the lever of the
touched point along t, so that the same Jacobian formulas hold. The same is true of a capsule A (radii: its
radius and half length) that a disc touches between the ends; beyond them it is the disc at its end.

A ring A, which holds discs in, is a disc of negative radius: h_A = -R, and n points inwards, against the line
of centres, where the distance is stationary, too: d = R - |c_B - c_A| - h_B.
"""

import math
from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..structure import CAPSULE, DISC, HALFPLANE, RECTANGLE, RING, SIDED
from .sided import make_core, make_sided, make_size

SAMPLES = 12  # boundary points of either shape tried by the global search
LOCAL_ITERATIONS = 12
CENTRE = 1e30  # radius of turning of a normal at the centre of a ring, where it has no direction to turn from


@cached
def make_support(dtype: type) -> wp.Function:
    """support(a, b, c, s): h, h', h'', h''' of an ellipse at the unit vector c e1 + s e2.

    Primes are d/dalpha.
    """
    V4 = wp.types.vector(4, dtype)
    ZERO, ONE, THREE = dtype(0.0), dtype(1.0), dtype(3.0)

    @wp.func
    def support(a: dtype, b: dtype, c: dtype, s: dtype):
        h = wp.sqrt(a * a * c * c + b * b * s * s)
        if not h > ZERO:
            return V4(ZERO, ZERO, ZERO, ZERO)
        inv = ONE / h
        first = (b * b - a * a) * c * s * inv
        rho = a * a * b * b * inv * inv * inv
        return V4(h, first, rho - h, -THREE * rho * first * inv - first)

    return support


@cached
def make_round_support(kind: str, dtype: type) -> wp.Function:
    """support(size, pose, n) -> (h, h', h'', h''') of a disc, a ring, an ellipse, or the end of a
    capsule or corner of a rectangle that n points to.
    """
    support = make_support(dtype)
    SIZE, core = make_size(kind, dtype), make_core(dtype)
    V2, V4 = wp.types.vector(2, dtype), wp.types.vector(4, dtype)
    ZERO = dtype(0.0)

    @wp.func
    def round_support(radii: SIZE, pose: V4, n: V2):
        if wp.static(kind == DISC):
            return V4(radii[0], ZERO, ZERO, ZERO)
        if wp.static(kind == RING):
            return V4(-radii[0], ZERO, ZERO, ZERO)
        c = n[0] * pose[2] + n[1] * pose[3]
        if wp.static(kind == CAPSULE):
            end = wp.where(c < ZERO, -radii[1], radii[1])
            across = end * (n[0] * pose[3] - n[1] * pose[2])
            return V4(radii[0] + end * c, across, -end * c, -across)
        if wp.static(kind == RECTANGLE):
            half = core(radii)
            sn = n[1] * pose[2] - n[0] * pose[3]
            ax = wp.where(c < ZERO, -half[0], half[0])
            ay = wp.where(sn < ZERO, -half[1], half[1])
            reach = ax * c + ay * sn
            lever = ay * c - ax * sn
            return V4(radii[2] + reach, lever, -reach, -lever)
        return support(radii[0], radii[1], c, n[1] * pose[2] - n[0] * pose[3])

    return round_support


@cached
def make_distance(kind_a: str, kind_b: str, dtype: type) -> SimpleNamespace:
    """geometry(ra, rb, pa, pb, warm) -> GEO and bound(ra, rb, pa, pb) <= d; a half-plane, a capsule
    or a ring can only be A, the latter two only against a disc. `local` is `geometry` by a local search
    alone: where that does not suffice n is (0, 0). at(ra, rb, pa, pb, n): GEO at a normal.
    flat(ra, pa, pb): where B touches a capsule A.

    An ellipse of equal radii (zero too) is a disc to rounding, so one pair of ellipses serves all round
    shapes where the kind is known at run time only.
    """
    plane, sided, hollow = kind_a == HALFPLANE, kind_a in SIDED, kind_a == RING
    sides = make_sided(kind_a, dtype)
    SIZE = make_size(kind_a, dtype)
    exact = plane or sided or (kind_a in (DISC, RING) and kind_b == DISC)
    support_a, support_b = make_round_support(kind_a, dtype), make_round_support(kind_b, dtype)
    V2, V4, GEO = wp.types.vector(2, dtype), wp.types.vector(4, dtype), wp.types.vector(8, dtype)
    ZERO, ONE = dtype(0.0), dtype(1.0)
    maximise, climb = (None, None) if exact else make_maximisers(kind_a, kind_b, dtype)

    @wp.func
    def direct(ra: SIZE, rb: V2, pa: V4, pb: V4, n: V2):
        # GEO at a given normal
        dx = pb[0] - pa[0]
        dy = pb[1] - pa[1]
        ha = V4()
        hb = wp.static(support_b)(rb, pb, n)
        if wp.static(plane):
            ha[1] = n[0] * dy - n[1] * dx - hb[1]
        elif wp.static(sided):
            ha = wp.static(support_a)(ra, pa, n)
            if sides.beside(ra, pa, pb):
                ha = V4(sides.height(ra, pa, n), n[0] * dy - n[1] * dx - hb[1], ZERO, ZERO)
        else:
            ha = wp.static(support_a)(ra, pa, n)
        return GEO(n[0], n[1], n[0] * dx + n[1] * dy - ha[0] - hb[0], ha[0], ha[1], hb[0], hb[1], ZERO)

    @wp.func
    def centre_normal(pa: V4, pb: V4):
        dx = pb[0] - pa[0]
        dy = pb[1] - pa[1]
        norm = wp.sqrt(dx * dx + dy * dy)
        if not norm > ZERO:
            return V2(ONE, ZERO)
        return V2(dx / norm, dy / norm)

    @wp.func
    def first_normal(ra: SIZE, pa: V4, pb: V4):
        # the normal, or where a search for it starts
        if wp.static(plane):
            return V2(pa[2], pa[3])
        if wp.static(sided):
            return sides.normal(ra, pa, pb)
        if wp.static(hollow):
            return -centre_normal(pa, pb)
        return centre_normal(pa, pb)

    @wp.func
    def bound(ra: SIZE, rb: V2, pa: V4, pb: V4):
        """A lower bound of d: its objective along the line of centres (exact where that is the normal)."""
        n = first_normal(ra, pa, pb)
        geo = direct(ra, rb, pa, pb, n)
        return geo[2]

    def make_geometry(search: wp.Function | None) -> wp.Function:
        @wp.func
        def geometry(ra: SIZE, rb: V2, pa: V4, pb: V4, warm: V2):
            """GEO of the pair; `warm` starts the search (0, 0: from the line of centres)."""
            n = first_normal(ra, pa, pb)
            if wp.static(search is not None):
                if warm[0] * warm[0] + warm[1] * warm[1] > ZERO:
                    n = warm
                n = wp.static(search)(ra, rb, pa, pb, n)
            return direct(ra, rb, pa, pb, n)

        return geometry

    return SimpleNamespace(
        bound=bound,
        geometry=make_geometry(maximise),
        local=make_geometry(climb),
        at=direct,
        flat=sides.flat,
        exact=exact,
    )


@cached
def make_maximisers(kind_a: str, kind_b: str, dtype: type) -> tuple[wp.Function, wp.Function]:
    """maximise(ra, rb, pa, pb, n) -> n of the signed distance of two round shapes; the same without the
    global search, (0, 0) where it would be needed.
    """
    support_a, support_b = make_round_support(kind_a, dtype), make_round_support(kind_b, dtype)
    V2, V4 = wp.types.vector(2, dtype), wp.types.vector(4, dtype)
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    TOL = dtype(1e-9 if dtype is wp.float64 else 1e-4)  # quadratic: the next error is its square
    CUBIC = dtype(3e-6 if dtype is wp.float64 else 3e-3)
    CAP, TINY = dtype(0.7), dtype(1e-30)
    HUGE = dtype(1e30)
    SPACING = dtype(2.0 * math.pi / SAMPLES)
    COS, SIN = dtype(math.cos(2.0 * math.pi / SAMPLES)), dtype(math.sin(2.0 * math.pi / SAMPLES))

    @wp.func
    def evaluate(ra: V2, rb: V2, pa: V4, pb: V4, n: V2):
        # objective along alpha, its slope, minus its curvature R, and dR/dalpha
        dx = pb[0] - pa[0]
        dy = pb[1] - pa[1]
        ha = wp.static(support_a)(ra, pa, n)
        hb = wp.static(support_b)(rb, pb, n)
        reach = n[0] * dx + n[1] * dy
        lever = n[0] * dy - n[1] * dx
        return V4(reach - ha[0] - hb[0], lever - ha[1] - hb[1], reach + ha[2] + hb[2], lever + ha[3] + hb[3])

    @wp.func
    def turn(n: V2, tau: dtype):
        # rotation by atan(tau): no trigonometry
        scale = ONE / wp.sqrt(ONE + tau * tau)
        return V2((n[0] - tau * n[1]) * scale, (n[1] + tau * n[0]) * scale)

    @wp.func
    def axis_direction(radii: V2, pose: V4, c: dtype, sn: dtype):
        # normal at the boundary point (a c, b sn) of an ellipse: dense where its support function bends
        a = wp.max(radii[0], TINY)
        b = wp.max(radii[1], TINY)
        x = b * c / wp.max(a, b)
        y = a * sn / wp.max(a, b)
        norm = wp.sqrt(x * x + y * y)
        x = x / norm
        y = y / norm
        return V2(x * pose[2] - y * pose[3], x * pose[3] + y * pose[2])

    @wp.func
    def climb(ra: V2, rb: V2, pa: V4, pb: V4, start: V2):
        # two guarded Newton steps, so that candidates of different basins are compared near their tops
        n = start
        for _k in range(2):
            e = evaluate(ra, rb, pa, pb, n)
            tau = wp.clamp(e[1] / wp.max(e[2], TINY), ZERO - SPACING, SPACING)
            n = turn(n, tau)
        return n

    @wp.func
    def search(ra: V2, rb: V2, pa: V4, pb: V4):
        # best of SAMPLES directions of either shape, then Newton on the slope inside a bracket
        c = dtype(1.0)
        sn = dtype(0.0)
        best = V2(ONE, ZERO)
        value = ZERO - HUGE
        for k in range(2 * SAMPLES):
            start = axis_direction(wp.where(k % 2 == 0, ra, rb), wp.where(k % 2 == 0, pa, pb), c, sn)
            n = climb(ra, rb, pa, pb, start)
            e = evaluate(ra, rb, pa, pb, start)
            if e[0] > value:
                value = e[0] + ZERO
                best = V2(start[0], start[1])
            e = evaluate(ra, rb, pa, pb, n)
            if e[0] > value:
                value = e[0] + ZERO
                best = V2(n[0], n[1])
            if k % 2 == 1:
                turned = COS * c - SIN * sn
                sn = SIN * c + COS * sn
                c = turned + ZERO
        low = ZERO - SPACING
        high = ZERO + SPACING
        angle = dtype(0.0)
        step = dtype(1.0)
        n = V2(best[0], best[1])
        it = int(0)
        while wp.abs(step) > TOL and it < 60:
            e = evaluate(ra, rb, pa, pb, n)
            low = wp.where(e[1] > ZERO, angle, low)
            high = wp.where(e[1] > ZERO, high, angle)
            newton = angle + e[1] / wp.max(e[2], TINY)
            inside = e[2] > ZERO and newton > low and newton < high
            target = wp.where(inside, newton, HALF * (low + high))
            step = target - angle
            angle = target + ZERO
            n = V2(
                wp.cos(angle) * best[0] - wp.sin(angle) * best[1],
                wp.cos(angle) * best[1] + wp.sin(angle) * best[0],
            )
            it += 1
        n = climb(ra, rb, pa, pb, n)  # the last bracket may have been halved: finish quadratically
        return n

    @wp.func
    def sharpest(radii: V2):
        # smallest radius of curvature of an ellipse
        b = wp.min(radii[0], radii[1])
        return b * b / wp.max(wp.max(radii[0], radii[1]), TINY)

    @wp.func
    def unknown(ra: V2, rb: V2, pa: V4, pb: V4):
        return V2(ZERO, ZERO)

    def make_maximise(beyond: wp.Function) -> wp.Function:
        @wp.func
        def maximise(ra: V2, rb: V2, pa: V4, pb: V4, start: V2):
            # Chebyshev's third-order iteration: after a Newton step tau, what is left is of size tau^3
            n = start
            tau = dtype(1.0)
            top = ZERO - HUGE
            it = int(0)
            while wp.abs(tau) > CUBIC and it < LOCAL_ITERATIONS:
                e = evaluate(ra, rb, pa, pb, n)
                top = e[0] + ZERO  # at most the maximum that it climbs to
                tau = e[1] / wp.max(e[2], TINY)
                bend = HALF * e[3] / wp.max(e[2], TINY) * tau
                if wp.abs(tau) < CAP and wp.abs(bend) < HALF:
                    n = turn(n, tau * (ONE - bend))
                else:
                    n = turn(n, wp.clamp(tau, -CAP, CAP))
                it += 1
            if wp.abs(tau) <= CUBIC:
                if top > ZERO:
                    return n
                if top > -(sharpest(ra) + sharpest(rb)):
                    return n
            return wp.static(beyond)(ra, rb, pa, pb)

        return maximise

    return make_maximise(search), make_maximise(unknown)
