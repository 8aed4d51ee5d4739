"""Gaps and rows of the contact pairs and limits of any scene by its tables.

The formulas are those of `contact/rows.py`.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.distance import make_distance
from ..contact.problem import COLD
from ..contact.shapes import make_upright
from ..factories import cached
from ..residual.smoothing import make_smoothing
from ..structure import CAPSULE, DISC, ELLIPSE, HALFPLANE, WORLD
from .mechanism import COLUMN, make_mechanism
from .topology import CONTACT, LONG, LOWER, MOVES_A, MOVES_B, PLANE, TURN, Topology
from .work import WORK, Work

ROUNDING = {wp.float64: 1e-14, wp.float32: 4e-7}  # of a gap [m], whatever the precision of the work


@cached
def make_contact(given: type, residual: str) -> SimpleNamespace:
    """Warp functions that fill k.rate and k.jac and choose the rows that can act."""
    dtype = WORK
    mech = make_mechanism(given)
    number, column = mech.number, mech.column
    V2, V4, GEO = wp.types.vector(2, dtype), wp.types.vector(4, dtype), wp.types.vector(8, dtype)
    ZERO, ONE, TOUCHING, UNUSED = dtype(0.0), dtype(1.0), dtype(ROUNDING[given]), dtype(COLD)
    CUT = dtype(0.0 if residual == "hard" else make_smoothing(dtype, residual).cut)  # as in `acting.py`
    H, SIGMA, LOW, UP, FRICTION, RADIUS, OFFSET, TURNED = (
        COLUMN[n]
        for n in ("step_size", "sigma", "lower", "upper", "friction", "radius", "shape_offset", "shape_angle")
    )
    upright = make_upright(dtype)
    long_distance = make_distance(CAPSULE, DISC, dtype)
    plane_distance = make_distance(HALFPLANE, ELLIPSE, dtype)
    round_distance = make_distance(ELLIPSE, ELLIPSE, dtype)

    @wp.func
    def pose(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, shape: int, end: int):
        """Centre and axis of a shape, or of the disc at an end of a capsule."""
        x = number(t, params, row, OFFSET, 2 * shape)
        y = number(t, params, row, OFFSET, 2 * shape + 1)
        ex = ONE
        ey = ZERO
        if t.shape_turned[shape] == 1:
            angle = number(t, params, row, TURNED, shape)
            ex = upright(wp.cos(angle))
            ey = upright(wp.sin(angle))
        if end != 0:
            reach = dtype(end) * number(t, params, row, RADIUS, 2 * shape + 1)
            x += reach * ex
            y += reach * ey
        body = t.shape_body[shape]
        if body == WORLD:
            return V4(x, y, ex, ey)
        c = k.frame[4 * body, b]
        sn = k.frame[4 * body + 1, b]
        px = k.frame[4 * body + 2, b] + c * x - sn * y
        py = k.frame[4 * body + 3, b] + sn * x + c * y
        return V4(px, py, c * ex - sn * ey, sn * ex + c * ey)

    @wp.func
    def radii(t: Topology, params: wp.array2d(dtype=given), row: int, shape: int, end: int):
        r = number(t, params, row, RADIUS, 2 * shape)
        if end != 0:
            return V2(r, r)
        return V2(r, number(t, params, row, RADIUS, 2 * shape + 1))

    @wp.func
    def pose_a(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, pair: int):
        return pose(t, k, params, row, b, t.pair_a[pair], t.pair_ends[2 * pair])

    @wp.func
    def pose_b(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, pair: int):
        return pose(t, k, params, row, b, t.pair_b[pair], t.pair_ends[2 * pair + 1])

    @wp.func
    def radii_a(t: Topology, params: wp.array2d(dtype=given), row: int, pair: int):
        return radii(t, params, row, t.pair_a[pair], t.pair_ends[2 * pair])

    @wp.func
    def radii_b(t: Topology, params: wp.array2d(dtype=given), row: int, pair: int):
        return radii(t, params, row, t.pair_b[pair], t.pair_ends[2 * pair + 1])

    @wp.func
    def geometry(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, pair: int):
        """GEO of a pair; the search starts at the last normal, which it replaces."""
        pa = pose_a(t, k, params, row, b, pair)
        pb = pose_b(t, k, params, row, b, pair)
        ra = radii_a(t, params, row, pair)
        rb = radii_b(t, params, row, pair)
        g = GEO()
        if t.pair_kind[pair] == PLANE:
            g = plane_distance.geometry(ra, rb, pa, pb, V2())
        elif t.pair_kind[pair] == LONG:
            g = long_distance.geometry(ra, rb, pa, pb, V2())
        else:
            g = round_distance.geometry(ra, rb, pa, pb, V2(k.normal[2 * pair, b], k.normal[2 * pair + 1, b]))
        k.normal[2 * pair, b] = g[0]
        k.normal[2 * pair + 1, b] = g[1]
        return g

    @wp.func
    def pair_rows(
        t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, pair: int, g: GEO, rub: dtype
    ):
        """J_n +- mu J_t, or J_n alone, of a pair; rub = 1, or 0 to leave friction out."""
        pa = pose_a(t, k, params, row, b, pair)
        pb = pose_b(t, k, params, row, b, pair)
        mu = rub * number(t, params, row, FRICTION, pair)
        begin = t.pair_row[pair]
        end = t.pair_row[pair + 1]
        start = t.pair_start[pair]
        for at in range(start, t.pair_start[pair + 1]):
            j = t.pair_dof[at]
            side = t.pair_side[at]
            turns = t.dof_kind[j] == TURN
            normal = dtype(0.0)
            tangent = dtype(0.0)
            if side == MOVES_A + MOVES_B:  # turns both as one
                tangent = g[2]
            elif side == MOVES_A:
                c = column(t, k, params, row, b, j, pa[0], pa[1])
                normal -= g[0] * c[0] + g[1] * c[1]
                tangent -= g[0] * c[1] - g[1] * c[0]
                if turns:
                    normal += g[4]
                    tangent -= g[3]
            else:
                c = column(t, k, params, row, b, j, pb[0], pb[1])
                normal += g[0] * c[0] + g[1] * c[1]
                tangent += g[0] * c[1] - g[1] * c[0]
                if turns:
                    normal += g[6]
                    tangent -= g[5]
            for i in range(begin, end):
                k.jac[t.row_start[i] + at - start, b] = normal + dtype(t.row_sign[i]) * mu * tangent

    @wp.func
    def near(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, pair: int):
        """Whether a pair can act at velocity k.v, from a lower bound of d and a bound on its approach."""
        if t.pair_exact[pair] == 1:
            return True
        pa = pose_a(t, k, params, row, b, pair)
        pb = pose_b(t, k, params, row, b, pair)
        ra = radii_a(t, params, row, pair)
        rb = radii_b(t, params, row, pair)
        dx = dtype(0.0)
        dy = dtype(0.0)
        wa = dtype(0.0)
        wb = dtype(0.0)
        for at in range(t.pair_start[pair], t.pair_start[pair + 1]):
            j = t.pair_dof[at]
            v = k.v[t.place[j], b]
            turns = t.dof_kind[j] == TURN
            if (t.pair_side[at] & MOVES_A) != 0:
                c = column(t, k, params, row, b, j, pa[0], pa[1])
                dx -= c[0] * v
                dy -= c[1] * v
                if turns:
                    wa += v
            if (t.pair_side[at] & MOVES_B) != 0:
                c = column(t, k, params, row, b, j, pb[0], pb[1])
                dx += c[0] * v
                dy += c[1] * v
                if turns:
                    wb += v
        mu = number(t, params, row, FRICTION, pair)
        reach = wp.abs(wa) * wp.max(ra[0], ra[1]) + wp.abs(wb) * wp.max(rb[0], rb[1])
        speed = wp.sqrt(ONE + mu * mu) * (wp.sqrt(dx * dx + dy * dy) + reach)
        gap = round_distance.bound(ra, rb, pa, pb) / number(t, params, row, H, 0)
        return not (gap - speed > CUT * number(t, params, row, SIGMA, t.pair_row[pair]))

    @wp.func
    def velocity(t: Topology, k: Work, b: int, i: int):
        """J_i v'."""
        out = dtype(0.0)
        for at in range(t.row_start[i], t.row_start[i + 1]):
            out += k.jac[at, b] * k.v[t.row_place[at], b]
        return out

    @wp.func
    def start(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int):
        """No row acts; d/h and J of the limits."""
        h = number(t, params, row, H, 0)
        for i in range(t.nr):
            k.acting[i, b] = 0
            k.lam[i, b] = ZERO
            k.rate[i, b] = ZERO
            if t.row_kind[i] != CONTACT:
                j = t.row_index[i]
                k.jac[t.row_start[i], b] = dtype(t.row_sign[i])
                if t.row_kind[i] == LOWER:
                    k.rate[i, b] = (k.q[j, b] - number(t, params, row, LOW, j)) / h
                else:
                    k.rate[i, b] = (number(t, params, row, UP, j) - k.q[j, b]) / h
            k.gap[i, b] = k.rate[i, b]
        for pair in range(t.pairs):
            k.known[pair, b] = 0
            k.lift[pair, b] = ZERO
            k.miss[pair, b] = ZERO
            k.target[pair, b] = ZERO

    @wp.func
    def set_friction(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, rub: dtype):
        """The rows of all pairs at hand anew, with friction (rub = 1) or without (0), and without a lift;
        what enters by the rounding of a gap touches.
        """
        touching = TOUCHING / number(t, params, row, H, 0)
        for pair in range(t.pairs):
            k.lift[pair, b] = ZERO
            if k.known[pair, b] == 1:
                g = geometry(t, k, params, row, b, pair)
                pair_rows(t, k, params, row, b, pair, g, rub)
                for i in range(t.pair_row[pair], t.pair_row[pair + 1]):
                    if wp.abs(k.gap[i, b]) <= touching:
                        k.gap[i, b] = ZERO
                    k.rate[i, b] = k.gap[i, b]
                    k.z[i, b] = UNUSED  # what the other rows had is far from what these have
                    k.acting[i, b] = wp.min(k.acting[i, b], 1)

    @wp.func
    def grow(
        t: Topology,
        k: Work,
        params: wp.array2d(dtype=given),
        row: int,
        b: int,
        exact_gap: int,
        margin: dtype,
        rub: dtype,
    ):
        """Add the rows that k.v lets act (or comes within `margin` of it); their number and the largest
        approach. `rub` as in `pair_rows`.
        """
        h = number(t, params, row, H, 0)
        for pair in range(t.pairs):
            if k.known[pair, b] == 0:
                if exact_gap == 1 or near(t, k, params, row, b, pair):
                    k.known[pair, b] = 1
                    g = geometry(t, k, params, row, b, pair)
                    pair_rows(t, k, params, row, b, pair, g, rub)
                    for i in range(t.pair_row[pair], t.pair_row[pair + 1]):
                        k.gap[i, b] = g[2] / h
                        k.rate[i, b] = g[2] / h
        added = int(0)
        approach = dtype(0.0)
        for i in range(t.nr):
            if k.acting[i, b] == 0:
                present = t.row_kind[i] != CONTACT
                if not present:
                    present = k.known[t.row_index[i], b] == 1
                if present:
                    w = velocity(t, k, b, i) + k.rate[i, b]
                    approach = wp.max(approach, -w)
                    if not (w > CUT * number(t, params, row, SIGMA, i) + margin):
                        k.acting[i, b] = 1
                        added += 1
        return added, approach

    return SimpleNamespace(
        start=start,
        grow=grow,
        set_friction=set_friction,
        velocity=velocity,
        pose_a=pose_a,
        pose_b=pose_b,
        radii_a=radii_a,
        radii_b=radii_b,
    )
