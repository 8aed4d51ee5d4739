"""Gaps and rows of the contact pairs and limits of any scene by its tables, and which pairs are near.

The formulas are those of `contact/rows.py`.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import COLD
from ..factories import cached
from ..residual.smoothing import make_smoothing
from ..structure import WORLD
from .broad.phase import make_broad
from .linear.matrix import make_matrix
from .motion.mechanism import COLUMN, make_mechanism
from .rows.bounces import make_bounces
from .rows.overlaps import make_overlaps
from .shapes import make_shapes
from .topology import CONTACT, LOWER, MOVES_A, MOVES_B, ROUND, RUNS_A, RUNS_B, TURN, Topology
from .work import BESIDE, LISTED, NEAR, ORDERS, V2, V3, V4, WORK, Island, Slot

ROUNDING = {wp.float64: 1e-14, wp.float32: 4e-7}  # of a gap [m], whatever the precision of the work

AFRESH, JOINING, AGAIN, ALL = 0, 1, 2, 3  # which pairs are looked at; AGAIN: none, all stays


@cached
def make_contact(given: type, residual: str) -> SimpleNamespace:
    """Warp functions that find the near pairs, fill their rows and choose those that can act."""
    dtype = WORK
    mech = make_mechanism(given)
    broad = make_broad(residual)
    ends = make_matrix().ends
    bounces, overlaps = make_bounces(given), make_overlaps(given, residual)
    number, column = mech.number, mech.column
    GEO = wp.types.vector(8, dtype)
    ZERO, ONE = dtype(0.0), dtype(1.0)
    TOUCHING, UNUSED = dtype(ROUNDING[given]), dtype(COLD)
    CUT = dtype(0.0 if residual == "hard" else make_smoothing(dtype, residual).cut)  # as in `acting.py`
    H, SIGMA, LOW, UP, FRICTION, RATIO = (
        COLUMN[n] for n in ("step_size", "sigma", "lower", "upper", "friction", "surface_ratio")
    )
    shapes = make_shapes(given)
    pose_a, pose_b, radii_a, radii_b = shapes.pose_a, shapes.pose_b, shapes.radii_a, shapes.radii_b
    geometry, bound = shapes.geometry, shapes.bound

    @wp.func
    def place_shapes(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Centre and axis of every shape in its body: once for all steps."""
        shapes.place_shapes(t, k)
        broad.measure(t, k)
        broad.list_all(t, k)

    @wp.func
    def moved(t: wp.ref[Topology], k: wp.ref[Slot], j: int, side: int, pa: V4, pb: V4, g: GEO):
        """The same by the motion of shapes on these sides."""
        if side == 0:
            return V2()
        if side == MOVES_A + MOVES_B:  # turns both as one
            return V2(ZERO, g[2])
        turns = t.dof_kind[j] == TURN
        if side == MOVES_A:
            c = column(t, k, j, pa[0], pa[1])
            n = V2(-(g[0] * c[0] + g[1] * c[1]), -(g[0] * c[1] - g[1] * c[0]))
            if turns:
                n += V2(g[4], -g[3])
            return n
        c = column(t, k, j, pb[0], pb[1])
        n = V2(g[0] * c[0] + g[1] * c[1], g[0] * c[1] - g[1] * c[0])
        if turns:
            n += V2(g[6], -g[5])
        return n

    @wp.func
    def running(t: wp.ref[Topology], k: wp.ref[Slot], pair: int, side: int):
        """How far the surfaces of a pair run by a unit of a degree of freedom on this side of it."""
        out = dtype(0.0)
        if (side & RUNS_A) != 0:
            out += number(t, k, RATIO, t.pair_a[pair])
        if (side & RUNS_B) != 0:
            out += number(t, k, RATIO, t.pair_b[pair])
        return out

    @wp.func
    def moved_by(t: wp.ref[Topology], k: wp.ref[Slot], pair: int, at: int, pa: V4, pb: V4, g: GEO):
        """(J_n, J_t) of a pair for a degree of freedom, entry `at` of those that move it."""
        j = t.pair_dof[at]
        side = t.pair_side[at]
        if side >= RUNS_A:  # a surface runs along t, seen from the other shape along -t
            n = moved(t, k, j, side & (MOVES_A + MOVES_B), pa, pb, g)
            return n - V2(ZERO, running(t, k, pair, side))
        return moved(t, k, j, side, pa, pb, g)

    @wp.func(inline=False)
    def chained_rows(
        t: wp.ref[Topology], k: wp.ref[Slot], pair: int, r: int, pa: V4, pb: V4, g: GEO, mu: dtype
    ):
        """J_n +- mu J_t, or J_n alone, of any pair, the first of its rows being r."""
        rows = t.pair_row[pair + 1] - t.pair_row[pair]
        for at in range(k.entry[r], k.entry[r + rows]):
            k.jac[at] = V3()
        for at in range(t.pair_start[pair], t.pair_start[pair + 1]):
            j = t.pair_dof[at]
            n = moved_by(t, k, pair, at, pa, pb, g)
            for i in range(rows):
                sign = dtype(t.row_sign[k.row[r + i]])
                k.jac[k.entry[r + i] + t.pair_entry[at]][t.dof_part[j]] = n[0] + sign * mu * n[1]

    @wp.func
    def free_rows(t: wp.ref[Topology], k: wp.ref[Slot], pair: int, r: int, pa: V4, pb: V4, g: GEO, mu: dtype):
        """The same where every body is free in the world."""
        for side in range(2):
            at = t.pair_free[2 * pair + side]
            if at >= 0:
                p = pa
                sign = -ONE
                lever = g[4]
                rise = g[3]
                shape = t.pair_a[pair]
                if side == 1:
                    p = pb
                    sign = ONE
                    lever = g[6]
                    rise = g[5]
                    shape = t.pair_b[pair]
                f = k.frame[t.shape_body[shape]]
                cx = f[3] - p[1]
                cy = p[0] - f[2]
                turn_n = sign * (g[0] * cx + g[1] * cy) + lever
                turn_t = sign * (g[0] * cy - g[1] * cx) - rise
                normal = V3(sign * g[0], sign * g[1], turn_n)
                tangent = mu * V3(-sign * g[1], sign * g[0], turn_t)
                for i in range(r, r + t.pair_row[pair + 1] - t.pair_row[pair]):
                    k.jac[k.entry[i] + at] = normal + dtype(t.row_sign[k.row[i]]) * tangent

    @wp.func
    def limit_gap(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """How far a degree of freedom is from its limit i."""
        j = t.row_index[i]
        if t.row_kind[i] == LOWER:
            return k.q[j] - number(t, k, LOW, j)
        return number(t, k, UP, j) - k.q[j]

    @wp.func
    def row_gap(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """The signed distance that row r has, at the start of the step."""
        i = k.row[r]
        if t.overlaps == 1:
            return k.apart[i]
        if t.row_kind[i] == wp.static(CONTACT):
            other = int(k.count[wp.static(BESIDE)])  # than what the row holds
            if t.bounces == 1:
                if k.bounce[t.row_index[i]] > ZERO:
                    other = 1
            if other > 0:
                _nx, _ny, gap, _ha, _turn_a, _hb, _turn_b = geometry(t, k, t.row_index[i])
                return gap
        return k.gap[r] * number(t, k, H, 0)

    @wp.func(inline=False)
    def fill(t: wp.ref[Topology], k: wp.ref[Slot], start: int, end: int, rub: dtype):
        """d/h and J of rows; rub = 1, or 0 to leave friction out. Nothing lifts them."""
        h = number(t, k, H, 0)
        r = int(start)
        while r < end:
            i = k.row[r]
            if t.row_kind[i] == wp.static(CONTACT):
                pair = t.row_index[i]
                nx, ny, gap, ha, turn_a, hb, turn_b = geometry(t, k, pair)
                g = GEO(nx, ny, gap, ha, turn_a, hb, turn_b, ZERO)
                pa = pose_a(t, k, pair)
                pb = pose_b(t, k, pair)
                mu = rub * number(t, k, FRICTION, pair)
                if t.pair_free[2 * pair] > -2 and t.pair_free[2 * pair + 1] > -2:
                    free_rows(t, k, pair, r, pa, pb, g, mu)
                else:
                    chained_rows(t, k, pair, r, pa, pb, g, mu)
                most = overlaps.limited(t, gap / h)
                rate = most + ZERO
                bounce = ZERO + ZERO
                if t.bounces == 1:
                    rate = bounces.bounced(t, k, pair, r, rate)
                    bounce = wp.max(k.bounce[pair], ZERO)
                beside = ZERO + ZERO
                if k.count[wp.static(BESIDE)] > 0:
                    beside += k.beside[pair]
                for _same in range(t.pair_row[pair + 1] - t.pair_row[pair]):
                    k.gap[r] = rate + beside
                    if t.overlaps == 1 and bounce > ZERO:
                        k.apart[k.row[r]] = gap
                        k.fixed[k.row[r]] = 0
                    elif t.overlaps == 1:
                        k.gap[r] = overlaps.eased(t, k, r, gap, most > gap / h, rate) + beside
                    r += 1
            else:
                j = t.row_index[i]
                k.jac[k.entry[r]] = V3()
                k.jac[k.entry[r]][t.dof_part[j]] = dtype(t.row_sign[i])
                open = limit_gap(t, k, i)
                rate = overlaps.limited(t, open / h)
                k.gap[r] = rate
                if t.overlaps == 1:
                    k.gap[r] = overlaps.eased(t, k, r, open, rate > open / h, rate)
                r += 1
        for i in range(start, end):
            k.rate[i] = k.gap[i]
            k.sigma[i] = number(t, k, SIGMA, k.row[i])
            k.lift[i] = ZERO

    @wp.func
    def touch(t: wp.ref[Topology], k: wp.ref[Slot], start: int, end: int):
        """What enters by the rounding of a gap touches; z of rows that were others is far from theirs."""
        touching = TOUCHING / number(t, k, H, 0)
        for r in range(start, end):
            if t.row_kind[k.row[r]] == wp.static(CONTACT):
                if wp.abs(k.gap[r]) <= touching and k.count[wp.static(BESIDE)] == 0:
                    k.gap[r] = ZERO
                k.rate[r] = k.gap[r]
                k.z[r] = UNUSED
                k.acting[r] = wp.min(k.acting[r], 1)

    @wp.func
    def at_point(t: wp.ref[Topology], k: wp.ref[Slot], shape: int, p: V4):
        """Velocity of a point of a shape's body, and its rate of turning."""
        body = t.shape_body[shape]
        if body == WORLD:
            return V3()
        f = k.frame[body]
        w = k.twist[body]
        return V3(w[0] - w[2] * (p[1] - f[3]), w[1] + w[2] * (p[0] - f[2]), w[2])

    @wp.func
    def least_rate(t: wp.ref[Topology], k: wp.ref[Slot], pair: int):
        """A lower bound of J v' + d/h - cut sigma of a pair's rows at k.twist."""
        pa = pose_a(t, k, pair)
        pb = pose_b(t, k, pair)
        ra = radii_a(t, k, pair)
        rb = radii_b(t, k, pair)
        gap = bound(t, k, pair, ra, rb, pa, pb)
        spread_a = wp.max(rb[0], rb[1])
        va = V3()
        if t.pair_kind[pair] == ROUND:
            spread_a = wp.max(ra[0], ra[1])
            va = at_point(t, k, t.pair_a[pair], pa)
        else:  # A's touched point is as far from B's centre as B is thick, and the gap
            spread_a += wp.abs(gap)
            va = at_point(t, k, t.pair_a[pair], pb)
        vb = at_point(t, k, t.pair_b[pair], pb)
        dx = vb[0] - va[0]
        dy = vb[1] - va[1]
        mu = number(t, k, FRICTION, pair)
        turn = wp.abs(va[2]) * spread_a + wp.abs(vb[2]) * wp.max(rb[0], rb[1])
        speed = wp.sqrt(ONE + mu * mu) * (wp.sqrt(dx * dx + dy * dy) + turn)
        if t.columns[wp.static(RATIO)] >= 0:
            for at in range(t.pair_start[pair], t.pair_start[pair + 1]):
                j = t.pair_dof[at]
                run = running(t, k, pair, t.pair_side[at])
                speed += mu * wp.abs(run * k.v[t.dof_block[j]][t.dof_part[j]])
        sigma = number(t, k, SIGMA, t.pair_row[pair])
        for i in range(t.pair_row[pair] + 1, t.pair_row[pair + 1]):
            sigma = wp.max(sigma, number(t, k, SIGMA, i))
        return gap / number(t, k, H, 0) - speed - CUT * sigma

    @wp.func
    def approach(t: wp.ref[Topology], k: wp.ref[Slot], fresh: bool):
        """k.weight of the listed pairs, of all (fresh) or of those that are not near: d/h less what they can
        approach by; the largest approach.
        """
        margin = dtype(0.0)
        for n in range(k.count[wp.static(LISTED)]):
            pair = k.listed[n]
            if fresh or k.known[pair] == 0:
                k.weight[pair] = least_rate(t, k, pair)
                margin = wp.max(margin, -k.weight[pair])
        return margin

    @wp.func(inline=False)
    def look(t: wp.ref[Topology], k: wp.ref[Slot], which: int):
        """The near pairs at velocity k.v AFRESH (with those within reach of the largest approach: in a heap
        they act next), those that are JOINING them, or ALL others. 1 if their list has changed.
        """
        fresh = which == wp.static(AFRESH)
        if which == wp.static(AGAIN):
            return 0
        if not fresh and t.items == 0 and k.count[wp.static(NEAR)] == t.pairs:
            return 0
        mech.twists(t, k)
        if t.items > 0 and fresh:
            broad.start(t, k)
        if which == wp.static(ALL):
            broad.list_all(t, k)
        margin = dtype(0.0)
        for again in range(wp.where(t.items > 0 and fresh, 2, 1)):
            new = int(1)
            if t.items > 0 and which != wp.static(ALL):
                new = broad.find(t, k, margin)
            if again == 0 or new == 1:
                largest = approach(t, k, fresh)
                if again == 0 and fresh:
                    margin = largest
        found = int(0)
        kept = int(0)
        for n in range(k.count[wp.static(LISTED)]):
            pair = k.listed[n]
            if fresh or k.known[pair] == 0:
                if which == wp.static(ALL) or not (k.weight[pair] > margin):
                    k.sorted[found] = pair
                    found += 1
                    kept += k.known[pair]
        old = k.count[wp.static(NEAR)]
        if fresh:
            if found == old and kept == old and k.count[wp.static(ORDERS)] > 0:
                return 0
            for n in range(old):
                k.known[k.near[n]] = 0
            old = 0
        elif found == 0:
            return 0
        for n in range(found):
            k.near[old + n] = k.sorted[n]
            k.known[k.sorted[n]] = 1
        k.count[wp.static(NEAR)] = old + found
        return 1

    @wp.func
    def velocity(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """J_r v'."""
        out = dtype(0.0)
        at = k.pattern[r]
        for e in range(k.entry[r], k.entry[r + 1]):
            out += wp.dot(k.jac[e], k.v[t.row_block[at]])
            at += 1
        return out

    @wp.func
    def measure(t: wp.ref[Topology], k: wp.ref[Slot], g: int):
        """k.w of a group's rows that do not act: J v' + d/h."""
        start, end, entry, entries, one, two = ends(t, k, g)
        v = k.v[one]
        u = V3()
        if entries == 2:
            u = k.v[two]
        at = entry + 0
        for r in range(start, end):
            if k.acting[r] == 0:
                if entries <= 2:
                    k.w[r] = k.rate[r] + (wp.dot(k.jac[at], v) + wp.dot(k.jac[at + entries - 1], u))
                else:
                    k.w[r] = k.rate[r] + velocity(t, k, r)
            at += entries

    @wp.func(inline=False)
    def grow(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, margin: dtype, known: int):
        """Add the rows that k.v lets act (or comes within `margin` of it); their number and the largest
        approach. k.w of what does not act is J v' + d/h: it may be known from the last time.
        """
        added = int(0)
        approach = dtype(0.0)
        if known == 0:
            for g in range(o.group, o.last_group):
                measure(t, k, g)
        for r in range(o.row, o.last_row):
            if k.acting[r] == 0:
                w = k.w[r]
                approach = wp.where(-w > approach, -w, approach)
                if not (w > CUT * k.sigma[r] + margin):
                    k.acting[r] = 1
                    added += 1
        return added, approach

    return SimpleNamespace(
        place_shapes=place_shapes,
        move_shapes=shapes.move_shapes,
        look=look,
        fill=fill,
        touch=touch,
        grow=grow,
        velocity=velocity,
        geometry=geometry,
        moved_by=moved_by,
        normal_rate=bounces.normal_rate,
        row_gap=row_gap,
        forget_bounces=bounces.forget,
        give_up_bounces=bounces.give_up,
        allow_bounces=bounces.allow,
        overlaps=overlaps,
        pose_a=pose_a,
        pose_b=pose_b,
        radii_a=radii_a,
        radii_b=radii_b,
        size=shapes.size,
    )
