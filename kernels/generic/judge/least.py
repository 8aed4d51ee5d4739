"""Impulses that the data of a step do not suggest: they must be the least that solve the rows.

Rows that yield a little (proximal point steps from nothing) ask for as much as there must be, so that opposed
impulses that only answer each other are told from those that a chain of bodies passes on.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..linear.held import make_held
from ..motion.mechanism import COLUMN, make_mechanism
from ..newton import GIVEN, SUMMED, make_newton
from ..topology import Topology
from ..work import V3, WORK, Island, Slot
from .earned import ROUNDED, make_earned

EARNED = {wp.float64: 2e-10, wp.float32: 1e-8}  # what is good enough of a row relative to its own terms
EXCHANGED = {wp.float64: 1e-13, wp.float32: 1e-8}  # what may be missing of M dv relative to impulses alone
PRESSED = 32.0  # sigma by which z of a smoothed row is at most, where w is nothing: exp(-32) is 1e-14
GROWN = 10.0  # by which rows may press a place harder than they do where they yield more
KEPT, HELD, OWN = 0, 1, 2  # what is the least: k.least; of smoothed rows by `held.py`; of v' by itself


@cached
def make_least(given: type, residual: str) -> SimpleNamespace:
    """Warp functions: the judge `is_earned`, after `adds_up`, and what comes before."""
    dtype = WORK
    nt = make_newton(given, residual)
    earned = make_earned(given, residual)
    partner, is_open = earned.partner, earned.is_open
    mech, MASS = make_mechanism(given), COLUMN["mass"]
    hard = residual == "hard"
    held = None if hard else make_held(given, residual)
    ZERO, ONE = dtype(0.0), dtype(1.0)
    ROUND, ENOUGH, EXACT = dtype(GIVEN[given]), dtype(SUMMED[given]), dtype(EARNED[given])
    close = EXCHANGED[given] + (0.0 if hard else GIVEN[given])
    CLOSE, FURTHER, LOST = dtype(close), dtype(close / ROUNDED), nt.LOST
    MORE, SHUT, TINY = dtype(GROWN), dtype(PRESSED), dtype(1e-30)

    @wp.func
    def see_all(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Leave nothing of M (v' - v_free) to the rows' rounding from here on."""
        for place in range(o.start, o.end):
            k.unseen[k.block[place]] = V3()

    @wp.func
    def ease(k: wp.ref[Slot], o: Island):
        """Smoothed rows whose w is nothing press so little that it stays nothing: rows that oppose each other
        could press by anything. What the bodies need of it Newton's method adds again.
        """
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.z[r] = wp.min(k.z[r], SHUT * k.sigma[r])

    @wp.func(inline=False)
    def least_pressed(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.best_z: the least impulses, in D, of the rows that press by which M dv = J' lambda; what smoothed
        rows press against each other beyond these is the noise's, not the data's.
        """
        nt.mass_times(t, k, o)
        for r in range(o.row, o.last_row):
            k.res[r] = ZERO
            k.p[r] = wp.where(k.z[r] > ZERO, ONE, ZERO)
            k.slack[r] = ONE - k.p[r]
        nt.factor(t, k, o, ZERO)
        nt.direction(t, k, o, ZERO, 0, ZERO)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.best_z[r] = wp.abs(k.dz[r]) * k.p[r] * k.inverse[r]

    @wp.func
    def changed(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.best_v: the size of the terms of M (v' - v_free), which cancel where stiff springs tie bodies."""
        for place in range(o.start, o.end):
            k.best_v[k.block[place]] = V3()
        for place in range(o.start, o.end):
            i = k.block[place]
            row = t.mass_at[i]
            change = k.v[i] - k.vfree[i]
            terms = nt.sized(k.mass[row + i], change)
            for j in range(t.mass_first[i], i):
                m = k.mass[row + j]
                terms += nt.sized(m, k.v[j] - k.vfree[j])
                k.best_v[j] = k.best_v[j] + nt.sized(wp.transpose(m), change)
            k.best_v[i] = k.best_v[i] + terms

    @wp.func
    def passed_on(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """What impulses that the bodies of row r are given back (k.move) change of its velocity."""
        change = dtype(0.0)
        for e in range(k.entry[r + 1] - k.entry[r]):
            b = t.row_block[k.pattern[r] + e]
            mass = wp.get_diag(k.mass[t.mass_at[b] + b])
            change += wp.dot(wp.abs(k.jac[k.entry[r] + e]), wp.cw_div(k.move[b], mass))
        return change

    @wp.func
    def weight(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """The largest impulse that row r stops a free body by, as v_free has it: what is heavy brings its
        weight to what is light. Of what hangs in joints that is no measure: these may all but hold it.
        """
        most = dtype(0.0)
        for e in range(k.entry[r + 1] - k.entry[r]):
            b = t.row_block[k.pattern[r] + e]
            body = t.dof_body[wp.max(t.block_dof[3 * b], 0)]
            if t.free_block[body] == b:
                j = k.jac[k.entry[r] + e]
                v = k.vfree[b]
                size = j[0] * j[0] + j[1] * j[1]
                closes = wp.abs(j[0] * v[0]) + wp.abs(j[1] * v[1])
                most = wp.max(most, mech.number(t, k, MASS, body) * closes / wp.max(size, TINY))
        return most

    @wp.func
    def brought(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """The largest impulse that makes a pressing row's own terms, or stops a free body of it; of a
        contact's two rows that which answers more: the other may all but jam. What a row moves elsewhere is
        no measure of it.
        """
        most = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and k.lam[r] > ZERO:
                most = wp.max(most, k.own[r] / wp.max(k.diag[r], k.diag[partner(t, k, r)]))
                most = wp.max(most, weight(t, k, r))
        return most

    @wp.func(inline=False)
    def is_earned(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, asked: int, rowwise: int):
        """1 if every row is open on its own scale, nearly to the precision of the work, M dv = J' lambda
        holds as well (of `adds_up`), and rows press no place much harder than they must (k.least), nor any
        row than it must if `rowwise`: a fixed point that runs away does so row by row. What is given back of
        a contact may round by no more than its rows. Under Coulomb's friction what impulses pass on through
        bodies at rest counts in the velocities of their rows. `asked`: KEPT, HELD (what presses hard is held
        to find the least) or, of hard rows in single precision, OWN.
        """
        good = int(1)
        changed(t, k, o)
        for place in range(o.start, o.end):
            i = k.block[place]
            miss = wp.abs(k.balance[i]) - k.lost[i] - CLOSE * k.move[i] - LOST * k.best_v[i]
            for j in range(3):
                if not (miss[j] <= ENOUGH * k.momentum[i][j]):
                    good = 0
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                passed = ZERO
                if t.coulomb == 1:
                    passed = FURTHER * passed_on(t, k, r)
                if not is_open(t, k, r, EXACT, passed):
                    good = 0
        if wp.static(not hard):
            if asked != wp.static(HELD):
                least_pressed(t, k, o)
            elif held.least(t, k, o) == 0:
                return 0
        elif wp.static(given is wp.float32):
            if asked == wp.static(OWN):
                least_pressed(t, k, o)
        most = dtype(0.0)  # what M dv = J' lambda may miss of more is beyond what momenta are judged by
        if wp.static(hard and given is wp.float32):
            most = brought(t, k, o)
        for place in range(o.start, o.end):
            i = k.block[place]
            k.move[i] = V3()
            k.best_v[i] = V3()
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                least = k.least[r]
                if wp.static(not hard):
                    least = k.best_z[r]
                if wp.static(hard and given is wp.float32):
                    if asked == wp.static(OWN):
                        least = k.best_z[r]
                    if not (CLOSE * k.lam[r] <= MORE * ENOUGH * most):
                        good = 0
                spare = MORE * (least + k.alone[r]) - k.lam[r]
                if rowwise == 1 and not (spare >= ZERO):
                    good = 0
                start = k.entry[r]
                shift = k.entry[partner(t, k, r)] - start
                for e in range(k.entry[r + 1] - start):
                    b = t.row_block[k.pattern[r] + e]
                    size = wp.abs(k.jac[start + e])
                    excess = wp.max(wp.abs(k.jac[start + shift + e]) - size, V3())
                    k.move[b] = k.move[b] + k.lam[r] * excess
                    k.best_v[b] = k.best_v[b] + spare * size
                    k.momentum[b] = k.momentum[b] + k.lam[r] * size
        for place in range(o.start, o.end):
            i = k.block[place]
            for j in range(3):
                if not (k.best_v[i][j] >= ZERO and ROUND * k.move[i][j] <= ENOUGH * k.momentum[i][j]):
                    good = 0
        return good

    return SimpleNamespace(see_all=see_all, ease=ease, is_earned=is_earned, MORE=MORE)
