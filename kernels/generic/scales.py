"""What the data of a step set: diag(A) and D of an island's rows, and the sizes that they are judged by."""

import warp as wp

from ..factories import cached
from .newton import make_newton
from .topology import Topology
from .work import V3, WORK, Island, Slot


@cached
def make_scales(given: type, residual: str) -> wp.Function:
    """scales(t, k, o) -> the size of velocities in an island, and the number of its acting rows."""
    dtype = WORK
    nt = make_newton(given, residual)
    hard = residual == "hard"
    ZERO, ONE = dtype(0.0), dtype(1.0)
    LOST, FLOOR, TINY, MOST = nt.LOST, dtype(1e-30), dtype(1e-30), dtype(1e300)

    @wp.func
    def units_of(t: wp.ref[Topology], k: wp.ref[Slot], g: int):
        """The units that the rows of a group move; the same one twice where there is one."""
        i = k.row[k.group[g]]
        return t.block_unit[t.row_block[t.row_start[i]]], t.block_unit[t.row_block[t.row_start[i + 1] - 1]]

    @wp.func
    def name_of(k: wp.ref[Slot], u: int):
        """The unit after which what unit u hangs together with is named."""
        name = int(u)
        while k.name[name] != name:
            k.name[name] = k.name[k.name[name]]
            name = k.name[name]
        return name

    @wp.func
    def closing(k: wp.ref[Slot], g: int):
        """The largest k.unit of a group."""
        closes = dtype(0.0)
        r = k.group[g]
        while r < k.group[g + 1]:
            if k.acting[r] > 0:
                closes = wp.max(closes, k.unit[r])
            r += 1
        return closes

    @wp.func
    def share_units(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.unit, from what v_free closes (k.unit) and a row's own terms: rows of bodies that neither hang
        together nor touch are no measure of each other.
        """
        for place in range(o.start, o.end):
            u = t.block_unit[k.block[place]]
            k.name[u] = u
            k.move[t.unit_start[u]] = V3()
        for g in range(o.group, o.last_group):
            if closing(k, g) > ZERO:
                one, two = units_of(t, k, g)
                one = name_of(k, one)
                two = name_of(k, two)
                k.name[wp.max(one, two)] = wp.min(one, two)
        for g in range(o.group, o.last_group):
            closes = closing(k, g)
            if closes > ZERO:
                one, _two = units_of(t, k, g)
                b = t.unit_start[name_of(k, one)]
                k.move[b] = V3(wp.max(k.move[b][0], closes), ZERO, ZERO)
        for g in range(o.group, o.last_group):
            one, _two = units_of(t, k, g)
            shared = k.move[t.unit_start[name_of(k, one)]][0]
            for r in range(k.group[g], k.group[g + 1]):
                if k.acting[r] > 0:
                    k.unit[r] = wp.max(wp.max(shared, k.own[r]), TINY)

    @wp.func
    def bounds(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype, largest: dtype):
        """k.most: what a row allows of M (v' - v_free) that presses no harder than `largest`, the impulse
        that stops the heavier side of one, in an island of speeds `size`. k.unseen, too.
        """
        for place in range(o.start, o.end):
            i = k.block[place]
            k.most[i] = size * wp.get_diag(k.mass[t.mass_at[i] + i])
            k.unseen[i] = LOST * k.most[i]
        for g in range(o.group, o.last_group):
            start = k.group[g]
            for e in range(k.entry[start + 1] - k.entry[start]):
                x, y, z = dtype(0.0), dtype(0.0), dtype(0.0)
                r = int(start)
                while r < k.group[g + 1]:
                    if k.acting[r] > 0:
                        j = k.jac[k.entry[r] + e]
                        x += wp.abs(j[0])
                        y += wp.abs(j[1])
                        z += wp.abs(j[2])
                    r += 1
                b = t.row_block[k.pattern[start] + e]
                k.most[b] = k.most[b] + largest * V3(x, y, z)

    @wp.func
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
                for j in range(t.unit_start[u], t.unit_start[u + 1]):
                    k.move[j] = V3()
                more = int(1)
                while more == 1:
                    k.move[t.row_block[at]] = k.jac[e]
                    e += 1
                    at += 1
                    more = int(0)
                    if e < end:
                        more = wp.where(t.block_unit[t.row_block[at]] == u, 1, 0)
                start = t.unit_start[u]
                last = t.unit_start[u + 1]
                nt.env.forward(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, start, last)
                for j in range(start, last):
                    part += wp.dot(k.move[j], k.move[j])
            value += part
            if part > FLOOR:
                least = wp.min(least, part)
        return value, least

    @wp.func(inline=False)
    def scales(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """diag(A) and D of the acting rows; the size of velocities, by which residuals are judged, and the
        number of rows.
        """
        size = dtype(0.0)
        lightest = ZERO + MOST
        finite = dtype(0.0)
        n = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                value, least = own_impulse(t, k, r)
                lightest = wp.min(lightest, least)
                k.diag[r] = wp.max(value, FLOOR)
                k.scale[r] = wp.where(t.inertia_scaling == 1, k.diag[r], ONE)
                k.inverse[r] = ONE / k.scale[r]
                terms = wp.abs(k.rate[r])
                w = k.rate[r]
                e = k.entry[r]
                at = k.pattern[r]
                end = k.entry[r + 1]
                while e < end:
                    change = wp.cw_mul(k.jac[e], k.vfree[t.row_block[at]])
                    e += 1
                    at += 1
                    terms += wp.abs(change[0]) + wp.abs(change[1]) + wp.abs(change[2])
                    w += change[0] + change[1] + change[2]
                terms += wp.abs(w)
                alone = wp.max(-w, ZERO)
                if wp.static(not hard):
                    terms += k.sigma[r]
                    alone += k.sigma[r]
                k.alone[r] = wp.where(value > FLOOR, alone / k.diag[r], ZERO)
                k.own[r] = terms
                k.unit[r] = wp.where(w < ZERO, terms, ZERO)
                k.least[r] = nt.smooth(k, r, k.z[r])[0] / k.scale[r]  # what it pressed last
                size = wp.max(size, terms)
                finite += terms
                n += ONE
        if not wp.isfinite(finite):
            return finite, n
        share_units(t, k, o)
        bounds(t, k, o, size, wp.where(lightest < MOST, size / lightest, ZERO))
        return size, n

    return scales
