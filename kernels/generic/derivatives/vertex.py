"""Which rows of hard contact a derivative holds where they hold more than the bodies can follow.

Rows whose J' are dependent leave lambda free along null vectors of J', and all of them held at once are no
limit of the step's derivatives beside it. Those hold a basic solution: its rows with lambda > 0 are
independent, a vertex of the lambdas that solve the step. It is reached by walking along null vectors until a
row is used up, which counts as not pressing then. With Anitescu's friction the walk goes on as in the simplex
method, to the vertex of the step where coordinates are moved a little, by numbers of no pattern: of rows that
open there impulses go to others. With Coulomb's friction, whose rows are no such program's, it goes to the
row that is used up first. A null vector is what the factor of M + J' W J, W large, leaves of numbers of no
pattern: the part that moves no body.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..newton import make_newton
from ..topology import CONTACT, Topology
from ..work import ROWS, V3, WORK, Island, Slot

ROUNDS = 128  # of an island at most; rows that still depend on each other are held by least squares
PROJECTIONS = 8
SEEN = 1e-5  # of a row's part of a null vector, where the numbers that it is made of are about 1
SETTLED = 1e-7  # change of a null vector by a projection, relative to its largest part
OWN = 1e-8  # what rows of one group leave of each other's momenta, if they depend on each other alone
PART = 1e-5  # of a row in a null vector, relative to the largest
TOUCHING = 1e-11  # relative velocity of a row that touches, relative to those in the data
CLOSES = 1e-6  # of a gap's change, relative to the largest
RESTS = 1e-3  # speed of bodies at rest, relative to those in the data
TURNS = 16  # at which rows that left press again
LEFT = 1e-14  # of an impulse that another one's walk uses up at the same place


GOLDEN, HALF = WORK(0.6180339887498949), WORK(0.5)  # multiples of the first never repeat, modulo 1


@wp.func
def scattered(i: int):
    """The i-th number of no pattern, of -1/2 to 1/2; i >= 0."""
    x = GOLDEN * WORK(i + 1)
    return x - wp.floor(x) - HALF


@cached
def make_vertex(given: type, residual: str) -> SimpleNamespace:
    """open(t, k): k.aimed, and k.lam in k.least. walk(t, k, o, yielding): k.lam, k.p and k.slack of a basic
    solution of an island; those of rows that do not depend on others are left as they are. Uses k.factor,
    k.dz, k.weight, k.divisor, k.move.
    """
    nt = make_newton(given, residual)
    ZERO, HALF, ONE = WORK(0.0), WORK(0.5), WORK(1.0)
    TOUCHES = WORK(TOUCHING)
    HUGE = WORK(1e300)

    @wp.func
    def scatter(k: wp.ref[Slot], o: Island):
        """k.dz: numbers of no pattern for the rows that press, in units of their own impulses; how many."""
        n = int(0)
        for r in range(o.row, o.last_row):
            k.dz[r] = ZERO
            if k.acting[r] > 0 and k.p[r] == ONE:
                k.dz[r] = (ONE + scattered(k.row[r])) / wp.sqrt(k.diag[r])
                n += 1
        return n

    @wp.func
    def open(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.aimed: how gaps change where coordinates do by numbers of no pattern. k.least: lambda."""
        for i in range(t.blocks):
            k.move[i] = V3()
        for j in range(t.nv):
            k.move[t.dof_block[j]][t.dof_part[j]] = scattered(j)
        for r in range(k.count[wp.static(ROWS)]):
            k.least[r] = k.lam[r]
            k.aimed[r] = ZERO
            if k.acting[r] > 0:
                k.aimed[r] = nt.dot(t, k, k.move, r)
        for r in range(k.count[wp.static(ROWS)]):
            if t.row_kind[k.row[r]] == CONTACT and t.row_sign[k.row[r]] < 0:
                mean = HALF * (k.aimed[r] + k.aimed[r - 1])  # of the rows J_n +- mu J_t
                k.aimed[r - 1] = mean
                k.aimed[r] = mean

    @wp.func(inline=False)
    def project(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.dz less what moves bodies; its largest part and the largest change."""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        for r in range(o.row, o.last_row):
            k.weight[r] = k.dz[r]
        nt.add_pushes(t, k, o)
        nt.env.solve(k.factor, k.first, k.at, k.block, k.move, o.start, o.end)
        size = ZERO + ZERO
        change = ZERO + ZERO
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and k.p[r] == ONE:
                less = k.divisor[r] * k.inverse[r] * nt.dot(t, k, k.move, r)
                value = k.dz[r] - less
                k.dz[r] = value
                unit = wp.sqrt(k.diag[r])
                size = wp.max(size, unit * wp.abs(value))
                change = wp.max(change, unit * wp.abs(less))
        return size, change

    @wp.func
    def depends(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Whether k.dz became a null vector; its largest part."""
        count = int(0)
        while count < wp.static(PROJECTIONS):
            size, change = project(t, k, o)
            if not (size > WORK(wp.static(SEEN))):
                return ZERO
            if change <= WORK(wp.static(SETTLED)) * size:
                return size
            count += 1
        return ZERO

    @wp.func
    def alone(k: wp.ref[Slot], start: int, end: int):
        """Whether a group's part of k.dz is a null vector by itself."""
        entries = k.entry[start + 1] - k.entry[start]
        for e in range(entries):
            total = V3()
            terms = V3()
            for r in range(start, end):
                push = k.dz[r] * k.jac[k.entry[r] + e]
                total += push
                terms += wp.abs(push)
            size = wp.max(terms[0], wp.max(terms[1], terms[2]))
            for part in range(3):
                if wp.abs(total[part]) > WORK(wp.static(OWN)) * size:
                    return int(0)
        return int(1)

    @wp.func
    def way(k: wp.ref[Slot], start: int, end: int):
        """k.dz in the direction in which rows that open give their impulses to others."""
        slope = ZERO + ZERO
        for r in range(start, end):
            slope += k.dz[r] * k.aimed[r]
        if slope < ZERO:
            for r in range(start, end):
                k.dz[r] = -k.dz[r]

    @wp.func
    def first(k: wp.ref[Slot], start: int, end: int, sign: WORK, least: WORK):
        """Of these rows the one that walking along sign k.dz uses up first, and how far that is."""
        row = int(-1)
        far = ZERO + HUGE
        for r in range(start, end):
            step = sign * k.dz[r]
            if step * wp.sqrt(k.diag[r]) > least:
                if k.lam[r] < far * step:
                    far = k.lam[r] / step
                    row = r + 0
        return row, sign * far

    @wp.func
    def leave(t: wp.ref[Topology], k: wp.ref[Slot], start: int, end: int, least: WORK):
        """Walk along k.dz until a row of these is used up."""
        way(k, start, end)
        row, far = first(k, start, end, ONE, least)
        if row < 0 or t.coulomb == 1:
            back, less = first(k, start, end, -ONE, least)
            if back >= 0 and (row < 0 or -less < far):
                row = back + 0
                far = less + ZERO
        if row >= 0:
            for r in range(start, end):
                if k.dz[r] != ZERO:
                    k.lam[r] = wp.max(k.lam[r] - far * k.dz[r], WORK(wp.static(LEFT)) * k.lam[r])
            k.lam[row] = ZERO
            k.p[row] = ZERO
            k.slack[row] = ONE

    @wp.func
    def part(k: wp.ref[Slot], start: int, end: int):
        """The largest part of k.dz of these rows."""
        size = ZERO + ZERO
        for r in range(start, end):
            size = wp.max(size, wp.abs(k.dz[r]) * wp.sqrt(k.diag[r]))
        return size

    @wp.func
    def advance(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: WORK):
        """A row leaves every group that depends on itself alone; if there is none, one leaves the island."""
        found = int(0)
        for g in range(o.group, o.last_group):
            start = k.group[g]
            end = k.group[g + 1]
            own = part(k, start, end)
            if own > WORK(wp.static(SEEN)) and alone(k, start, end) == 1:
                leave(t, k, start, end, WORK(wp.static(PART)) * own)
                found = 1
        if found == 0:
            leave(t, k, o.row, o.last_row, WORK(wp.static(PART)) * size)

    @wp.func
    def follow(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.move: how bodies follow the gaps of rows that press; the largest change of these."""
        size = ZERO + ZERO
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
            if k.acting[r] > 0 and k.p[r] == ONE:
                k.weight[r] = -k.divisor[r] * k.inverse[r] * k.aimed[r]
                size = wp.max(size, wp.abs(k.aimed[r]) / wp.sqrt(k.diag[r]))
        nt.add_pushes(t, k, o)
        nt.env.solve(k.factor, k.first, k.at, k.block, k.move, o.start, o.end)
        return WORK(wp.static(CLOSES)) * size

    @wp.func
    def agree(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Whether bodies at rest can follow all rows that press: no kink, any of them give the derivative."""
        for r in range(o.row, o.last_row):
            moves = ZERO + ZERO
            for e in range(k.entry[r + 1] - k.entry[r]):
                moves += wp.dot(wp.abs(k.jac[k.entry[r] + e]), wp.abs(k.v[t.row_block[k.pattern[r] + e]]))
            if k.acting[r] > 0 and moves > WORK(wp.static(RESTS)) * k.unit[r]:
                return int(0)
        most = follow(t, k, o)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and k.p[r] == ONE:
                if wp.abs(k.aimed[r] + nt.dot(t, k, k.move, r)) > most * wp.sqrt(k.diag[r]):
                    return int(0)
        return int(1)

    @wp.func
    def enter(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Rows that left and that bodies would close as the others' gaps change press again, one of a group;
        how many.
        """
        closes = follow(t, k, o)
        found = int(0)
        for g in range(o.group, o.last_group):
            row = int(-1)
            least = -closes
            for r in range(k.group[g], k.group[g + 1]):
                if k.acting[r] > 0 and k.p[r] == ZERO and k.z[r] > -TOUCHES * k.unit[r]:
                    opens = (k.aimed[r] + nt.dot(t, k, k.move, r)) / wp.sqrt(k.diag[r])
                    if opens < least:
                        least = opens
                        row = r + 0
            if row >= 0:
                k.p[row] = ONE
                k.slack[row] = ZERO
                found += 1
        return found

    @wp.func(inline=False)
    def walk(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, yielding: WORK):
        if scatter(k, o) < 2:
            return
        nt.factor(t, k, o, yielding)
        if t.coulomb == 0 and agree(t, k, o) == 1:
            return
        rounds = int(0)
        turns = int(0)
        moved = int(1)
        while rounds < wp.static(ROUNDS) and scatter(k, o) > 1:
            rounds += 1
            nt.factor(t, k, o, yielding)
            size = depends(t, k, o)
            if size > ZERO:
                advance(t, k, o, size)
                moved = 1
            else:
                turns += 1
                if moved == 0 or t.coulomb == 1 or turns > wp.static(TURNS):
                    rounds = wp.static(ROUNDS)
                elif enter(t, k, o) == 0:
                    rounds = wp.static(ROUNDS)
                moved = 0
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and k.p[r] == ONE and k.lam[r] == ZERO:  # it entered, and depends on none
                k.p[r] = ZERO
                k.slack[r] = ONE

    return SimpleNamespace(open=open, walk=walk)
