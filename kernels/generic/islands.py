"""What the data allow a step of the generic kernels to exchange: the judge of impulses beside the equations.

Rows that all but exclude each other can be answered by opposed impulses of any size, so an error relative to
the impulses proves nothing, and neither does one relative to what happens elsewhere in the world. Here every
place is judged by the momenta of its own island, the places that rows which press and M couple to it.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from .newton import ACCEPTED, GIVEN, SUMMED, make_newton
from .topology import CONTACT, Topology
from .work import WORK, Work

ROW = 10.0  # what is good enough of a row relative to its own terms, in units of ACCEPTED
EARNED = {wp.float64: 2e-10, wp.float32: 1e-8}  # and where the data alone do not suggest its impulses
ROUNDED = 1e-12  # and relative to the largest of all rows
EXCHANGED = {wp.float64: 1e-13, wp.float32: 1e-8}  # what may be missing of M dv relative to impulses alone
PRESSING = 1e-3  # of what a row presses alone: less couples nothing
SHARED = 10.0  # by which a row may push harder than all momentum of its island


@cached
def make_islands(given: type) -> SimpleNamespace:
    """Warp functions `bounds`, `adds_up`, `see_all` and `is_earned`."""
    dtype = WORK
    nt = make_newton(given, "hard")
    ZERO = dtype(0.0)
    LOST, ROUND, ENOUGH = nt.LOST, dtype(GIVEN[given]), dtype(SUMMED[given])
    OPEN, EXACT, LEAST = dtype(ROW * ACCEPTED[given]), dtype(EARNED[given]), dtype(ROUNDED)
    CLOSE = dtype(EXCHANGED[given])
    TINY, MOST, PRESSES = dtype(1e-30), dtype(SHARED), dtype(PRESSING)

    @wp.func
    def bounds(t: Topology, k: Work, b: int, n: int, size: dtype, largest: dtype):
        """k.most: what a row allows of M (v' - v_free) that presses no harder than `largest`, the impulse
        that stops the heavier side of one, in a world of speeds `size`. k.unseen, too.
        """
        for i in range(t.nv):
            k.most[i, b] = k.mass[t.mass_at[i] + i, b] * size
            k.unseen[i, b] = LOST * k.most[i, b]
        for r in range(n):
            i = k.active[r, b]
            for at in range(t.row_start[i], t.row_start[i + 1]):
                p = t.row_place[at]
                k.most[p, b] = k.most[p, b] + wp.abs(k.jac[at, b]) * largest

    @wp.func
    def partner(t: Topology, k: Work, i: int):
        """The other row of a contact with Coulomb's friction, else row i itself. What is given back is their
        sum and difference, whose terms are bounded by the larger of |J_n + mu J_t| and |J_n - mu J_t|.
        """
        if t.coulomb == 0 or t.row_kind[i] != CONTACT or t.row_sign[i] == 0:
            return i
        first = t.pair_row[t.row_index[i]]
        return wp.where(i == first, first + 1, first)

    @wp.func
    def length(t: Topology, k: Work, i: int, b: int):
        """|J_i|"""
        square = dtype(0.0)
        for at in range(t.row_start[i], t.row_start[i + 1]):
            square += k.jac[at, b] * k.jac[at, b]
        return wp.sqrt(wp.max(square, TINY))

    @wp.func
    def is_open(k: Work, i: int, w: dtype, size: dtype, b: int, share: dtype):
        """Whether J v' + d/h = w of row i is no violation, to `share` of the row's own scale."""
        return w >= -(share * k.own[i, b] + LEAST * size)

    @wp.func
    def adds_up(t: Topology, k: Work, b: int, n: int, size: dtype):
        """1 if every row is open on its own scale, and M dv = J' lambda, as it is given back, holds on the
        scale of what the data do to every body, its coordinates weighed by energy: its own momentum, those of
        its rows by themselves as far as they press, and what they exchange with it (at most k.most).
        """
        nt.mass_times(t, k, b)
        for i in range(t.nv):
            k.move[i, b] = ZERO
            moved = wp.min(wp.abs(k.balance[i, b]), k.most[i, b])
            k.momentum[i, b] = k.lost[i, b] / LOST + moved
        good = int(1)
        for r in range(n):
            i = k.active[r, b]
            lam = k.lam[i, b]
            w = k.rate[i, b]
            shift = t.row_start[partner(t, k, i)] - t.row_start[i]
            for at in range(t.row_start[i], t.row_start[i + 1]):
                p = t.row_place[at]
                j = k.jac[at, b]
                w += j * k.v[p, b]
                k.balance[p, b] = k.balance[p, b] - j * lam
                k.move[p, b] = k.move[p, b] + wp.max(wp.abs(j), wp.abs(k.jac[at + shift, b])) * lam
                k.momentum[p, b] = k.momentum[p, b] + wp.abs(j) * wp.min(k.alone[i, b], lam)
            if not is_open(k, i, w, size, b, OPEN):
                good = 0
        for j in range(t.nv):
            p = t.place[j]
            miss = wp.max(wp.abs(k.balance[p, b]) - k.lost[p, b], ZERO)
            told = (miss + ROUND * k.move[p, b]) / ENOUGH
            if not (told <= k.momentum[p, b]):
                held = int(0)
                for other in range(wp.max(j - 2, 0), wp.min(j + 3, t.nv)):
                    if t.dof_body[other] == t.dof_body[j]:
                        q = t.place[other]
                        there = k.momentum[q, b] * k.momentum[q, b] * k.mass[t.mass_at[p] + p, b]
                        if told * told * k.mass[t.mass_at[q] + q, b] <= there:
                            held = 1
                if held == 0:
                    good = 0
        return good

    @wp.func
    def see_all(t: Topology, k: Work, b: int):
        """Leave nothing of M (v' - v_free) to the rows' rounding from here on."""
        for i in range(t.nv):
            k.unseen[i, b] = ZERO

    @wp.func
    def find_islands(t: Topology, k: Work, b: int, n: int):
        """k.island: the first place that M and the rows that press couple a place to."""
        for i in range(t.nv):
            k.island[i, b] = i
        changed = int(1)
        while changed == 1:
            changed = int(0)
            for i in range(t.nv):
                for j in range(t.mass_first[i], i):
                    if k.mass[t.mass_at[i] + j, b] != ZERO:
                        name = wp.min(k.island[i, b], k.island[j, b])
                        if k.island[i, b] != name or k.island[j, b] != name:
                            changed = 1
                        k.island[i, b] = name
                        k.island[j, b] = name
            for r in range(n):
                i = k.active[r, b]
                name = int(t.nv)
                end = wp.where(k.lam[i, b] > PRESSES * k.alone[i, b], t.row_start[i + 1], t.row_start[i])
                for at in range(t.row_start[i], end):
                    name = wp.min(name, k.island[t.row_place[at], b])
                for at in range(t.row_start[i], end):
                    if k.island[t.row_place[at], b] != name:
                        changed = 1
                    k.island[t.row_place[at], b] = name

    @wp.func
    def island_momentum(t: Topology, k: Work, b: int, n: int):
        """k.momentum: all of an island, and what opening its rows gives to its heaviest mass."""
        find_islands(t, k, b, n)
        for i in range(t.nv):
            k.momentum[i, b] = ZERO
            k.island_mass[i, b] = ZERO
        for i in range(t.nv):
            p = k.island[i, b]
            own = k.lost[i, b] / LOST
            heavy = dtype(0.0)
            for j in range(t.mass_first[i], i + 1):
                heavy = wp.max(heavy, k.mass[t.mass_at[j] + j, b])
            turning = wp.sqrt(wp.abs(k.vfree[i, b]) * own * heavy)  # by the lever that gives most
            k.momentum[p, b] = k.momentum[p, b] + own + turning
            k.island_mass[p, b] = wp.max(k.island_mass[p, b], heavy)
        for r in range(n):
            i = k.active[r, b]
            if t.row_start[i + 1] > t.row_start[i]:
                p = k.island[t.row_place[t.row_start[i]], b]
                opening = wp.max(-k.rate[i, b], ZERO) / length(t, k, i, b)
                k.momentum[p, b] = k.momentum[p, b] + opening * k.island_mass[p, b]
                k.momentum[p, b] = wp.max(k.momentum[p, b], k.alone[i, b])

    @wp.func
    def is_earned(t: Topology, k: Work, b: int, n: int, size: dtype):
        """1 if every row is open on its own scale, nearly to the precision of the work, M dv = J' lambda
        holds as well (of `adds_up`), and none presses much harder than all momentum of its island.
        """
        good = int(1)
        for i in range(t.nv):
            miss = wp.abs(k.balance[i, b]) - k.lost[i, b] - CLOSE * k.move[i, b]
            if not (miss <= ENOUGH * k.momentum[i, b]):
                good = 0
        island_momentum(t, k, b, n)
        for r in range(n):
            i = k.active[r, b]
            if not is_open(k, i, k.rate[i, b] + nt.dot(t, k, k.v, i, b), size, b, EXACT):
                good = 0
            if t.row_start[i + 1] > t.row_start[i]:
                p = k.island[t.row_place[t.row_start[i]], b]
                longest = wp.max(length(t, k, i, b), length(t, k, partner(t, k, i), b))
                if not (k.lam[i, b] * longest <= MOST * k.momentum[p, b]):
                    good = 0
        return good

    return SimpleNamespace(bounds=bounds, adds_up=adds_up, see_all=see_all, is_earned=is_earned)
