"""Newton's method on hard rows, one change of their set after the other.

Where all rows that leave their set do so at once sets change back and forth. Here the direction of Newton's
method is followed to where the first row leaves its set, by the sign of z; from there the direction of the
set behind, and so on until what the equations missed is used up. As rows yield a little the equations have
one solution for every share of that, so that the way never turns back (the parametric principal pivoting
method: Cottle, Pang and Stone, The Linear Complementarity Problem, 4.5). From the last step's solution about
a pivot is made for every row that is in another set now. The matrix differs from the one that was factored
by a term of rank one a pivot (Sherman and Morrison), so each costs a solution instead of a factor.
"""

import warp as wp

from ...factories import cached
from ..newton import PROXIMAL, make_newton
from ..topology import Topology
from ..work import M33, V3, WORK, Island, Slot

SOFTENED = 1e-10  # rows yield by so much more of diag(A), so that sums of terms of rank one keep digits
PASSED = 1e-8  # of a unit of velocity: what a row that leaves by less does next is another step's to say
DIGITS = 1e-13  # least share that a term may leave of a row's own stiffness: else all is factored anew


@cached
def make_pivots(given: type) -> wp.Function:
    """follow(t, k, o, most) -> pivots made, at most so many: from (k.v, k.z) along k.move, k.dz of the set
    k.p, whose factor is at hand; 0 if that was Newton's whole step. Uses k.upper, k.inner_v, k.res, k.cross
    and k.mode. After pivots k.p is no set: the factor at hand is of none.
    """
    nt = make_newton(given, "hard")
    ZERO, HALF, ONE, TINY = WORK(0.0), WORK(0.5), WORK(1.0), WORK(1e-30)
    SEEN = WORK(PASSED)
    SOFTER, TAU, LEAST = WORK(SOFTENED), WORK(PROXIMAL + SOFTENED), WORK(DIGITS)

    @wp.func
    def cells(o: Island):
        """How many matrices hold a vector."""
        return (o.end - o.start + 2) // 3

    @wp.func(inline=False)
    def keep(k: wp.ref[Slot], o: Island, m: int):
        """k.move as vector m."""
        at = m * cells(o)
        for c in range(cells(o)):
            i = o.start + 3 * c
            x, y, z = k.move[k.block[i]], V3(), V3()
            if i + 1 < o.end:
                y = k.move[k.block[i + 1]]
            if i + 2 < o.end:
                z = k.move[k.block[i + 2]]
            k.upper[at + c] = M33(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2])

    @wp.func(inline=False)
    def less(k: wp.ref[Slot], o: Island, m: int, share: WORK):
        """Take a share of vector m off k.move."""
        at = m * cells(o)
        for c in range(cells(o)):
            i = o.start + 3 * c
            q = share * k.upper[at + c]
            k.move[k.block[i]] = k.move[k.block[i]] - V3(q[0, 0], q[0, 1], q[0, 2])
            if i + 1 < o.end:
                k.move[k.block[i + 1]] = k.move[k.block[i + 1]] - V3(q[1, 0], q[1, 1], q[1, 2])
            if i + 2 < o.end:
                k.move[k.block[i + 2]] = k.move[k.block[i + 2]] - V3(q[2, 0], q[2, 1], q[2, 2])

    @wp.func(inline=False)
    def respond(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, r: int, m: int):
        """k.move: J_r' solved for, with the matrix that m terms were added to."""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        for e in range(k.entry[r + 1] - k.entry[r]):
            k.move[t.row_block[k.pattern[r] + e]] = k.jac[k.entry[r] + e]
        nt.env.solve(k.factor, k.first, k.at, k.block, k.move, o.start, o.end)
        for j in range(m):
            less(k, o, j, k.cross[o.row + j] * nt.dot(t, k, k.move, k.mode[o.row + j]))

    @wp.func(inline=False)
    def nearest(k: wp.ref[Slot], o: Island, last: int, left: WORK):
        """The share of the direction up to where a row leaves its set, of what is left, and that row: one
        that ends outside by more than what rows yield.
        """
        least = left + ZERO
        which = int(-1)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and r != last:
                side = wp.where(k.p[r] > HALF, ONE, -ONE)
                fall = -side * k.dz[r]
                height = wp.max(side * k.z[r], ZERO)
                if height < least * fall and left * fall - height > SEEN * k.unit[r]:
                    least = height / fall
                    which = r + 0
        return least, which

    @wp.func
    def turn(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, turned: WORK):
        """The direction turned by so much of k.move."""
        for g in range(o.group, o.last_group):
            nt.turn_group(t, k, g, k.move, k.res)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                change = turned * k.res[r]
                if k.p[r] > HALF:
                    change = change * k.scale[r] / (TAU * k.diag[r])
                k.dz[r] = k.dz[r] - change
        for place in range(o.start, o.end):
            i = k.block[place]
            k.inner_v[i] = k.inner_v[i] + turned * k.move[i]

    @wp.func(inline=False)
    def change_set(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, r: int, m: int):
        """Let row r change sets, to which the matrix at hand responds by k.move; 0 if that has no digits."""
        stiff = ONE / (TAU * k.diag[r])
        own = stiff * nt.dot(t, k, k.move, r)
        slope, turned = ZERO + ZERO, ZERO + ZERO
        if k.p[r] > HALF:
            rest = ONE - own
            if not (rest > LEAST):
                return 0
            pressed = k.dz[r] * k.inverse[r]
            turned = -pressed / rest
            slope = pressed / stiff - turned * own / stiff
            k.cross[o.row + m] = -stiff / rest
        else:
            rest = ONE + own
            turned = stiff * k.dz[r] / rest
            slope = turned * k.scale[r]
            k.cross[o.row + m] = stiff / rest
        k.p[r] = wp.where(k.p[r] > HALF, ZERO, ONE)
        k.slack[r] = ONE - k.p[r]
        turn(t, k, o, turned)
        k.dz[r] = slope
        k.mode[o.row + m] = r
        keep(k, o, m)
        return 1

    @wp.func(inline=False)
    def pivot(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, r: int, kept: int):
        """Let row r change sets; how many terms the matrix has beside its factor then, -1 if it cannot be."""
        m = wp.where((kept + 1) * cells(o) > k.upper.shape[0] or kept >= o.last_row - o.row, -1, kept)
        for again in range(2):
            if m < 0 or again == 1:
                nt.factor(t, k, o, SOFTER)
                m = 0
            respond(t, k, o, r, m)
            if change_set(t, k, o, r, m) == 1:
                return m + 1
        return -1

    @wp.func
    def advance(k: wp.ref[Slot], o: Island, step: WORK):
        for place in range(o.start, o.end):
            i = k.block[place]
            k.v[i] = k.v[i] + step * k.inner_v[i]
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.z[r] = k.z[r] + step * k.dz[r]

    @wp.func
    def undecided(k: wp.ref[Slot], o: Island):
        """Whether a row is in neither set, z = 0: Newton's step says in which."""
        out = bool(False)
        for r in range(o.row, o.last_row):
            out = out or (k.acting[r] > 0 and k.p[r] == HALF)
        return out

    @wp.func(inline=False)
    def follow(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, most: int):
        for place in range(o.start, o.end):
            k.inner_v[k.block[place]] = k.move[k.block[place]]
        left = ONE + ZERO
        m, pivots, row = int(0), int(0), int(-1)
        going = int(1)
        if undecided(k, o):
            advance(k, o, left)
            going = 0
        while going == 1:
            step, next = nearest(k, o, row, left)
            advance(k, o, step)
            left -= step
            row = next + 0
            going = wp.where(row >= 0 and pivots < most, 1, 0)
            if going == 1:
                m = pivot(t, k, o, row, m)
                pivots += 1
                going = wp.where(m < 0, 0, 1)
        if pivots > 0:
            for r in range(o.row, o.last_row):
                if k.acting[r] > 0:
                    k.z[r] = wp.where(k.p[r] > HALF, wp.max(k.z[r], TINY), wp.min(k.z[r], -TINY))
                    k.p[r] = -ONE
        return pivots

    return follow
