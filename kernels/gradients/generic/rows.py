"""The rows' part of an adjoint step: limits, noise levels, D, and all that moves a contact's shapes.

For every row: rho (J v' + d/h) - lambda J P + kappa (2 J m - m'N m), m = N^-1 J', at fixed rates; the rows of
a pair together are G of `touch.py`.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.contact import make_contact
from ...generic.derivatives.tables import Groups
from ...generic.motion.whole import make_whole
from ...generic.rows.overlaps import ROOM, STAYS
from ...generic.topology import BLOCK, CONTACT, LONG, LOWER, Topology
from ...generic.work import ROWS, WORK, Slot
from .dual import make_dual
from .motion import make_motion
from .room import DUAL, NEW, OLD, ROW, Room, View
from .touch import Sum, Touch, make_touch


@cached
def make_rows(given: type, residual: str, graded: bool) -> SimpleNamespace:
    """constraints(t, s, k, room, w): adds the rows' part."""
    hard = residual == "hard"
    dual, touch, motion = (
        make_dual(given, residual),
        make_touch(given, residual, graded),
        make_motion(given, graded),
    )
    move = motion.twists
    z = move.solved
    number, add = z.number, z.add
    contact, whole = make_contact(given, residual), make_whole(given)
    H, SIGMA, LOW, UP, FRICTION, RESTITUTION = (
        z.COLUMN[n] for n in ("step_size", "sigma", "lower", "upper", "friction", "restitution")
    )
    ZERO, TWO = WORK(0.0), WORK(2.0)

    @wp.func
    def bounce_of(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """The coefficient with which the pair of row r bounces in this step, else 0."""
        e = WORK(0.0)
        if t.bounces == 1:
            if t.row_kind[k.row[r]] == CONTACT:
                e = k.bounce[t.row_index[k.row[r]]]
        return e

    @wp.func
    def is_fixed(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """Whether what row r adds to J v' does not change with its gap."""
        if t.overlaps == 0:
            return False
        return k.fixed[k.row[r]] != 0

    @wp.func
    def level(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], r: int):
        """Adds the column of sigma and that of h through d/h; returns kappa, the weight of D."""
        if not (is_fixed(t, k, r) or bounce_of(t, k, r) > ZERO):
            add(t, w, H, 0, -w.rho[r] / number(t, k, H, 0) * k.gap[r])
        if wp.static(hard):
            return ZERO  # lambda is what it is, whatever D
        if t.overlaps == 1:
            if k.fixed[k.row[r]] == wp.static(STAYS):
                add(t, w, SIGMA, k.row[r], WORK(wp.static(ROOM)) * w.rho[r])
        push = -dual.along(t, k, w.p, r) / k.scale[r]
        # s = D lambda, and sigma ds/dsigma = s - z s', the same at z and at -z
        rise = k.lam[r] * k.scale[r] - k.z[r] * k.p[r]
        add(t, w, SIGMA, k.row[r], -rise * (push + w.rho[r]) / k.sigma[r])
        return wp.where(t.inertia_scaling == 1, push * k.lam[r], ZERO)

    @wp.func
    def group_of(t: wp.ref[Topology], s: wp.ref[Groups], i: int, side: int):
        """The groups of bodies that row i moves, -1: none."""
        if t.row_kind[i] != CONTACT:
            return wp.where(side == 0, s.dof_group[t.row_index[i]], -1)
        first = s.shape_group[t.pair_a[t.row_index[i]]]
        second = int(s.shape_group[t.pair_b[t.row_index[i]]])
        if second == first:
            second = -1
        return wp.where(side == 0, first, second)

    @wp.func(inline=False)
    def answer_of_row(t: wp.ref[Topology], s: wp.ref[Groups], k: wp.ref[Slot], w: wp.ref[View], r: int):
        """The twists of m, and no slopes by them."""
        dual.response(t, k, r)
        for side in range(2):
            group = group_of(t, s, k.row[r], side)
            if group >= 0:
                for at in range(s.group_start[group], s.group_start[group + 1]):
                    j = s.group_dof[at]
                    w.rates[wp.static(ROW) * t.nv + j] = k.move[t.dof_block[j]][t.dof_part[j]]
                for at in range(s.group_body_start[group], s.group_body_start[group + 1]):
                    body = s.group_body[at]
                    w.by_twist[wp.static(ROW) * t.nb + body] = wp.vec3d()
                    move.advance(t, k, w, wp.static(ROW), body)

    @wp.func(inline=False)
    def scaled(
        t: wp.ref[Topology], s: wp.ref[Groups], k: wp.ref[Slot], w: wp.ref[View], i: int,
        kappa: WORK,
    ):  # fmt: skip
        """Adds -kappa m'N m, and takes the slopes by m's twists down to the roots."""
        for side in range(2):
            group = group_of(t, s, i, side)
            if group >= 0:
                motion.row_part(t, s, k, w, group, kappa)
                start = s.group_body_start[group]
                count = s.group_body_start[group + 1] - start
                for back in range(count):
                    body = s.group_body[start + count - 1 - back]
                    move.pull(t, k, w, wp.static(ROW), body)

    @wp.func
    def limit(t: wp.ref[Topology], s: wp.ref[Groups], k: wp.ref[Slot], w: wp.ref[View], r: int):
        kappa = level(t, k, w, r)
        rate = wp.where(is_fixed(t, k, r), ZERO, w.rho[r] / number(t, k, H, 0))
        j = t.row_index[k.row[r]]
        if t.row_kind[k.row[r]] == LOWER:
            add(t, w, LOW, j, -rate)
            w.by_q[j] = w.by_q[j] + rate
        else:
            add(t, w, UP, j, rate)
            w.by_q[j] = w.by_q[j] - rate
        if kappa != ZERO:
            answer_of_row(t, s, k, w, r)
            scaled(t, s, k, w, k.row[r], kappa)

    @wp.func
    def shared(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], pair: int, g: Touch, start: int, end: int
    ):
        """The slope by mu of the impulses along t that the step has and the vertex has not."""
        more = WORK(0.0)
        for r in range(start, end):
            if k.acting[r] > 0:
                more -= WORK(t.row_sign[k.row[r]]) * (k.least[r] - k.lam[r])
        if more == ZERO:
            return ZERO
        return more * touch.slip(t, k, w, pair, g, wp.static(DUAL))

    @wp.func
    def pair_part(
        t: wp.ref[Topology],
        s: wp.ref[Groups],
        k: wp.ref[Slot],
        room: wp.ref[Room],
        w: wp.ref[View],
        pair: int,
        start: int,
        end: int,
    ):
        """The pair of rows start, ..., end - 1."""
        g = touch.touch(t, k, pair)
        mu = number(t, k, FRICTION, pair)
        y = Sum()
        gap = WORK(0.0)
        opens = WORK(0.0)  # weights of J_n and J_t by v', and of what friction adds
        slips = WORK(0.0)
        presses = WORK(0.0)  # the same by P
        rubs = WORK(0.0)
        for r in range(start, end):
            if k.acting[r] > 0:
                sign = WORK(t.row_sign[k.row[r]])
                kappa = level(t, k, w, r)
                if not is_fixed(t, k, r):
                    gap += w.rho[r]
                opens += w.rho[r]
                if w.slides[r] == 0:
                    slips += sign * w.rho[r]
                presses -= k.lam[r]
                rubs -= sign * k.lam[r]
                if kappa != ZERO:
                    twice = TWO * kappa
                    answer_of_row(t, s, k, w, r)
                    y = touch.include(
                        t, k, w, pair, g, wp.static(ROW), twice, twice * sign * mu, twice * sign, y
                    )
                    scaled(t, s, k, w, k.row[r], kappa)
        sets = int(2)  # a loop that is not unrolled
        for n in range(sets):
            by_v = n == 0
            set = wp.where(by_v, wp.static(NEW), wp.static(DUAL))
            along_t = wp.where(by_v, slips, rubs)
            y = touch.include(t, k, w, pair, g, set, wp.where(by_v, opens, presses), along_t * mu, along_t, y)
        bounce = bounce_of(t, k, start)
        if bounce > ZERO:  # J v' + e J_n v in place of d/h
            y = touch.include(t, k, w, pair, g, wp.static(OLD), bounce * gap, ZERO, ZERO, y)
            add(t, w, RESTITUTION, pair, gap * contact.normal_rate(t, k, pair, start, k.before, 0))
            gap = ZERO
        gap = gap / number(t, k, H, 0)
        by_friction = touch.settle(t, room.disc, k, w, pair, g, gap, y)
        if wp.static(hard):
            if t.coulomb == 1:  # mu moves no gap: what rows that depend on each other share stays as it is
                by_friction += shared(t, k, w, pair, g, start, end)
        add(t, w, FRICTION, pair, by_friction)

    @wp.func
    def constraints(
        t: wp.ref[Topology],
        s: wp.ref[Groups],
        k: wp.ref[Slot],
        room: wp.ref[Room],
        w: wp.ref[View],
    ):
        whole.exchange(t, k)  # of which rows' answers are
        r = int(0)
        while r < k.count[wp.static(ROWS)]:
            i = k.row[r]
            start = r + 0
            if t.row_kind[i] == wp.static(CONTACT):
                pair = t.row_index[i]
                acts = int(0)
                for _row in range(t.pair_row[pair + 1] - t.pair_row[pair]):
                    acts += k.acting[r]
                    r += 1
                if acts > 0:
                    pair_part(t, s, k, room, w, pair, start, r)
            else:
                if k.acting[r] > 0:
                    limit(t, s, k, w, r)
                r += 1
        whole.exchange(t, k)

    @wp.func
    def at_edge(t: wp.ref[Topology], k: wp.ref[Slot], pair: int):
        """1 where a pair is touched at the end of a side, whose slopes differ to both sides of it."""
        kind = t.pair_kind[pair]
        if kind == wp.static(LONG) or kind == wp.static(BLOCK):
            return wp.where(touch.touch(t, k, pair).flat == 2, 1, 0)
        return int(0)

    return SimpleNamespace(constraints=constraints, at_edge=at_edge)
