"""Newton's directions where smoothed rows that press hard all but exclude each other.

Between walls that discs just fit, a combination of rows may move nothing but for 1e-7: its part of A is 1e-14
of the diagonal. Newton's matrix M + J' W J loses it, for W of a row that presses by many sigma is 1e11 and
more, whether for the proximal term or for its own value. Such rows are held here: they are left out of the
matrix, and their impulses solve J dv + (q D/p) dlambda = -r2, from (M11), of A among them (Cholesky, dense).
So nothing of A's digits is lost to W, and rows yield next to nothing.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..newton import make_newton
from ..topology import Topology
from ..work import M33, V3, WORK, Island, Slot

HELD = 1e-12  # rows that yield by less of diag(A) are held: logistic ones that press by 28 sigma
YIELD = 1e-15  # of diag(A), of those held: a rounding of what A is summed up from
SUGGESTED = 32.0  # times the impulse of a row by itself that one may press which is not held


@cached
def make_held(given: type, residual: str) -> SimpleNamespace:
    """direction(t, k, o) -> 1 with Newton's direction at hand as `newton.direction` leaves it, or 0 where
    there is no room for those held; least(t, k, o) -> 1 with the least impulses of these rows in k.best_z, of
    all others their own as far as their data suggest them, or 0. Both use k.upper for A, k.link and k.sorted
    for its layout, k.mode for the list of rows, k.aimed and k.inner_v.
    """
    nt = make_newton(given, residual)
    ZERO, ONE, STIFF, LITTLE = WORK(0.0), WORK(1.0), WORK(HELD), WORK(YIELD)
    MOST = WORK(SUGGESTED)

    @wp.func
    def put_entry(k: wp.ref[Slot], i: int, j: int, value: WORK):
        """Entry (i, j), j <= i, of A; both triangles of a block of the diagonal."""
        at = k.link[i / 3] + j / 3
        m = k.upper[at]
        m[i % 3, j % 3] = value
        if i / 3 == j / 3:
            m[j % 3, i % 3] = value
        k.upper[at] = m

    @wp.func
    def lay_out(k: wp.ref[Slot], m: int):
        """Empty rows of blocks for A of m rows, the last ones of a block of the diagonal as of none."""
        blocks = (m + 2) / 3
        at = int(0)
        for i in range(blocks):
            k.link[i] = at
            k.sorted[i] = 0
            for j in range(i + 1):
                k.upper[at + j] = M33()
            k.upper[at + i] = wp.identity(n=3, dtype=WORK)
            at += i + 1
        return blocks

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
        blocks = (m + 2) / 3
        if blocks * (blocks + 1) / 2 > k.upper.shape[0] or blocks > k.inner_v.shape[0]:
            return -1
        if blocks > wp.min(k.link.shape[0], k.sorted.shape[0]):
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
        """The factor of A of the held rows, of k.slack and k.p what they yield by."""
        blocks = lay_out(k, m)
        for j in range(m):
            r = k.mode[o.row + j]
            respond(t, k, o, r)
            own = k.slack[r] / (k.p[r] * k.inverse[r]) + LITTLE * k.diag[r]
            put_entry(k, j, j, nt.dot(t, k, k.move, r) + own)
            for i in range(j + 1, m):
                put_entry(k, i, j, nt.dot(t, k, k.move, k.mode[o.row + i]))
        nt.env.factor(k.upper, k.sorted, k.link, 0, blocks)

    @wp.func(inline=False)
    def relieve(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, m: int):
        """k.aimed of the held rows solved for."""
        blocks = (m + 2) / 3
        for i in range(blocks):
            x = V3()
            for part in range(3):
                if 3 * i + part < m:
                    x[part] = k.aimed[k.mode[o.row + 3 * i + part]]
            k.inner_v[i] = x
        nt.env.solve(k.upper, k.sorted, k.link, t.block_id, k.inner_v, 0, blocks)
        for j in range(m):
            k.aimed[k.mode[o.row + j]] = k.inner_v[j / 3][j % 3]

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
        relieve(t, k, o, m)
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
        relieve(t, k, o, m)
        for j in range(m):
            k.best_z[k.mode[o.row + j]] = wp.abs(k.aimed[k.mode[o.row + j]])
        return 1

    return SimpleNamespace(direction=direction, least=least)
