"""What the data allow a step of the generic kernels to exchange: the judge of impulses beside the equations.

Rows that all but exclude each other can be answered by opposed impulses of any size, so an error relative to
the impulses proves nothing, and neither does one relative to what happens elsewhere in the world. Here every
place is judged by its own momenta, and impulses that these do not suggest must be the least that solve the
rows: rows that yield a little (proximal point steps from nothing) ask for as much.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from .newton import ACCEPTED, GIVEN, SUMMED, make_newton
from .topology import CONTACT, Topology
from .work import WORK, Work

ROW = 10.0  # what is good enough of a row relative to its own terms, in units of ACCEPTED
EARNED = {wp.float64: 2e-10, wp.float32: 1e-8}  # and where the data alone do not suggest its impulses
ROUNDED = 1e-12  # and relative to the terms of J v'
EXCHANGED = {wp.float64: 1e-13, wp.float32: 1e-8}  # what may be missing of M dv relative to impulses alone
GROWN = 10.0  # by which rows may press a place harder than they do where they yield more


@cached
def make_earned(given: type) -> SimpleNamespace:
    """Warp functions `share_units`, `bounds`, `adds_up`, `see_all` and `is_earned`."""
    dtype = WORK
    nt = make_newton(given, "hard")
    ZERO = dtype(0.0)
    LOST, ROUND, ENOUGH = nt.LOST, dtype(GIVEN[given]), dtype(SUMMED[given])
    OPEN, EXACT, LEAST = dtype(ROW * ACCEPTED[given]), dtype(EARNED[given]), dtype(ROUNDED)
    CLOSE = dtype(EXCHANGED[given])
    MORE, TINY = dtype(GROWN), dtype(1e-30)

    @wp.func
    def share_units(t: Topology, k: Work, b: int, n: int):
        """k.unit, from what v_free closes (k.unit) and a row's own terms: rows of bodies that neither hang
        together nor touch are no measure of each other.
        """
        for i in range(t.nv):
            k.island[i, b] = i
            k.move[i, b] = ZERO
        changed = int(1)
        while changed == 1:
            changed = int(0)
            for r in range(n):
                i = k.active[r, b]
                one = t.row_trees[4 * i]
                two = int(one)
                if k.unit[i, b] > ZERO and t.row_trees[4 * i + 3] > 0:
                    two = t.row_trees[4 * i + 2]
                name = wp.min(k.island[one, b], k.island[two, b])
                if k.island[one, b] != name or k.island[two, b] != name:
                    changed = 1
                k.island[one, b] = name
                k.island[two, b] = name
        for r in range(n):
            i = k.active[r, b]
            p = k.island[t.row_trees[4 * i], b]
            k.move[p, b] = wp.max(k.move[p, b], k.unit[i, b])
        for r in range(n):
            i = k.active[r, b]
            shared = k.move[k.island[t.row_trees[4 * i], b], b]
            k.unit[i, b] = wp.max(wp.max(shared, k.own[i, b]), TINY)

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
    def is_open(t: Topology, k: Work, i: int, b: int, share: dtype):
        """Whether J v' + d/h = w of row i is no violation, to `share` of the row's own scale."""
        w = k.rate[i, b]
        terms = dtype(0.0)
        for at in range(t.row_start[i], t.row_start[i + 1]):
            change = k.jac[at, b] * k.v[t.row_place[at], b]
            w += change
            terms += wp.abs(change)
        return w >= -(share * k.own[i, b] + LEAST * wp.max(terms, k.unit[i, b]))

    @wp.func
    def adds_up(t: Topology, k: Work, b: int, n: int):
        """1 if every row is open on its own scale, and M dv = J' lambda, as it is given back, holds on the
        scale of what the data do to every body, its coordinates weighed by energy: its own momentum, those of
        its rows by themselves as far as they press, and what they exchange with it (at most k.most). Nor may
        rounding of a row's impulse count in its velocity.
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
            shift = t.row_start[partner(t, k, i)] - t.row_start[i]
            for at in range(t.row_start[i], t.row_start[i + 1]):
                p = t.row_place[at]
                j = k.jac[at, b]
                k.balance[p, b] = k.balance[p, b] - j * lam
                k.move[p, b] = k.move[p, b] + wp.max(wp.abs(j), wp.abs(k.jac[at + shift, b])) * lam
                k.momentum[p, b] = k.momentum[p, b] + wp.abs(j) * wp.min(k.alone[i, b], lam)
            if not is_open(t, k, i, b, OPEN):
                good = 0
            if not (ROUND * k.diag[i, b] * lam <= ENOUGH * k.unit[i, b]):
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
    def is_earned(t: Topology, k: Work, b: int, n: int):
        """1 if every row is open on its own scale, nearly to the precision of the work, M dv = J' lambda
        holds as well (of `adds_up`), and rows press no place much harder than they must (k.least). What is
        given back of a contact may round by no more than its rows.
        """
        good = int(1)
        for i in range(t.nv):
            miss = wp.abs(k.balance[i, b]) - k.lost[i, b] - CLOSE * k.move[i, b]
            if not (miss <= ENOUGH * k.momentum[i, b]):
                good = 0
            k.move[i, b] = ZERO
            k.best_v[i, b] = ZERO
        for r in range(n):
            i = k.active[r, b]
            if not is_open(t, k, i, b, EXACT):
                good = 0
            spare = MORE * (k.least[i, b] + k.alone[i, b]) - k.lam[i, b]
            if t.coulomb == 1 and not (spare >= ZERO):  # a fixed point that runs away does so row by row
                good = 0
            shift = t.row_start[partner(t, k, i)] - t.row_start[i]
            for at in range(t.row_start[i], t.row_start[i + 1]):
                p = t.row_place[at]
                j = wp.abs(k.jac[at, b])
                excess = wp.max(wp.abs(k.jac[at + shift, b]) - j, ZERO)
                k.move[p, b] = k.move[p, b] + excess * k.lam[i, b]
                k.best_v[p, b] = k.best_v[p, b] + j * spare
        for i in range(t.nv):
            if not (k.best_v[i, b] >= ZERO and ROUND * k.move[i, b] <= ENOUGH * k.momentum[i, b]):
                good = 0
        return good

    return SimpleNamespace(
        share_units=share_units,
        bounds=bounds,
        adds_up=adds_up,
        see_all=see_all,
        is_earned=is_earned,
        MORE=MORE,
    )
