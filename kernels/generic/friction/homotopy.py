"""Coulomb's hard friction of an island by following a path: Lemke's method on what every contact does.

s times a covering vector is added to d/h and to the sliding velocities, so large that at s = 1 the impulses
at hand are a solution. At given modes (`modes.py`) a solution is linear in s: it is followed to where a
contact changes what it does, from there in the modes behind, in the direction of s that leads into them, and
so on to s = 0. Contacts yield by tau of what they press more than at the start, so that what is solved is a
linear complementarity problem whose matrix is strictly copositive, whatever the friction: its path from
nothing can end nowhere but at s = 0 (Cottle, Pang and Stone, The Linear Complementarity Problem, 4.4; Stewart
and Trinkle 1996). Nothing promises that of a path from other impulses, but it is shorter. The covering vector
is random, so that no two contacts change at once. What the yielding leaves is the next path's covering
vector, with less of it: the proximal point method. A pivot costs a part of a factor and one solution.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..newton import make_newton
from ..topology import Topology
from ..work import LOOKS, V3, WORK, Island, Slot
from .matrix import HOLDS, OFF, SLIDES
from .modes import PROXIMAL, make_modes

OPENS, STICKS, RISES, FALLS = 0, 1, 2, 3  # a contact: off, held, sliding with J_t v' below or above zero
PIVOTS, COLD_PIVOTS, MORE_PIVOTS = 1, 6, 20  # at most: by row, by row from nothing, and more
PATIENCE = 12  # times as many by row where an island is looked at again, for each time
COUNTED = 500  # rows at most, of which most are far where there are more
CORRECTED = 8  # pivots after which rounding is taken off
SPREAD = 0.5  # of the covering vector of a path from nothing, relative to its least
APART = (
    1e-3  # by which what is open, slides or presses does so where other paths begin, of the problem's size
)
TRIALS = 3  # paths from nothing
FARTHEST = 1e3  # s at which a path that leads away is left
STAGES = 4  # paths after the first
YIELDS_MORE = 100.0  # tau, from one path from nothing to the next, where an island is looked at again
LESS, LEAST = 0.02, 2e-12  # tau, from one to the next, and at the end
ENOUGH = 2e-11  # residual at which there is no further one


@wp.struct
class Path:
    """Where a path stands: `way` is 1 where s grows, -1 where it falls. Border `border` of row `row` was
    crossed last, as it is seen from the modes behind it; `next_row` and `next_border` are where it leads.
    """

    s: WORK
    way: WORK
    tau: WORK
    row: int
    border: int
    next_row: int
    next_border: int


@cached
def make_homotopy(given: type) -> SimpleNamespace:
    """from_nothing(t, k, o, size) and from_here(t, k, o, size): k.v, k.a and k.mode at the end of a path,
    with which rows yield no more than to ENOUGH if it arrived.
    """
    dtype = WORK
    nt, modes = make_newton(given, "hard"), make_modes(given)
    ZERO, HALF, ONE, HUGE, TAU = dtype(0.0), dtype(0.5), dtype(1.0), dtype(1e300), dtype(PROXIMAL)
    WIDE, SMALL, FAR = dtype(SPREAD), dtype(APART), dtype(FARTHEST)
    MORE, SMALLER, SMALLEST, GOOD = dtype(YIELDS_MORE), dtype(LESS), dtype(LEAST), dtype(ENOUGH)

    @wp.func
    def random(k: wp.ref[Slot], r: int, seed: int):
        """A number between 0 and 1 that belongs to the scene's row."""
        return dtype(wp.randf(wp.rand_init(seed, k.row[r])))

    @wp.func
    def state(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """What the contact or limit that begins at row r does."""
        if modes.begins_pair(t, k, r):
            if k.mode[r + 1] == SLIDES:
                return FALLS
            if k.mode[r] == SLIDES:
                return RISES
        return wp.where(k.mode[r] == HOLDS, STICKS, OPENS)

    @wp.func
    def become(t: wp.ref[Topology], k: wp.ref[Slot], r: int, now: int):
        """Let the contact or limit that begins at row r do something else."""
        k.mode[r] = wp.where(now == STICKS, HOLDS, wp.where(now == RISES, SLIDES, OFF))
        if now == OPENS or now == FALLS:
            k.a[r] = ZERO
        if modes.begins_pair(t, k, r):
            k.mode[r + 1] = wp.where(now == STICKS, HOLDS, wp.where(now == FALLS, SLIDES, OFF))
            if now == OPENS or now == RISES:
                k.a[r + 1] = ZERO

    @wp.func
    def yields(t: wp.ref[Topology], k: wp.ref[Slot], r: int, tau: dtype):
        """By what J v' of a row rises with its impulse: the same for both rows of a pair, twice what their
        mean does.
        """
        if modes.begins_pair(t, k, r):
            return tau * (k.diag[r] + k.diag[r + 1])
        if modes.follows(t, k, r):
            return tau * (k.diag[r - 1] + k.diag[r])
        return tau * k.diag[r]

    @wp.func
    def stiffen(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, tau: dtype):
        """k.p of the modes at hand."""
        for r in range(o.row, o.last_row):
            k.p[r] = ZERO
            if k.acting[r] > 0 and k.mode[r] != OFF:
                k.p[r] = ONE / yields(t, k, r, tau)
                if k.mode[r] == SLIDES:
                    k.p[r] = k.p[r] + k.p[r]

    @wp.func
    def first_place(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, r: int):
        """The first place of the order of elimination that row r moves; of all places for r < 0."""
        if r < 0:
            return o.start
        place = o.end
        for e in range(k.entry[r + 1] - k.entry[r]):
            place = wp.min(place, k.place[t.row_block[k.pattern[r] + e]])
        return place

    @wp.func
    def expected(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """The impulse at which row r in its mode does not yield."""
        if k.mode[r] == SLIDES:
            return k.slack[r] + k.slack[modes.partner(t, k, r)]
        return k.slack[r]

    @wp.func(inline=False)
    def correct(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Take k.v, k.a and k.total onto the path at the modes and s at hand."""
        for r in range(o.row, o.last_row):
            k.lam[r] = k.a[r]
        nt.unbalanced(t, k, o)
        for place in range(o.start, o.end):
            b = k.block[place]
            k.move[b] = -k.balance[b]
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
            if k.p[r] > ZERO:
                held = k.total[r] + k.total[modes.partner(t, k, r)]
                k.res[r] = expected(t, k, r) - k.a[r]
                k.weight[r] = k.res[r] - HALF * k.p[r] * held
        nt.add_pushes(t, k, o)
        modes.solve(t, k, o, 1)
        for place in range(o.start, o.end):
            b = k.block[place]
            k.v[b] = k.v[b] + k.move[b]
        for r in range(o.row, o.last_row):
            if k.p[r] > ZERO:
                other = modes.partner(t, k, r)
                held = (k.total[r] + k.total[other]) + (k.dz[r] + k.dz[other])  # as on the right-hand side
                k.a[r] = k.a[r] + k.res[r] - HALF * k.p[r] * held
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.total[r] = k.total[r] + k.dz[r]

    @wp.func(inline=False)
    def tangent(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """What s changes: v' by k.move, impulses by k.res, rows by k.dz."""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
            if k.p[r] > ZERO:
                k.weight[r] = -HALF * k.p[r] * (k.cross[r] + k.cross[modes.partner(t, k, r)])
        nt.add_pushes(t, k, o)
        modes.solve(t, k, o, 1)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.dz[r] = k.dz[r] + k.cross[r]
        for r in range(o.row, o.last_row):
            k.res[r] = ZERO
            if k.p[r] > ZERO:
                k.res[r] = -HALF * k.p[r] * (k.dz[r] + k.dz[modes.partner(t, k, r)])

    @wp.func
    def border(t: wp.ref[Topology], k: wp.ref[Slot], r: int, now: int, second: int, tau: dtype):
        """What must not be negative for contact r to go on as `now` (the first or the second such), and its
        slope in s.
        """
        other = r + 1
        if not modes.begins_pair(t, k, r):
            if now == OPENS:
                return k.total[r] - yields(t, k, r, tau) * k.slack[r], k.dz[r]
            return k.a[r], k.res[r]
        if now == OPENS:
            give = yields(t, k, r, tau) * (k.slack[r] + k.slack[other])
            return HALF * (k.total[r] + k.total[other] - give), HALF * (k.dz[r] + k.dz[other])
        if second == 0 or now == STICKS:  # its impulses; of one that sticks the second row's first
            at = wp.where((now == STICKS) == (second == 0), other, r)
            if now == FALLS:
                at = other
            return k.a[at], k.res[at]
        give = yields(t, k, r, tau)
        slip = k.total[r] - k.total[other]
        slip += give * (k.a[r] - k.slack[r] - k.a[other] + k.slack[other])
        change = k.dz[r] - k.dz[other] + give * (k.res[r] - k.res[other])
        side = wp.where(now == FALLS, HALF, -HALF)
        return side * slip, side * change

    @wp.func(inline=False)
    def nearest(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, p: wp.ref[Path]):
        """The change of s to the next border, which p names, or to s = 0."""
        p.next_row = -1
        least = wp.where(p.way < ZERO, p.s, HUGE)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and not modes.follows(t, k, r):
                now = state(t, k, r)
                borders = int(1)
                if now != OPENS and modes.begins_pair(t, k, r):
                    borders = 2
                for second in range(borders):
                    if r != p.row or second != p.border:
                        value, slope = border(t, k, r, now, second, p.tau)
                        fall = -p.way * slope
                        if fall > ZERO and wp.max(value, ZERO) < least * fall:
                            least = wp.max(value, ZERO) / fall
                            p.next_row = r
                            p.next_border = second
        return least

    @wp.func
    def cross(t: wp.ref[Topology], k: wp.ref[Slot], p: wp.ref[Path]):
        """The modes behind the border, and the border as it is seen from there."""
        r = p.next_row
        now = state(t, k, r)
        then = int(OPENS)
        behind = int(0)
        if modes.begins_pair(t, k, r):
            if now == OPENS:
                then = wp.where(k.total[r] - k.total[r + 1] < ZERO, RISES, FALLS)
            elif now == STICKS:
                then = wp.where(p.next_border == 0, RISES, FALLS)
                behind = 1
            elif p.next_border == 1:
                then = int(STICKS)
                behind = wp.where(now == RISES, 0, 1)
        elif now == OPENS:
            then = int(STICKS)
        become(t, k, r, then)
        p.row = r
        p.border = behind

    @wp.func
    def advance(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, p: wp.ref[Path], change: dtype):
        """Change s."""
        p.s = p.s + change
        for place in range(o.start, o.end):
            b = k.block[place]
            k.v[b] = k.v[b] + change * k.move[b]
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.a[r] = k.a[r] + change * k.res[r]
                k.total[r] = k.total[r] + change * k.dz[r]

    @wp.func
    def patience(k: wp.ref[Slot]):
        """How many times as many pivots by row a path may make."""
        return wp.max(PATIENCE * k.count[wp.static(LOOKS)], 1)

    @wp.func
    def pivots(o: Island, each: int):
        """How many are made at most, so many a row and a few."""
        return MORE_PIVOTS + each * wp.min(o.last_row - o.row, COUNTED)

    @wp.func(inline=False)
    def follow(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, tau: dtype, most: int):
        """From s = 1 to s = 0: 1 if it gets there, with `most` pivots. k.total are the rows at s = 1."""
        p = Path()
        p.s = ONE
        p.way = -ONE
        p.tau = tau
        p.row = -1
        left = int(most)
        arrived = int(0)
        while left > 0:
            left -= 1
            stiffen(t, k, o, tau)
            modes.factor_from(t, k, o, first_place(t, k, o, p.row))
            if left % CORRECTED == 0:
                correct(t, k, o)
            tangent(t, k, o)
            if p.row >= 0:
                _value, slope = border(t, k, p.row, state(t, k, p.row), p.border, tau)
                p.way = wp.where(slope > ZERO, ONE, -ONE)
            least = nearest(t, k, o, p)
            if p.s + p.way * least < FAR:
                advance(t, k, o, p, p.way * least)
                if p.next_row >= 0:
                    cross(t, k, p)
                else:
                    correct(t, k, o)
                    arrived = 1
                    left = 0
            else:
                left = 0
        return arrived

    @wp.func(inline=False)
    def refine(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, yielding: dtype):
        """Paths from a path's end that take off what the yielding left, with less of it."""
        tau = yielding + ZERO
        left = int(STAGES)
        while left > 0:
            modes.measure(t, k, o)
            if modes.evaluate(t, k, o) <= GOOD:
                left = 0
            else:
                for r in range(o.row, o.last_row):
                    if k.acting[r] > 0:
                        k.cross[r] = yields(t, k, r, tau) * (k.a[r] - k.slack[r])
                        k.slack[r] = k.a[r]
                        k.total[r] = k.total[r] + k.cross[r]
                tau = wp.max(SMALLER * tau, SMALLEST)
                modes.keep(k, o)
                left -= 1
                if follow(t, k, o, tau, pivots(o, PIVOTS)) == 0:
                    modes.take(k, o)
                    left = 0

    @wp.func
    def from_nothing(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype, trial: int):
        """A path from no impulse, where all rows are opened; another one, that yields less, by `trial`. Its
        end is the least that rows press by (k.least), none where it does not arrive.
        """
        tau = TAU + ZERO
        for _once in range(trial):
            tau = wp.where(k.count[wp.static(LOOKS)] > 0, MORE * tau, wp.max(SMALLER * tau, SMALLEST))
        for place in range(o.start, o.end):
            k.v[k.block[place]] = k.vfree[k.block[place]]
        modes.measure(t, k, o)
        for r in range(o.row, o.last_row):
            k.mode[r] = OFF
            k.a[r] = ZERO
            k.slack[r] = ZERO
            if k.acting[r] > 0:
                k.cross[r] = size * (ONE + WIDE * random(k, r, trial + TRIALS * k.count[wp.static(LOOKS)]))
                k.total[r] = k.total[r] + k.cross[r]
        arrived = follow(t, k, o, tau, wp.max(pivots(o, COLD_PIVOTS), pivots(o, patience(k))))
        for r in range(o.row, o.last_row):
            k.least[r] = ZERO
            if arrived == 1 and k.acting[r] > 0:
                k.least[r] = k.a[r]
        if arrived == 1:
            refine(t, k, o, tau)

    @wp.func
    def cover(t: wp.ref[Topology], k: wp.ref[Slot], r: int, size: dtype):
        """What makes contact r do at s = 1 what its mode says, of k.total, into k.cross."""
        now = state(t, k, r)
        apart = SMALL * size * (ONE + random(k, r, 0))
        k.cross[r] = -k.total[r]
        if not modes.begins_pair(t, k, r):
            if now == OPENS:
                k.cross[r] = wp.max(k.cross[r], ZERO) + apart
            return
        k.cross[r + 1] = -k.total[r + 1]
        if now == STICKS:
            return
        lifted = -HALF * (k.total[r] + k.total[r + 1])
        slip = HALF * (k.total[r] - k.total[r + 1])
        side = SMALL * size * random(k, r + 1, 0)
        if now == OPENS:
            lifted = wp.max(lifted, ZERO) + apart
        elif now == RISES:
            side = -wp.max(slip, ZERO) - apart
        else:
            side = wp.max(-slip, ZERO) + apart
        k.cross[r] = lifted + side
        k.cross[r + 1] = lifted - side

    @wp.func
    def from_here(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype, most: int):
        """A path from the impulses k.a in their modes, of `most` pivots."""
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and k.mode[r] != OFF:
                k.a[r] = wp.max(k.a[r], SMALL * random(k, r, 0) * size / k.diag[r])
            else:
                k.a[r] = ZERO
            k.weight[r] = k.a[r]
            k.slack[r] = k.a[r]
        modes.push(t, k, o)
        modes.measure(t, k, o)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and not modes.follows(t, k, r):
                cover(t, k, r, size)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.total[r] = k.total[r] + k.cross[r]
        if follow(t, k, o, TAU, wp.min(pivots(o, patience(k) * PIVOTS), most)) == 1:
            refine(t, k, o, TAU)

    return SimpleNamespace(from_nothing=from_nothing, from_here=from_here)
