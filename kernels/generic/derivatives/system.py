"""The linear system of the implicit function theorem at a solved step, and LANES right-hand sides at once.

(dv', dz) solves M dv' - J' (p/D) dz = -F1, C dv' + q dz = -F2 with p = s'(z), q = s'(-z), where -F1 holds D's
own change and C = J but for contacts that slide under Coulomb's friction, whose row of C is J_n at fixed
modes (stick, slide, separate). dz is eliminated with a proximal term as in `newton.py`, larger because
rounding counts here, whose error is taken out by iterative refinement.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..linear.envelope import make_envelope
from ..linear.many import make_many
from ..newton import make_newton
from ..topology import Topology
from ..work import ISLANDS, V3, WORK, Lanes, Slot
from .asked import make_asked
from .kinks import make_kinks
from .matrix import make_matrix
from .slips import make_slips
from .tables import Slopes

YIELDING = {True: 1e-10, False: 1e-11}  # diag(A) dlambda by which a row yields (hard or not)
PRESSED = 30.0  # diag(A) lambda, by the velocities of its data, from which a smoothed row yields as it is
FIRMER, FIRMEST = 1e3, 1e-4  # times that and at most, where the factor has lost the digits to refine with
REFINED = 1e-6  # a correction relative to what it corrects, after which the next one is rounding
WRONG = 1e-4  # what may be left of an error where refinement ends
REFINEMENTS = 2
SLOW = 100  # refinements of rows that are nearly one, whose error falls by little at a time
NOISE = 1e-10  # a correction relative to the response without rows that is rounding
UNSEEN = 1e-20  # and relative to the largest of the columns beside it: of one that is 0 but for roundings
ROUNDS = 2.0**-52  # a correction relative to what it corrects that is rounding
STEEP = 0.7  # of the one before: a correction that is no rounding


@cached
def make_system(given: type, residual: str) -> SimpleNamespace:
    """factor(t, k, d, b, n) of the n acting rows, firmer(t, k, d, b): the same with rows that yield more,
    1 if they may, and solve(t, k, d, b, n): d.found = dv' from -F1 in d.known and -F2 in d.given, which are
    overwritten, 1 if that holds; then follow(t, k, d, b, n): d.root = dz, which lacks the last change until
    then. response(t, k, s): k.move = M^-1 J_s' in the units that row s
    moves. add(t, k, s, x, c): x += J_s' c.
    """
    dtype = WORK
    env, many, slips, asks = make_envelope(), make_many(), make_slips(), make_asked()
    contacts, hard = residual != "none", residual == "hard"
    nt = make_newton(given, residual) if contacts else None
    matrix = make_matrix(given, residual) if contacts else None
    hold = make_kinks(given, residual) if hard else None
    ONE, ZERO, YIELDS = dtype(1.0), dtype(0.0), dtype(YIELDING[hard])
    SMALL, LEAST, MISSED = dtype(REFINED), dtype(NOISE), dtype(WRONG)
    FALLS, NOTHING, MOST = dtype(STEEP * STEEP), dtype(UNSEEN), dtype(PRESSED)
    ROUND = dtype(ROUNDS * ROUNDS)

    @wp.func
    def add(t: wp.ref[Topology], k: wp.ref[Slot], s: int, x: wp.array(dtype=Lanes), c: Lanes):
        start = k.entry[s]
        pattern = k.pattern[s]
        for e in range(k.entry[s + 1] - start):
            j = k.jac[start + e]
            p = 3 * t.row_block[pattern + e]
            for part in range(3):
                x[p + part] = x[p + part] + j[part] * c

    @wp.func
    def add_pushes(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, n: int, x: wp.array(dtype=Lanes)):
        """x += J' push; rows of the same blocks are summed up before they are stored."""
        begin = int(0)
        i = int(0)
        while begin < n:
            end = d.bunch[b, i]
            s = d.row[b, begin]
            pattern = k.pattern[s]
            for e in range(k.entry[s + 1] - k.entry[s]):
                one = Lanes()
                two = Lanes()
                three = Lanes()
                for r in range(begin, end):
                    j = k.jac[k.entry[d.row[b, r]] + e]
                    push = d.push[b, r]
                    one += j[0] * push
                    two += j[1] * push
                    three += j[2] * push
                p = 3 * t.row_block[pattern + e]
                x[p] = x[p] + one
                x[p + 1] = x[p + 1] + two
                x[p + 2] = x[p + 2] + three
            begin = int(end)
            i += 1

    @wp.func
    def rate(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, r: int, x: wp.array(dtype=Lanes)):
        """d.push = C_r x: in memory, since numbers that a loop carries along are not kept as one."""
        s = d.row[b, r]
        start = k.entry[s]
        pattern = k.pattern[s]
        d.push[b, r] = Lanes()
        for e in range(k.entry[s + 1] - start):
            j = k.jac[start + e]
            if wp.static(hard):
                if d.slides[b, r] == 1:
                    j = slips.held_entry(t, k, s, e, 1)
            p = 3 * t.row_block[pattern + e]
            d.push[b, r] = d.push[b, r] + (j[0] * x[p] + j[1] * x[p + 1] + j[2] * x[p + 2])

    @wp.func
    def weigh(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, n: int):
        """p and q of the acting rows. Smoothed ones that press no harder than their data suggest yield no
        less than the factor's term: where they depend on each other but for that, impulses change places
        within 1e-11 m, which takes a hundred refinements to find.
        """
        for r in range(n):
            s = d.row[b, r]
            e = nt.smooth(k, s, k.z[s])
            k.p[s] = e[2]
            k.slack[s] = e[3]
            if wp.static(not hard):
                if k.lam[s] * k.diag[s] <= MOST * k.unit[s]:
                    k.slack[s] = wp.max(e[3], YIELDS * e[2] * k.diag[s] / k.scale[s])

    @wp.func
    def factor(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, n: int):
        if wp.static(contacts):
            d.yielding[b, 0] = YIELDS
            weigh(t, k, d, b, n)
            if wp.static(hard):
                hold(t, k, d, b, YIELDS)
            else:
                slips.mark(t, k, d, b, 0, n)
                matrix.factor(t, k, d, b)

    @wp.func
    def firmer(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int):
        """The factor of rows that yield more keeps more digits; refinement takes longer. 1: there is one."""
        if wp.static(contacts):
            if d.yielding[b, 0] < dtype(wp.static(0.5 * FIRMEST)):
                d.yielding[b, 0] = dtype(wp.static(FIRMER)) * d.yielding[b, 0]
                matrix.factor(t, k, d, b)
                return int(1)
        return int(0)

    @wp.func
    def substitute(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, x: wp.array(dtype=Lanes)):
        """The factor's inverse times x, in place."""
        alone = int(0)  # a block of no island
        end = int(0)
        if wp.static(contacts):
            upper = k.factor
            if t.coulomb == 1:
                upper = d.upper[b]
            end = k.island_block[k.count[wp.static(ISLANDS)]]
            many.solve(k.factor, upper, k.first, k.at, k.block, x, 0, end)
        for u in range(t.units):
            alone = int(1)
            if wp.static(contacts):
                alone = wp.where(k.island[u] < 0, 1, 0)
            if alone == 1:
                first = t.unit_start[u]
                last = t.unit_start[u + 1]
                many.solve(k.mass_factor, k.mass_factor, t.mass_first, t.mass_at, t.block_id, x, first, last)

    @wp.func
    def to_come(moved: dtype, last: dtype, size: dtype):
        """What changes that shrink as the last two did add up to, relative to the last; squares. Nothing,
        where they are what numbers of such a size round by: these may be the same for ever.
        """
        if not (moved < last) or moved <= ROUND * size:
            return ZERO
        rate = wp.sqrt(moved / last)
        return rate * rate / ((ONE - rate) * (ONE - rate))

    @wp.func
    def settled(t: wp.ref[Topology], x: wp.array(dtype=Lanes), change: wp.array(dtype=Lanes), last: Lanes):
        """x += change; 1 if that, or what is to come, was little of every column, and the squares of the
        changes.
        """
        size = Lanes()
        moved = Lanes()
        for i in range(3 * t.blocks):
            step = change[i]
            value = x[i] + step
            x[i] = value
            size += wp.cw_mul(value, value)
            moved += wp.cw_mul(step, step)
        good = int(1)
        for lane in range(wp.static(len(Lanes()))):
            error = moved[lane] * wp.max(ONE, to_come(moved[lane], last[lane], size[lane]))
            if not (error <= SMALL * SMALL * size[lane]):
                good = 0
        return good, moved

    @wp.func(inline=False)
    def left(
        t: wp.ref[Topology], k: wp.ref[Slot], known: wp.array(dtype=Lanes), x: wp.array(dtype=Lanes),
        moved: Lanes, last: Lanes, slow: int, most: dtype,
    ):  # fmt: skip
        """What is left of the columns after a change: 0 at most `most` of them, or rounding; 1 more, and
        changes shrink; -1 more, and they do not. Changes to come count; of slow refinement they alone. What
        may be rounding beside the response without rows is none while it falls: impulses make that large.
        """
        size = Lanes()
        free = Lanes()
        for i in range(t.blocks):
            m = k.mass[t.mass_at[i] + i]
            for part in range(3):
                value = x[3 * i + part]
                size += wp.cw_mul(value, value)
                value = known[3 * i + part] / m[part, part]
                free += wp.cw_mul(value, value)
        largest = ZERO + ZERO
        for lane in range(wp.static(len(Lanes()))):
            largest = wp.max(largest, size[lane])
        out = int(0)
        counts = wp.where(slow == 1, SMALL, ONE)  # of the change itself
        for lane in range(wp.static(len(Lanes()))):
            least = most * most * size[lane]
            floor = wp.max(LEAST * LEAST * free[lane], NOTHING * NOTHING * largest)
            error = moved[lane] + ZERO
            shrinks = error < last[lane]
            error = error * wp.max(to_come(error, last[lane], size[lane]), counts)
            falls = most < MISSED and moved[lane] > LEAST * LEAST and moved[lane] < FALLS * last[lane]
            if not (error <= least) and (falls or not (error <= floor)):
                if shrinks:
                    return int(1)
                out = int(-1)
        return out

    @wp.func
    def follow(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, n: int):
        """dz after the last change of dv', in d.side; what is left of F2 then is the proximal term's."""
        for r in range(n):
            rate(t, k, d, b, r, d.side[b])
            share = d.share[b, r]
            change = share[1] * (d.given[b, r] - d.push[b, r])
            root = d.root[b, r] + change
            rest = share[0] * change
            d.root[b, r] = root
            d.given[b, r] = rest
            d.push[b, r] = share[2] * root + share[3] * rest

    @wp.func(inline=False)
    def refined(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, n: int):
        known = d.known[b]
        side = d.side[b]
        found = d.found[b]
        for i in range(3 * t.blocks):
            side[i] = known[i]
        for r in range(n):
            d.push[b, r] = d.share[b, r][3] * d.given[b, r]
            d.root[b, r] = Lanes()
        add_pushes(t, k, d, b, n, side)
        more = int(0)
        since = int(0)  # refinements with this factor
        last = Lanes()
        while more <= SLOW:
            substitute(t, k, d, b, side)
            if more == 0:
                for i in range(3 * t.blocks):
                    found[i] = side[i]
            else:
                good, moved = settled(t, found, side, last)
                slow = wp.where(d.yielding[b, 0] > YIELDS, 1, 0)
                if good == 1 and slow == 0:
                    return int(1)
                if since >= REFINEMENTS:
                    way = left(t, k, known, found, moved, last, slow, SMALL)
                    if way == 0:
                        return int(1)
                    if way < 0:
                        if firmer(t, k, d, b) == 0:
                            more = wp.static(SLOW)
                        since = 0
                    if more == wp.static(SLOW):
                        return wp.where(left(t, k, known, found, moved, last, slow, MISSED) == 0, 1, 0)
                last = moved
            if n == 0:
                return int(1)
            follow(t, k, d, b, n)
            for i in range(3 * t.blocks):
                side[i] = known[i]
            many.take_momentum(t, k, found, side)
            add_pushes(t, k, d, b, n, side)
            more += 1
            since += 1
        return int(1)

    @wp.func
    def solve(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, n: int):
        asked, free = asks.told(t, k, d, b, n)
        good = refined(t, k, d, b, n)
        if good == 1:
            good = asks.suffices(t, k, d, b, asked, free)
        return good

    @wp.func
    def response(t: wp.ref[Topology], k: wp.ref[Slot], s: int):
        pattern = k.pattern[s]
        count = k.entry[s + 1] - k.entry[s]
        for e in range(count):
            u = t.block_unit[t.row_block[pattern + e]]
            for i in range(t.unit_start[u], t.unit_start[u + 1]):
                k.move[i] = V3()
        for e in range(count):
            k.move[t.row_block[pattern + e]] = k.jac[k.entry[s] + e]
        last = int(-1)
        for e in range(count):
            u = t.block_unit[t.row_block[pattern + e]]
            if u != last:
                last = u
                start = t.unit_start[u]
                end = t.unit_start[u + 1]
                env.solve(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, start, end)

    return SimpleNamespace(
        factor=factor, firmer=firmer, solve=solve, follow=follow, response=response, add=add
    )
