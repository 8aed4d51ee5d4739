"""Newton's directions where smoothed rows that press hard all but exclude each other.

Between walls that discs just fit, a combination of rows may move nothing but for 1e-7: its part of A is 1e-14
of the diagonal. Newton's matrix M + J' W J loses it, for W of a row that presses by many sigma is 1e11 and
more, whether for the proximal term or for its own value. Such rows are held here: they are left out of the
matrix, and their impulses solve J dv + (q D/p) dlambda = -r2 themselves, of A among them (Cholesky, dense).
So nothing of A's digits is lost to W, and rows yield next to nothing.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..newton import make_newton
from ..topology import Topology
from ..work import V3, WORK, Island, Slot

HELD = 1e-12  # rows that yield by less of diag(A) are held: logistic ones that press by 28 sigma
YIELD = 1e-15  # of diag(A), of those held: a rounding of what A is summed up from
SUGGESTED = 32.0  # times the impulse of a row by itself that one may press which is not held
LOST = 1e-16  # of a pivot's own size: what is less is rounding


@cached
def make_held(given: type, residual: str) -> SimpleNamespace:
    """direction(t, k, o) -> 1 with Newton's direction at hand as `newton.direction` leaves it, or 0 where
    there is no room for those held; least(t, k, o) -> 1 with the least impulses of these rows in k.best_z, of
    all others their own as far as their data suggest them, or 0. Both use k.upper for A, k.mode for the list
    of rows and k.aimed.
    """
    nt = make_newton(given, residual)
    ZERO, ONE, STIFF, LITTLE, NOTHING = WORK(0.0), WORK(1.0), WORK(HELD), WORK(YIELD), WORK(LOST)
    MOST = WORK(SUGGESTED)

    @wp.func
    def entry(k: wp.ref[Slot], i: int, j: int):
        """Entry (i, j), j <= i, of A or its factor: nine share a matrix."""
        at = i * (i + 1) // 2 + j
        return k.upper[at // 9][(at % 9) // 3, at % 3]

    @wp.func
    def put_entry(k: wp.ref[Slot], i: int, j: int, value: WORK):
        at = i * (i + 1) // 2 + j
        m = k.upper[at // 9]
        m[(at % 9) // 3, at % 3] = value
        k.upper[at // 9] = m

    @wp.func
    def choose(k: wp.ref[Slot], o: Island):
        """How many rows are held, k.mode[o.row + .] which; -1 if there is no room for A of them."""
        m = int(0)
        for r in range(o.row, o.last_row):
            k.aimed[r] = ZERO
            if k.acting[r] > 0:
                e = nt.smooth(k, r, k.z[r])
                if e[3] < STIFF * e[2] * k.diag[r] * k.inverse[r]:
                    k.mode[o.row + m] = r
                    k.aimed[r] = ONE
                    m += 1
        if m * (m + 1) // 2 > 9 * k.upper.shape[0]:
            return -1
        return m

    @wp.func
    def respond(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, r: int):
        """k.move: J_r' solved for with the factor at hand."""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        for e in range(k.entry[r + 1] - k.entry[r]):
            k.move[t.row_block[k.pattern[r] + e]] = k.jac[k.entry[r] + e]
        nt.env.solve(k.factor, k.first, k.at, k.block, k.move, o.start, o.end)

    @wp.func(inline=False)
    def couple(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, m: int):
        """The factor of A of the held rows, of k.slack and k.p what they yield by; its diagonal inverted."""
        for j in range(m):
            r = k.mode[o.row + j]
            respond(t, k, o, r)
            for i in range(j, m):
                put_entry(k, i, j, nt.dot(t, k, k.move, k.mode[o.row + i]))
            own = k.slack[r] / (k.p[r] * k.inverse[r]) + LITTLE * k.diag[r]
            put_entry(k, j, j, entry(k, j, j) + own)
        for i in range(m):
            for j in range(i + 1):
                value = entry(k, i, j)
                size = value + ZERO
                for q in range(j):
                    value -= entry(k, i, q) * entry(k, j, q)
                if j < i:
                    value = value * entry(k, j, j)
                else:
                    value = ONE / wp.sqrt(wp.max(value, NOTHING * size))
                put_entry(k, i, j, value)

    @wp.func(inline=False)
    def relieve(k: wp.ref[Slot], o: Island, m: int):
        """k.aimed of the held rows solved for."""
        for i in range(m):
            r = k.mode[o.row + i]
            value = k.aimed[r]
            for j in range(i):
                value -= entry(k, i, j) * k.aimed[k.mode[o.row + j]]
            k.aimed[r] = value * entry(k, i, i)
        for n in range(m):
            i = m - 1 - n
            r = k.mode[o.row + i]
            value = k.aimed[r]
            for j in range(i + 1, m):
                value -= entry(k, j, i) * k.aimed[k.mode[o.row + j]]
            k.aimed[r] = value * entry(k, i, i)

    @wp.func
    def press(t: wp.ref[Topology], k: wp.ref[Slot], r: int, impulse: WORK):
        """Take an impulse on row r off k.balance."""
        for e in range(k.entry[r + 1] - k.entry[r]):
            b = t.row_block[k.pattern[r] + e]
            k.balance[b] = k.balance[b] - impulse * k.jac[k.entry[r] + e]

    @wp.func(inline=False)
    def direction(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        m = choose(k, o)
        if m < 0:
            return 0
        nt.weigh_rows(t, k, o, ZERO)
        for j in range(m):
            k.weight[k.mode[o.row + j]] = ZERO
            k.divisor[k.mode[o.row + j]] = ZERO
        nt.assemble(t, k, o)
        nt.env.factor(k.factor, k.first, k.at, o.start, o.end)
        couple(t, k, o, m)
        nt.direction(t, k, o, ZERO, 0, ZERO)
        for j in range(m):
            r = k.mode[o.row + j]
            k.aimed[r] = -(k.res[r] + nt.dot(t, k, k.move, r))
        relieve(k, o, m)
        for j in range(m):
            press(t, k, k.mode[o.row + j], k.aimed[k.mode[o.row + j]])
        nt.direction(t, k, o, ZERO, 0, ZERO)
        for j in range(m):
            r = k.mode[o.row + j]
            k.dz[r] = k.aimed[r] / (k.p[r] * k.inverse[r])
        return 1

    @wp.func(inline=False)
    def least(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        m = choose(k, o)
        if m < 0:
            return 0
        nt.mass_times(t, k, o)
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
            k.best_z[r] = wp.min(k.lam[r], MOST * k.alone[r])
            if k.acting[r] > 0 and k.aimed[r] == ZERO:
                press(t, k, r, k.best_z[r])
        nt.assemble(t, k, o)
        nt.env.factor(k.factor, k.first, k.at, o.start, o.end)
        for j in range(m):
            k.p[k.mode[o.row + j]] = ONE
            k.slack[k.mode[o.row + j]] = ZERO
        couple(t, k, o, m)
        for place in range(o.start, o.end):
            k.move[k.block[place]] = k.balance[k.block[place]]
        nt.env.solve(k.factor, k.first, k.at, k.block, k.move, o.start, o.end)
        for j in range(m):
            k.aimed[k.mode[o.row + j]] = nt.dot(t, k, k.move, k.mode[o.row + j])
        relieve(k, o, m)
        for j in range(m):
            k.best_z[k.mode[o.row + j]] = wp.abs(k.aimed[k.mode[o.row + j]])
        return 1

    return SimpleNamespace(direction=direction, least=least)
