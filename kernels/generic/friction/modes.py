"""Coulomb's hard friction of an island: semismooth Newton's method on what every contact does.

A contact is off, sticks or slides either way. In the rows w+- = J+- v' + d/h of Anitescu's relaxation, with
w_n = (w+ + w-)/2 and mu v_t = u = (w+ - w-)/2: one that sticks holds both rows, w+ = w- = 0; one that slides
presses by one of them, lambda+ where u < 0, and holds w_n = 0; limits and contacts without friction are off
or hold. The modes come from the natural map: with one A for both, a contact presses where A (lambda+ +
lambda-) > w_n, and sticks where |A (lambda+ - lambda-) - u| is not more than the difference. At given modes
the impulses change by -kappa (w + J~ dv), J~ the row or the mean of the two, so that

    (M + J' kappa J~) dv = J' lambda - M (v' - v_free) - J' kappa w,

not symmetric where something slides. kappa = 1/(tau diag(A)): a proximal term about the last impulses, which
leaves no trace where the iteration ends. A point is judged as one of the hard problem whose d/h is lifted by
|u| (`coulomb.py`): with that its complementarity is Coulomb's law, on the scales of the data without a lift.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..motion.mechanism import COLUMN
from ..newton import TOLERANCE, make_newton
from ..topology import CONTACT, Topology
from ..work import V3, WORK, Island, Slot
from .matrix import HOLDS, OFF, SLIDES, make_modes_matrix

PROXIMAL = 1e-9  # tau
STAYS = 1e-12  # residual of the last impulses that stay as they are: rounding of gaps makes as much
SLIP = 0.2  # of v_t of what sticks, or slides the other way, that counts as the residual of a row does
ROUNDED = 4e-16  # of mu v_t, relative to the terms of its rows: v_t has digits beyond this
ROUNDS = -1  # no solution for what impulses round by
PATIENCE = 2  # iterations at modes that stay, without a gain
TOO_MANY, GROWING = 10, 5  # contacts that change at once, or more of them than before: no solution is near


@cached
def make_modes(given: type) -> SimpleNamespace:
    """newton(t, k, o, warm) -> 1 if k.v, k.z, k.lam are a solution to the residual's aim, and what is needed
    to solve for more right-hand sides there.
    """
    dtype = WORK
    nt = make_newton(given, "hard")
    matrix = make_modes_matrix()
    partner, lu = matrix.partner, matrix.lu
    ZERO, ONE, HALF = dtype(0.0), dtype(1.0), dtype(0.5)
    TAU, GOOD, AIM, KEPT = dtype(PROXIMAL), nt.GOOD, dtype(TOLERANCE), dtype(STAYS)
    HUGE = dtype(1e300)
    STUCK, ROUND, FRICTION = dtype(SLIP), dtype(ROUNDED), COLUMN["friction"]

    @wp.func
    def begins_pair(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """Whether r is the first row of a pair with friction."""
        i = k.row[r]
        return t.row_kind[i] == CONTACT and t.row_sign[i] > 0

    @wp.func
    def follows(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """Whether r is the second row of a pair with friction."""
        i = k.row[r]
        return t.row_kind[i] == CONTACT and t.row_sign[i] < 0

    @wp.func
    def join_pairs(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Both rows of a contact act where one does."""
        for r in range(o.row, o.last_row):
            if begins_pair(t, k, r):
                if k.acting[r] + k.acting[r + 1] > 0:
                    k.acting[r] = wp.max(k.acting[r], 1)
                    k.acting[r + 1] = wp.max(k.acting[r + 1], 1)

    @wp.func
    def closes_none(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Whether no contact and no limit closes, by k.w of all rows: w_n is the mean of a contact's two."""
        out = bool(True)
        for r in range(o.row, o.last_row):
            if not follows(t, k, r):
                w = k.w[r]
                if begins_pair(t, k, r):
                    w = HALF * (w + k.w[r + 1])
                out = out and w >= ZERO
        return out

    @wp.func
    def drop_lifts(k: wp.ref[Slot], o: Island):
        """d/h of the data."""
        for r in range(o.row, o.last_row):
            k.lift[r] = ZERO
            k.rate[r] = k.gap[r]

    @wp.func
    def measure(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.total: J v' + d/h without a lift."""
        for g in range(o.group, o.last_group):
            nt.turn_group(t, k, g, k.v, k.total)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.total[r] = k.gap[r] + k.total[r]

    @wp.func
    def lift(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Lift d/h by what |u| is in k.total."""
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and follows(t, k, r):
                up = HALF * wp.abs(k.total[r - 1] - k.total[r])
                k.lift[r - 1] = up
                k.rate[r - 1] = k.gap[r - 1] + up
                k.rate[r] = k.gap[r] + up

    @wp.func
    def push(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """v' that the impulses k.weight give."""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        nt.add_pushes(t, k, o)
        for place in range(o.start, o.end):
            b = k.block[place]
            u = t.block_unit[b]
            if t.unit_start[u] == b:
                nt.env.solve(
                    k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, b, t.unit_start[u + 1]
                )
        for place in range(o.start, o.end):
            b = k.block[place]
            k.v[b] = k.vfree[b] + k.move[b]

    @wp.func
    def leave_alone(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """v' = v_free, to the last bit, of what no row presses."""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
            if k.acting[r] > 0:
                k.weight[r] = k.lam[r]
        nt.add_pushes(t, k, o)
        for place in range(o.start, o.end):
            b = k.block[place]
            u = t.block_unit[b]
            if t.unit_start[u] == b:
                pushed = ZERO
                for i in range(b, t.unit_start[u + 1]):
                    pushed += wp.dot(k.move[i], k.move[i])
                if pushed == ZERO:
                    for i in range(b, t.unit_start[u + 1]):
                        k.v[i] = k.vfree[i]

    @wp.func
    def warm(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Modes and impulses of D lambda = k.excess."""
        for r in range(o.row, o.last_row):
            k.mode[r] = OFF
            k.weight[r] = ZERO
            if k.acting[r] > 0:
                k.weight[r] = k.excess[r] / k.scale[r]
                if k.excess[r] > ZERO:
                    k.mode[r] = HOLDS
                if follows(t, k, r) and k.mode[r] != k.mode[r - 1]:
                    k.mode[r] = SLIDES * k.mode[r]
                    k.mode[r - 1] = SLIDES * k.mode[r - 1]
            k.a[r] = k.weight[r]

    @wp.func
    def choose(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Modes by the natural map at (k.v, k.a), impulses that they allow; how many contacts changed."""
        changed = int(0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and not follows(t, k, r):
                first = int(OFF)
                second = int(OFF)
                turned = int(0)
                if begins_pair(t, k, r):
                    size = HALF * (k.diag[r] + k.diag[r + 1])
                    presses = size * (k.a[r] + k.a[r + 1]) - HALF * (k.total[r] + k.total[r + 1])
                    rubs = size * (k.a[r] - k.a[r + 1]) - HALF * (k.total[r] - k.total[r + 1])
                    if presses > ZERO:
                        first = wp.where(rubs > presses, SLIDES, wp.where(rubs < -presses, OFF, HOLDS))
                        second = wp.where(rubs < -presses, SLIDES, wp.where(rubs > presses, OFF, HOLDS))
                    total = wp.max(k.a[r] + k.a[r + 1], ZERO)
                    k.a[r] = wp.where(first == SLIDES, total, wp.where(first == OFF, ZERO, k.a[r]))
                    k.a[r + 1] = wp.where(second == SLIDES, total, wp.where(second == OFF, ZERO, k.a[r + 1]))
                    if second != k.mode[r + 1]:
                        turned = 1
                    k.mode[r + 1] = second
                else:
                    if k.diag[r] * k.a[r] > k.total[r]:
                        first = int(HOLDS)
                    else:
                        k.a[r] = ZERO
                if first != k.mode[r]:
                    turned = 1
                k.mode[r] = first
                changed += turned
        return changed

    @wp.func
    def stiffen(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.p: kappa; whether something slides."""
        slides = int(0)
        for r in range(o.row, o.last_row):
            k.p[r] = ZERO
            if k.acting[r] > 0 and k.mode[r] != OFF:
                k.p[r] = ONE / (TAU * k.diag[r])
                if k.mode[r] == SLIDES:
                    slides = 1
        return slides

    @wp.func
    def factor(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, slides: int):
        """The matrix of the modes at hand, of weights k.p, and its factors; not symmetric if one `slides`."""
        if slides == 1:
            matrix.factor_from(t, k, o, o.start)
        else:
            for r in range(o.row, o.last_row):
                k.weight[r] = k.p[r]
            nt.assemble(t, k, o)
            nt.env.factor(k.factor, k.first, k.at, o.start, o.end)

    @wp.func(inline=False)
    def solve(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, slides: int):
        """k.move by the factors at hand; k.dz: what it changes in the rows."""
        if slides == 1:
            lu.solve(k.factor, k.upper, k.first, k.at, k.block, k.move, o.start, o.end)
        else:
            nt.env.solve(k.factor, k.first, k.at, k.block, k.move, o.start, o.end)
        for g in range(o.group, o.last_group):
            nt.turn_group(t, k, g, k.move, k.dz)

    @wp.func
    def advance(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, slides: int):
        """A step of (k.v, k.a) and k.total at the modes at hand; needs k.balance for k.lam."""
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
            if k.acting[r] > 0:
                held = k.total[r] + k.total[partner(t, k, r)]
                k.weight[r] = k.a[r] - k.lam[r] - HALF * k.p[r] * held
        for place in range(o.start, o.end):
            b = k.block[place]
            k.move[b] = -k.balance[b]
        nt.add_pushes(t, k, o)
        solve(t, k, o, slides)
        for place in range(o.start, o.end):
            b = k.block[place]
            k.v[b] = k.v[b] + k.move[b]
        for r in range(o.row, o.last_row):
            if k.p[r] > ZERO:
                other = partner(t, k, r)
                held = (k.total[r] + k.total[other]) + (k.dz[r] + k.dz[other])  # as on the right-hand side
                k.a[r] = k.a[r] - HALF * k.p[r] * held
        measure(t, k, o)

    @wp.func
    def wrongly(k: wp.ref[Slot], r: int):
        """mu v_t of a contact that sticks, or that slides along with what it presses; r: its second row."""
        u = HALF * (k.total[r - 1] - k.total[r])
        if k.mode[r] == HOLDS and k.mode[r - 1] == HOLDS:
            return wp.abs(u)
        if k.mode[r] == SLIDES:
            return -u
        return wp.where(k.mode[r - 1] == SLIDES, u, ZERO)

    @wp.func
    def evaluate(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """z and lambda of (k.v, k.a), in k.res what w misses; the largest residual of Coulomb's law and of
        M dv = J' lambda.
        """
        lift(t, k, o)
        worst = dtype(0.0)
        finite = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                lam = wp.max(k.a[r], ZERO)
                held = k.rate[r] - k.gap[r] + k.total[r]
                w = wp.max(held, ZERO)
                if lam > ZERO:
                    w = ZERO
                k.lam[r] = lam
                k.z[r] = k.scale[r] * lam - w
                k.res[r] = held - w
                worst = wp.max(worst, wp.abs(held - w) / k.unit[r])
                if follows(t, k, r):  # v_t by itself: mu v_t may be little beside w_n
                    rubs = wrongly(k, r) - ROUND * wp.max(k.own[r - 1], k.own[r])
                    if rubs > ZERO:
                        mu = k.numbers[t.columns[FRICTION] + t.row_index[k.row[r]]]
                        worst = wp.max(worst, STUCK * rubs / (mu * wp.max(k.unit[r - 1], k.unit[r])))
                finite += wp.abs(held) + wp.abs(k.a[r])
        if not wp.isfinite(finite):
            worst = ZERO + HUGE
        return wp.max(worst, nt.unbalanced(t, k, o))

    @wp.func
    def keep(k: wp.ref[Slot], o: Island):
        for place in range(o.start, o.end):
            k.best_v[k.block[place]] = k.v[k.block[place]]
        for r in range(o.row, o.last_row):
            k.best_z[r] = k.a[r]

    @wp.func
    def take(k: wp.ref[Slot], o: Island):
        for place in range(o.start, o.end):
            k.v[k.block[place]] = k.best_v[k.block[place]]
        for r in range(o.row, o.last_row):
            k.a[r] = k.best_z[r]

    @wp.func
    def newton(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, iterations: int, wary: int):
        """From (k.v, k.a), at first in the modes at hand; 1 if the best point, which stays, is a solution, in
        single precision ROUNDS if no more than the rounding of its impulses is too much. Ends where ever more
        contacts change, if it is `wary`. `scales` has to be called before, without a lift.
        """
        best = ZERO + HUGE
        slides = int(0)
        misses = int(0)
        last = int(0)  # 1: the last point is the best
        it = int(0)
        changed, before = int(1), int(wp.static(GROWING))
        measure(t, k, o)
        going = int(1)
        while going == 1:
            worst = evaluate(t, k, o)
            misses += 1
            if worst < HALF * best:
                misses = 0
            last = wp.where(worst < best, 1, 0)
            if last == 1:
                best = worst + ZERO
                keep(k, o)
            if best <= wp.where(it == 0, KEPT, AIM) or not (worst < HUGE):
                going = 0
            if it >= iterations and (best > GOOD or misses > 0):  # what still gains is refined
                going = 0
            if going == 1:
                if it > 0:
                    before = wp.max(changed, wp.static(GROWING))
                    changed = choose(t, k, o)
                if changed > 0 and best > GOOD:
                    misses = 0
                leads_away = it > 1 and changed > before or changed > wp.static(TOO_MANY)
                if misses >= PATIENCE or (wary == 1 and leads_away):
                    going = 0
                elif changed > 0:
                    slides = stiffen(t, k, o)
                    factor(t, k, o, slides)
            if going == 1:
                advance(t, k, o, slides)
            it += 1
        if last == 0:
            take(k, o)
            measure(t, k, o)
            evaluate(t, k, o)
        if wp.static(given is wp.float32):
            if best > GOOD and best <= nt.rounded(k, o):
                return wp.static(ROUNDS)
        return wp.where(best <= GOOD, 1, 0)

    return SimpleNamespace(
        join_pairs=join_pairs,
        closes_none=closes_none,
        drop_lifts=drop_lifts,
        measure=measure,
        lift=lift,
        push=push,
        leave_alone=leave_alone,
        warm=warm,
        begins_pair=begins_pair,
        follows=follows,
        partner=partner,
        factor_from=matrix.factor_from,
        solve=solve,
        evaluate=evaluate,
        keep=keep,
        take=take,
        newton=newton,
    )
