"""The dual active-set method of Goldfarb and Idnani, for hard rows that all but exclude each other, and for
where smoothed ones that do are held from (`linear/held.py`).

Between walls that discs just fit, a set of rows is dependent but for 1e-7, and its impulses are 1e5 times
what the data suggest. The proximal term of Newton's and the interior-point method hides such a set. Here v'
starts from v_free, and the row that is shut farthest joins the set until none is; on the way rows whose
impulse is used up leave it. An orthonormal basis of M^-1 J' of the set (inner product M, every vector made
orthogonal twice) tells 1e-7 from nothing. R of that basis is never stored: R_ij = J_j q_i, a few products.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from .newton import make_newton
from .topology import Topology
from .work import V3, WORK, Island, Slot

INDEPENDENT = 1e-18  # least share of diag(A) that the others must leave of a row's own
SHUT = 1e-12  # of a row, relative to what its velocities are judged by
PIVOTS, A_BLOCK = 64, 8  # joining and leaving: at most this many, and as many more a block


@cached
def make_active_set(given: type) -> SimpleNamespace:
    """find(t, k, o) -> 1 with the solution in k.v, k.z, or 0. Uses k.factor and k.upper for the basis, k.mode
    for the set, k.p for who is in it, k.dz, k.move and k.balance.
    """
    nt = make_newton(given, "hard")
    ZERO, ONE, TINY, HUGE = WORK(0.0), WORK(1.0), WORK(1e-30), WORK(1e300)
    LEAST, CLOSED = WORK(INDEPENDENT), WORK(SHUT)

    @wp.func
    def part(k: wp.ref[Slot], o: Island, j: int, place: int):
        """Vector j of the basis at a place: three vectors share a matrix."""
        cell = (j // 3) * (o.end - o.start) + place - o.start
        room = k.factor.shape[0]
        if cell < room:
            return k.factor[cell][j % 3]
        return k.upper[cell - room][j % 3]

    @wp.func
    def put_part(k: wp.ref[Slot], o: Island, j: int, place: int, value: V3):
        cell = (j // 3) * (o.end - o.start) + place - o.start
        room = k.factor.shape[0]
        if cell < room:
            m = k.factor[cell]
            m[j % 3] = value
            k.factor[cell] = m
        else:
            m = k.upper[cell - room]
            m[j % 3] = value
            k.upper[cell - room] = m

    @wp.func(inline=False)
    def along(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, r: int, j: int):
        """J_r q_j"""
        out = ZERO + ZERO
        at = k.pattern[r]
        for e in range(k.entry[r], k.entry[r + 1]):
            out += wp.dot(k.jac[e], part(k, o, j, k.place[t.row_block[at]]))
            at += 1
        return out

    @wp.func
    def respond(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, r: int):
        """k.move = M^-1 J_r'"""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        first = k.pattern[r]
        count = k.entry[r + 1] - k.entry[r]
        for e in range(count):
            k.move[t.row_block[first + e]] = k.jac[k.entry[r] + e]
        last = int(-1)
        for e in range(count):
            u = t.block_unit[t.row_block[first + e]]
            if u != last:
                start = t.unit_start[u]
                end = t.unit_start[u + 1]
                nt.env.solve(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, start, end)
            last = u + 0

    @wp.func(inline=False)
    def weigh(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.balance = M k.move; k.move M k.move"""
        for place in range(o.start, o.end):
            i = k.block[place]
            at = t.mass_at[i]
            value = k.mass[at + i] * k.move[i]
            for j in range(t.mass_first[i], i):
                m = k.mass[at + j]
                value += m * k.move[j]
                k.balance[j] = k.balance[j] + wp.transpose(m) * k.move[i]
            k.balance[i] = value
        energy = ZERO + ZERO
        for place in range(o.start, o.end):
            i = k.block[place]
            energy += wp.dot(k.move[i], k.balance[i])
        return energy

    @wp.func(inline=False)
    def less(k: wp.ref[Slot], o: Island, j: int, share: WORK):
        for place in range(o.start, o.end):
            i = k.block[place]
            k.move[i] = k.move[i] - share * part(k, o, j, place)

    @wp.func(inline=False)
    def project(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, r: int, m: int):
        """k.move: what the set of m rows leaves of M^-1 J_r'; its energy; k.dz: the rest in the basis."""
        respond(t, k, o, r)
        for j in range(m):
            d = along(t, k, o, r, j)
            k.dz[j] = d
            less(k, o, j, d)
        energy = weigh(t, k, o)
        for j in range(m):
            d = ZERO + ZERO
            for place in range(o.start, o.end):
                d += wp.dot(k.balance[k.block[place]], part(k, o, j, place))
            k.dz[j] = k.dz[j] + d
            energy -= d * d
            less(k, o, j, d)
        return energy

    @wp.func(inline=False)
    def relieved(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, m: int):
        """k.dz: by how much an impulse on the new row relieves those of the set (R^-1 k.dz). The impulse that
        uses up the first of them, and which that is.
        """
        most = ZERO + HUGE
        which = int(-1)
        for n in range(m):
            j = m - 1 - n
            r = k.mode[j]
            x = k.dz[j] / along(t, k, o, r, j)
            k.dz[j] = x
            for i in range(j):
                k.dz[i] = k.dz[i] - x * along(t, k, o, r, i)
            if x > ZERO and k.lam[r] < most * x:
                most = k.lam[r] / x
                which = j + 0
        return most, which

    @wp.func(inline=False)
    def leave(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, first: int, m: int):
        """Take row `first` out of the set of m; the basis is turned until R is a triangle again."""
        k.lam[k.mode[first]] = ZERO
        k.p[k.mode[first]] = ZERO
        for j in range(first, m - 1):
            r = k.mode[j + 1]
            k.mode[j] = r
            a = along(t, k, o, r, j)
            b = along(t, k, o, r, j + 1)
            size = wp.sqrt(a * a + b * b)
            a = a / size
            b = b / size
            for place in range(o.start, o.end):
                x = part(k, o, j, place)
                y = part(k, o, j + 1, place)
                put_part(k, o, j, place, a * x + b * y)
                put_part(k, o, j + 1, place, a * y - b * x)

    @wp.func
    def join(k: wp.ref[Slot], o: Island, r: int, m: int, energy: WORK):
        """Row r, of which the set leaves k.move, is its member m."""
        k.mode[m] = r
        k.p[r] = ONE
        size = ONE / wp.sqrt(energy)
        for place in range(o.start, o.end):
            put_part(k, o, m, place, size * k.move[k.block[place]])

    @wp.func(inline=False)
    def shut_farthest(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """The row outside the set that is shut farthest, measured by energy; -1 if none is."""
        which = int(-1)
        worst = ZERO + ZERO
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and k.p[r] == ZERO:
                w = k.rate[r] + nt.dot(t, k, k.v, r)
                if w < -CLOSED * k.unit[r] and w * wp.abs(w) < worst * k.diag[r]:
                    worst = w * wp.abs(w) / k.diag[r]
                    which = r + 0
        return which

    @wp.func
    def press(k: wp.ref[Slot], o: Island, r: int, m: int, impulse: WORK, energy: WORK):
        """Press row r; the set's impulses are relieved, and v' moves where the set leaves it free."""
        for j in range(m):
            s = k.mode[j]
            k.lam[s] = wp.max(k.lam[s] - impulse * k.dz[j], ZERO)
        k.lam[r] = k.lam[r] + impulse
        if energy > ZERO:
            for place in range(o.start, o.end):
                i = k.block[place]
                k.v[i] = k.v[i] + impulse * k.move[i]

    @wp.func
    def hand_on(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.z of the solution."""
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                w = k.rate[r] + nt.dot(t, k, k.v, r)
                k.z[r] = wp.where(k.p[r] > ZERO, wp.max(k.lam[r] * k.scale[r], TINY), -wp.max(w, TINY))

    @wp.func(inline=False)
    def find(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        n = o.end - o.start
        for place in range(o.start, o.end):
            k.v[k.block[place]] = k.vfree[k.block[place]]
        for r in range(o.row, o.last_row):
            k.lam[r] = ZERO
            k.p[r] = ZERO
        room = 3 * wp.min((k.factor.shape[0] + k.upper.shape[0]) // n, n)
        m = int(0)
        row = shut_farthest(t, k, o)
        pivots = int(0)
        while row >= 0 and pivots < wp.static(PIVOTS) + wp.static(A_BLOCK) * n:
            pivots += 1
            energy = project(t, k, o, row, m)
            used, which = relieved(t, k, o, m)
            w = k.rate[row] + nt.dot(t, k, k.v, row)
            opened = ZERO + HUGE
            if energy > LEAST * k.diag[row]:
                opened = wp.max(-w, ZERO) / energy
            else:
                energy = ZERO + ZERO
            impulse = wp.min(used, opened)
            joins = not (used < opened)
            if not (impulse < HUGE) or (joins and m == room):
                return 0
            press(k, o, row, m, impulse, energy)
            if joins:
                join(k, o, row, m, energy)
                m += 1
                row = shut_farthest(t, k, o)
            else:
                leave(t, k, o, which, m)
                m -= 1
        hand_on(t, k, o)
        return wp.where(row < 0, 1, 0)

    return SimpleNamespace(find=find)
