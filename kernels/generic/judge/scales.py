"""What the data of a step set: diag(A) and D of an island's rows, and the sizes that they are judged by."""

import warp as wp

from ...factories import cached
from ..motion.whole import make_whole
from ..newton import make_newton
from ..topology import CONTACT, Topology
from ..work import M33, V3, WORK, Island, Slot

DIFFERENT = 1e5  # velocities, relative to those of a row in which no more than their rounding counts
TOUCHING = 1e-10  # of what is stopped beside it: less than that is no opening to the accuracy promised
REACHES = 8  # passes, in which what is stopped reaches further bodies


@wp.func
def gather(t: wp.ref[Topology], k: wp.ref[Slot], entry: int, end: int, pattern: int, u: int):
    """The entries of a row in unit u, from `entry` on, into k.move; where the next unit's begin."""
    for j in range(t.unit_start[u], t.unit_start[u + 1]):
        k.move[j] = V3()
    e = int(entry)
    at = int(pattern)
    more = int(1)
    while more == 1:
        k.move[t.row_block[at]] = k.jac[e]
        e += 1
        at += 1
        more = int(0)
        if e < end:
            more = wp.where(t.block_unit[t.row_block[at]] == u, 1, 0)
    return e, at


@cached
def make_scales(given: type, residual: str) -> wp.Function:
    """scales(t, k, o) -> the size of velocities in an island, and the number of its acting rows."""
    dtype = WORK
    nt, whole = make_newton(given, residual), make_whole(given)
    hard = residual == "hard"
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    UNLIKE, TOUCHES, FAR = dtype(DIFFERENT), dtype(TOUCHING), dtype(1e300)
    LOST, FLOOR, TINY, MOST = nt.LOST, dtype(1e-30), dtype(1e-30), dtype(1e300)

    @wp.func
    def name_of(k: wp.ref[Slot], u: int):
        """The unit after which what unit u hangs together with is named."""
        name = int(u)
        while k.queue[name] != name:
            k.queue[name] = k.queue[k.queue[name]]
            name = k.queue[name]
        return name

    @wp.func
    def join(t: wp.ref[Topology], k: wp.ref[Slot], one: int, two: int):
        """What two blocks hang together with has one name."""
        first = name_of(k, t.block_unit[one])
        other = name_of(k, t.block_unit[two])
        k.queue[wp.max(first, other)] = wp.min(first, other)

    @wp.func
    def lend(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.move of a name's first block: the largest of what v_free closes (k.dz of a group's first row),
        and last the largest impulse of such rows by themselves.
        """
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        for g in range(o.group, o.last_group):
            start = k.group[g]
            closes = k.dz[start]
            if closes > ZERO:
                b = t.unit_start[name_of(k, t.block_unit[t.row_block[k.pattern[start]]])]
                brings = k.move[b][2]
                for r in range(start, k.group[g + 1]):
                    if k.acting[r] > 0:
                        brings = wp.max(brings, k.alone[r])
                k.move[b] = V3(wp.max(k.move[b][0], closes), ZERO, brings)

    @wp.func(inline=False)
    def reach(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.move[.][1] of a name's first block: what is stopped behind contacts that v_free leaves open by
        less. It may shut them, as where a spinning disc is driven against what nothing else moves. What
        is open by nothing beside that passes it on, as in a row of balls: the two have one name.
        """
        further = int(1)
        passes = int(0)
        while further == 1 and passes < wp.static(REACHES):
            passes += 1
            further = int(0)
            joined = int(0)
            for g in range(o.group, o.last_group):
                start, _end, _entry, _entries, one, two = nt.ends(t, k, g)
                first = t.unit_start[name_of(k, t.block_unit[one])]
                other = t.unit_start[name_of(k, t.block_unit[two])]
                if first != other and k.dz[start] <= ZERO:
                    here = wp.max(k.move[first][0], k.move[first][1])
                    there = wp.max(k.move[other][0], k.move[other][1])
                    moves = wp.max(here, there)
                    most = wp.max(k.move[first][0], k.move[other][0])
                    if most > ZERO and -k.dz[start] <= TOUCHES * most:
                        joined = int(1)
                        join(t, k, one, two)
                        brings = wp.max(k.move[first][2], k.move[other][2])
                        k.move[wp.min(first, other)] = V3(most, moves, brings)
                        further = int(1)
                    elif -k.dz[start] < moves and (here < moves or there < moves):
                        k.move[first] = V3(k.move[first][0], moves, k.move[first][2])
                        k.move[other] = V3(k.move[other][0], moves, k.move[other][2])
                        further = int(1)
            passes -= joined  # of names there are so many

    @wp.func
    def share_units(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, differ: bool):
        """k.unit, from what v_free closes and a row's own terms, and k.passed: rows of bodies that neither
        hang together nor touch are no measure of each other. Of what may shut a contact, where sizes
        `differ`, its rounding counts.
        """
        lend(t, k, o)
        if wp.static(hard):
            if differ:
                reach(t, k, o)
        for g in range(o.group, o.last_group):
            start = k.group[g]
            shared = k.move[t.unit_start[name_of(k, t.block_unit[t.row_block[k.pattern[start]]])]]
            lent = wp.max(shared[0], shared[1] / UNLIKE)
            for r in range(start, k.group[g + 1]):
                if k.acting[r] > 0:
                    k.unit[r] = wp.where(lent > k.own[r], lent, k.own[r]) + TINY
                    k.passed[r] = shared[2]

    @wp.func
    def bounds(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype, largest: dtype):
        """k.most: what rows (in k.most the sums of |J|) allow of M (v' - v_free) that press no harder than
        `largest`, the impulse that stops the heavier side of one, in an island of speeds `size`; k.unseen.
        """
        for place in range(o.start, o.end):
            i = k.block[place]
            own = size * wp.get_diag(k.mass[t.mass_at[i] + i])
            k.most[i] = own + largest * k.most[i]
            k.unseen[i] = LOST * own

    @wp.func(inline=False)
    def own_impulse(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """diag(A) of row r, and the least part of it that a side has: 1/mass of the heaviest."""
        value = dtype(0.0)
        least = ZERO + MOST
        e = k.entry[r]
        at = k.pattern[r]
        end = k.entry[r + 1]
        while e < end:
            b = t.row_block[at]
            u = t.block_unit[b]
            part = dtype(0.0)
            if t.unit_start[u + 1] - t.unit_start[u] == 1:
                y = k.mass_factor[t.mass_at[b] + b] * k.jac[e]
                part = wp.dot(y, y)
                e += 1
                at += 1
            else:
                e, at = gather(t, k, e, end, at, u)
                start = t.unit_start[u]
                last = t.unit_start[u + 1]
                nt.env.forward(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, start, last)
                for j in range(start, last):
                    part += wp.dot(k.move[j], k.move[j])
            value += part
            if part > FLOOR:
                least = wp.min(least, part)
        return value, least

    @wp.func
    def spread(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """J v_free of a row and the size of its terms; |J| is added to k.most."""
        w = dtype(0.0)
        terms = dtype(0.0)
        at = k.pattern[r]
        for e in range(k.entry[r], k.entry[r + 1]):
            b = t.row_block[at]
            change = wp.cw_mul(k.jac[e], k.vfree[b])
            w += change[0] + change[1] + change[2]
            terms += wp.abs(change[0]) + wp.abs(change[1]) + wp.abs(change[2])
            k.most[b] = k.most[b] + wp.abs(k.jac[e])
            at += 1
        return w, terms

    @wp.func
    def pressed(f: M33, j: V3):
        """|f j|^2 of a lower triangle f"""
        x = f[0, 0] * j[0]
        y = f[1, 0] * j[0] + f[1, 1] * j[1]
        z = f[2, 0] * j[0] + f[2, 1] * j[1] + f[2, 2] * j[2]
        return x * x + y * y + z * z

    @wp.func
    def is_whole(t: wp.ref[Topology], b: int):
        """Whether a block is all of its unit."""
        u = t.block_unit[b]
        return t.unit_start[u + 1] - t.unit_start[u] == 1

    @wp.func
    def keep(k: wp.ref[Slot], r: int, value: dtype, w: dtype, sum: dtype):
        """What is known of a row from diag(A), w = J v_free + d/h and the sum of its terms' sizes; that
        of all terms.
        """
        diag = wp.max(value, FLOOR)
        inverse = ONE / diag
        k.diag[r] = diag
        k.inverse[r] = inverse
        terms = sum + wp.abs(w)
        alone = wp.where(w < ZERO, -w, ZERO)
        if wp.static(not hard):
            terms += k.sigma[r]
            alone += k.sigma[r]
        k.alone[r] = wp.where(value > FLOOR, alone * inverse, ZERO)
        k.own[r] = terms
        return terms

    @wp.func
    def closing(
        t: wp.ref[Topology], k: wp.ref[Slot], r: int, w: dtype, terms: dtype, last: dtype, other: dtype
    ):
        """The size of terms that row r, whose w at v_free is below zero, lends others; of one that opens -w.
        Under Coulomb's law a contact closes where w_n does, the mean of its rows' w (the first's is `last`,
        its terms `other`): where it slides fast J_n +- mu J_t alone is no approach.
        """
        if t.coulomb == 1 and t.row_kind[k.row[r]] == CONTACT and t.row_sign[k.row[r]] != 0:
            if t.row_sign[k.row[r]] > 0:
                return -FAR
            if last + w >= ZERO:
                return -HALF * (last + w)
            return wp.max(wp.where(w < ZERO, terms, ZERO), wp.where(last < ZERO, other, ZERO))
        return wp.where(w < ZERO, terms, -w)

    @wp.func
    def of_two(t: wp.ref[Topology], k: wp.ref[Slot], g: int):
        """The rows of a group on one block or two that are whole units: the largest size of terms, their sum,
        the largest size of what closes and the least 1/mass.
        """
        start, end, entry, entries, one, two = nt.ends(t, k, g)
        f = k.mass_factor[t.mass_at[one] + one]
        h = k.mass_factor[t.mass_at[two] + two]
        v = k.vfree[one]
        u = k.vfree[two]
        if entries == 1:
            h = M33()
            u = V3()
        x, y, z = dtype(0.0), dtype(0.0), dtype(0.0)
        p, q, s = dtype(0.0), dtype(0.0), dtype(0.0)
        size, sum, closes = dtype(0.0), dtype(0.0), ZERO - FAR
        last, other = dtype(0.0), dtype(0.0)  # w and terms of the row before
        lightest = ZERO + MOST
        at = entry + 0
        for r in range(start, end):
            if k.acting[r] > 0:
                j = k.jac[at]
                m = k.jac[at + entries - 1]
                value = pressed(f, j)
                second = pressed(h, m)
                least = wp.where(value > FLOOR, value, MOST)
                least = wp.where(second > FLOOR and second < least, second, least)
                lightest = wp.where(least < lightest, least, lightest)
                a = wp.cw_mul(j, v)
                b = wp.cw_mul(m, u)
                w = k.rate[r] + (a[0] + a[1] + a[2]) + (b[0] + b[1] + b[2])
                a = wp.abs(a) + wp.abs(b)
                terms = keep(k, r, value + second, w, wp.abs(k.rate[r]) + a[0] + a[1] + a[2])
                closes = wp.max(closes, closing(t, k, r, w, terms, last, other))
                last = w + ZERO
                other = terms + ZERO
                size = wp.where(terms > size, terms, size)
                sum += terms
                x += wp.abs(j[0])
                y += wp.abs(j[1])
                z += wp.abs(j[2])
                p += wp.abs(m[0])
                q += wp.abs(m[1])
                s += wp.abs(m[2])
            at += entries
        k.most[one] = k.most[one] + V3(x, y, z)
        if entries == 2:
            k.most[two] = k.most[two] + V3(p, q, s)
        return size, sum, closes, lightest

    @wp.func(inline=False)
    def of_many(t: wp.ref[Topology], k: wp.ref[Slot], g: int):
        """The same of any group."""
        size, sum, closes = dtype(0.0), dtype(0.0), ZERO - FAR
        last, other = dtype(0.0), dtype(0.0)  # w and terms of the row before
        lightest = ZERO + MOST
        for r in range(k.group[g], k.group[g + 1]):
            if k.acting[r] > 0:
                value, least = own_impulse(t, k, r)
                lightest = wp.min(lightest, least)
                moved, moves = spread(t, k, r)
                w = k.rate[r] + moved
                terms = keep(k, r, value, w, wp.abs(k.rate[r]) + moves)
                closes = wp.max(closes, closing(t, k, r, w, terms, last, other))
                last = w + ZERO
                other = terms + ZERO
                size = wp.max(size, terms)
                sum += terms
        return size, sum, closes, lightest

    @wp.func
    def of_whole(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """D of the whole M, where that is another one."""
        whole.lend(t, k, o)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                value, _least = own_impulse(t, k, r)
                k.scale[r] = wp.max(value, FLOOR)
                k.inverse[r] = ONE / k.scale[r]
        whole.take_back(t, k, o)

    @wp.func(inline=False)
    def scales(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """diag(A) and D of the acting rows; the size of velocities, by which residuals are judged, and the
        number of rows.
        """
        size, finite = dtype(0.0), dtype(0.0)
        lightest = ZERO + MOST
        for place in range(o.start, o.end):
            b = k.block[place]
            k.queue[t.block_unit[b]] = t.block_unit[b]
            k.most[b] = V3()
        for g in range(o.group, o.last_group):
            _start, _end, _entry, entries, one, two = nt.ends(t, k, g)
            most, sum, closes, least = dtype(0.0), dtype(0.0), ZERO - FAR, dtype(0.0)
            if entries <= 2 and is_whole(t, one) and is_whole(t, two):
                most, sum, closes, least = of_two(t, k, g)
            else:
                most, sum, closes, least = of_many(t, k, g)
            size = wp.max(size, most)
            finite += sum
            lightest = wp.min(lightest, least)
            k.dz[k.group[g]] = closes
            if closes > ZERO:
                join(t, k, one, two)
        n = dtype(0.0)
        own = size + ZERO
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                n += ONE
                own = wp.min(own, k.own[r])
                k.scale[r] = wp.where(t.inertia_scaling == 1, k.diag[r], ONE)
                k.inverse[r] = wp.where(t.inertia_scaling == 1, k.inverse[r], ONE)
        if whole.concerns(t, k, o):
            of_whole(t, k, o)
        if not wp.isfinite(finite):
            return finite, n
        share_units(t, k, o, UNLIKE * own < size)
        bounds(t, k, o, size, wp.where(lightest < MOST, size / lightest, ZERO))
        return size, n

    return scales
