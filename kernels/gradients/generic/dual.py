"""Weights P and rho of a solved step's equations (M27), by the transposed system at its solution.

With S = s'(z) and Q = s'(-z) the transposed system is N a - C' (S/D) y = target, J a + Q y = 0, with P = -a
and rho = (S/D) y; C = J but for contacts that slide with Coulomb's friction (`derivatives/system.py`). The
factor is that of the system itself, its transpose where it is not symmetric, and what its proximal term is
off by is put right by refinement.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.derivatives.asked import FAR
from ...generic.derivatives.slips import make_slips
from ...generic.derivatives.system import NOISE, SLOW, WRONG, make_system
from ...generic.linear.lu import make_lu
from ...generic.topology import Topology
from ...generic.work import ISLANDS, ROWS, V3, WORK, Slot
from .room import Room, View

ENOUGH = 1e-15  # of a correction, relative to the whole
CARRIED = 1e-2  # of the slopes by v': the last correction's work on the impulses, of which little is an error


@cached
def make_dual(given: type, residual: str) -> SimpleNamespace:
    """weights(t, k, room, w, b): P (in w.p as -P) and rho of w.target, 1 if these hold; solved(.., n): the
    same with the factor of n rows that is there; response(t, k, r): k.move = M^-1 J_r' in the units that row
    r moves; along(t, k, x, r) = J_r x, push(t, k, w, x, r, by): x -= C_r' by; momenta(t, k,
    x): k.balance = N x.
    """
    system, lu, slips = make_system(given, residual), make_lu(), make_slips()
    contacts = residual != "none"
    SMALL, LEAST = WORK(ENOUGH), WORK(NOISE / WRONG)
    ZERO, ONE = WORK(0.0), WORK(1.0)

    @wp.func
    def acting(k: wp.ref[Slot], room: wp.ref[Room], b: int):
        """The list of acting rows, and its length."""
        n = int(0)
        for r in range(k.count[wp.static(ROWS)]):
            if k.acting[r] > 0:
                room.factor.row[b, n] = r
                n += 1
        return n

    @wp.func
    def push(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], x: wp.array(dtype=V3), r: int, by: WORK):
        """x -= C_r' by"""
        for e in range(k.entry[r + 1] - k.entry[r]):
            block = t.row_block[k.pattern[r] + e]
            x[block] = x[block] - by * slips.held_entry(t, k, r, e, w.slides[r])

    @wp.func
    def along(t: wp.ref[Topology], k: wp.ref[Slot], x: wp.array(dtype=V3), r: int):
        """J_r x"""
        out = WORK(0.0)
        for e in range(k.entry[r + 1] - k.entry[r]):
            out += wp.dot(k.jac[k.entry[r] + e], x[t.row_block[k.pattern[r] + e]])
        return out

    @wp.func
    def momenta(t: wp.ref[Topology], k: wp.ref[Slot], x: wp.array(dtype=V3)):
        for i in range(t.blocks):
            at = t.mass_at[i]
            total = k.mass[at + i] * x[i]
            for j in range(t.mass_first[i], i):
                m = k.mass[at + j]
                total += m * x[j]
                k.balance[j] = k.balance[j] + wp.transpose(m) * x[i]
            k.balance[i] = total

    @wp.func
    def miss(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], rows: wp.array(dtype=int), n: int):
        """k.balance and k.res: what w.p and w.y leave of the equations."""
        momenta(t, k, w.p)
        for i in range(t.blocks):
            k.balance[i] = k.balance[i] - w.target[i]
        for n_th in range(n):
            r = rows[n_th]
            k.res[r] = k.slack[r] * w.y[r] + along(t, k, w.p, r)
            push(t, k, w, k.balance, r, k.p[r] / k.scale[r] * w.y[r])

    @wp.func
    def transposed(t: wp.ref[Topology], k: wp.ref[Slot], room: wp.ref[Room], b: int):
        """k.move by the inverse of the matrix's transpose."""
        if wp.static(contacts):
            upper = k.factor
            if t.coulomb == 1:
                upper = room.factor.upper[b]
            end = k.island_block[k.count[wp.static(ISLANDS)]]
            lu.solve(upper, k.factor, k.first, k.at, k.block, k.move, 0, end)
        for u in range(t.units):
            alone = int(1)  # a block of no island
            if wp.static(contacts):
                alone = wp.where(k.island[u] < 0, 1, 0)
            if alone == 1:
                start = t.unit_start[u]
                m = k.mass_factor
                lu.solve(m, m, t.mass_first, t.mass_at, t.block_id, k.move, start, t.unit_start[u + 1])

    @wp.func
    def correction(
        t: wp.ref[Topology], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View], b: int,
        rows: wp.array(dtype=int), n: int,
    ):  # fmt: skip
        """What k.balance and k.res ask for, added to w.p and w.y; its size and that of the whole, which is no
        less than what rounding leaves of what bodies without rows would do.
        """
        for i in range(t.blocks):
            k.move[i] = -k.balance[i]
        for n_th in range(n):
            r = rows[n_th]
            push(t, k, w, k.move, r, room.factor.share[b, n_th][3] * k.res[r])
        transposed(t, k, room, b)
        for n_th in range(n):
            r = rows[n_th]
            w.y[r] = w.y[r] - (k.res[r] + along(t, k, k.move, r)) * room.factor.share[b, n_th][1]
        size = WORK(0.0)
        change = WORK(0.0)
        for i in range(t.blocks):
            w.p[i] = w.p[i] + k.move[i]
            free = wp.cw_div(w.target[i], wp.get_diag(k.mass[t.mass_at[i] + i]))
            for part in range(3):
                size = wp.max(size, wp.max(wp.abs(w.p[i][part]), LEAST * wp.abs(free[part])))
                change = wp.max(change, wp.abs(k.move[i][part]))
        return change, size

    @wp.func(inline=False)
    def refine(
        t: wp.ref[Topology], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View], b: int,
        rows: wp.array(dtype=int), n: int,
    ):  # fmt: skip
        """w.p and w.y, refined while that helps; what is left of them, relative to the whole."""
        for i in range(t.blocks):
            w.p[i] = V3()
        for n_th in range(n):
            w.y[rows[n_th]] = ZERO
        last = WORK(1e300)
        left = ZERO + ONE
        more = int(1)
        while more <= wp.static(SLOW):
            miss(t, k, w, rows, n)
            change, size = correction(t, k, room, w, b, rows, n)
            if not (change > SMALL * size):
                return wp.where(change <= SMALL * size, ZERO, ONE)
            left = change / size
            if change < last:
                left = left * change / (last - change)  # what is to come
            elif more > 2:  # of an answer of 0 the second one takes the first one back
                return left
            last = change
            more += 1
        return left

    @wp.func
    def carries(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], rows: wp.array(dtype=int), n: int):
        """1 if the impulses, which J's slopes are multiplied by, leave the last change small, and no row's
        weight is far beyond the target.
        """
        size = ZERO + ZERO
        for i in range(t.blocks):
            for part in range(3):
                size = wp.max(size, wp.abs(w.target[i][part]))
        moved = ZERO + ZERO
        most = ZERO + ZERO
        for n_th in range(n):
            r = rows[n_th]
            for e in range(k.entry[r + 1] - k.entry[r]):
                change = wp.cw_mul(k.jac[k.entry[r] + e], k.move[t.row_block[k.pattern[r] + e]])
                weight = k.p[r] / k.scale[r] * wp.abs(w.y[r]) * wp.abs(k.jac[k.entry[r] + e])
                for part in range(3):
                    moved = wp.max(moved, k.lam[r] * wp.abs(change[part]))
                    most = wp.max(most, weight[part])
        return wp.where(
            moved <= WORK(wp.static(CARRIED)) * size and most <= WORK(wp.static(FAR)) * size, 1, 0
        )

    @wp.func
    def solved(t: wp.ref[Topology], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View], b: int, n: int):
        """`weights` of the n rows whose factor is there."""
        rows = room.factor.row[b]
        for n_th in range(n):
            w.slides[rows[n_th]] = room.factor.slides[b, n_th]
        left = refine(t, k, room, w, b, rows, n)
        while not (left <= WORK(wp.static(WRONG))):
            if system.firmer(t, k, room.factor, b) == 0:
                return int(0)
            left = refine(t, k, room, w, b, rows, n)
        for n_th in range(n):
            r = rows[n_th]
            w.rho[r] = k.p[r] / k.scale[r] * w.y[r]
        return carries(t, k, w, rows, n)

    @wp.func
    def weights(t: wp.ref[Topology], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View], b: int):
        n = int(0)
        if wp.static(contacts):
            n = acting(k, room, b)
        system.factor(t, k, room.factor, b, n)
        return solved(t, k, room, w, b, n)

    return SimpleNamespace(
        weights=weights, solved=solved, response=system.response, along=along, push=push, momenta=momenta
    )
