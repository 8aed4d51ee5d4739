"""What the data allow a step of the generic kernels to exchange: the judge of impulses beside the equations.

Rows that all but exclude each other can be answered by opposed impulses of any size, so an error relative to
the impulses proves nothing, and neither does one relative to what happens elsewhere in the world. Here every
place is judged by its own momenta; impulses that these do not suggest have to be the least (`least.py`).
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..motion.mechanism import COLUMN, make_mechanism
from ..newton import ACCEPTED, GIVEN, SUMMED, make_newton
from ..topology import CONTACT, Topology
from ..work import V3, WORK, Island, Slot

ROW = 10.0  # what is good enough of a row relative to its own terms, in units of ACCEPTED
ROUNDED = 5e-14  # and relative to the terms of J v'
UNSPENT = 1e-6  # of the energy of the data that a row's impulse may give by what its velocity misses
NOTHING = 1e-19  # of the velocities that a hard row is judged by: less than it presses by needs no momentum
BROUGHT = 10.0  # roundings of what carries a body that a coordinate of it may miss
FELT = 1e-15  # of its own terms: what a side that it presses need not tell of its velocity


@cached
def make_earned(given: type, residual: str) -> SimpleNamespace:
    """Warp functions: judges `adds_up` and `plainly_adds_up`, and what comes before and after."""
    dtype = WORK
    nt = make_newton(given, residual)
    mech, MASS = make_mechanism(given), COLUMN["mass"]
    hard = residual == "hard"
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    LOST, ROUND, ENOUGH = nt.LOST, dtype(GIVEN[given]), dtype(SUMMED[given])
    OPEN, LEAST = dtype(ROW * ACCEPTED[given]), dtype(ROUNDED)
    UNTOLD = dtype(GIVEN[given if hard else WORK])  # rounding of impulses that `press` does not make itself
    SEEN, TOLD = dtype(NOTHING / SUMMED[given]), dtype(FELT / SUMMED[given])
    TINY = dtype(1e-30)
    SPENT = dtype(UNSPENT)
    CARRIED = dtype((BROUGHT * GIVEN[given] / SUMMED[given]) ** 2)

    @wp.func
    def partner(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """The other row of a contact with Coulomb's friction, else row r itself."""
        i = k.row[r]
        if t.coulomb == 0 or t.row_kind[i] != CONTACT:
            return r
        return r + t.row_sign[i]

    @wp.func
    def given_back(k: wp.ref[Slot], r: int, other: int, e: int):
        """Size of the terms of J' lambda in entry e of row r; of both rows where they are a contact with
        Coulomb's friction, of which J_n lambda_n + J_t lambda_t is given back, their sums and differences.
        """
        j = k.jac[k.entry[r] + e]
        lam = k.lam[r]
        if other == r:
            return lam * wp.abs(j)
        l = k.jac[k.entry[other] + e]
        m = wp.where(k.acting[other] > 0, k.lam[other], ZERO)
        return HALF * ((lam + m) * wp.abs(j + l) + wp.abs(lam - m) * wp.abs(j - l))

    @wp.func
    def is_open(t: wp.ref[Topology], k: wp.ref[Slot], r: int, share: dtype, fastest: dtype):
        """Whether J v' + d/h = w of row r is no violation, to `share` of the row's own scale, and to the
        rounding of its terms or, if these are less, of `fastest`.
        """
        w = k.rate[r]
        terms = dtype(0.0)
        e = k.entry[r]
        at = k.pattern[r]
        end = k.entry[r + 1]
        while e < end:
            change = wp.cw_mul(k.jac[e], k.v[t.row_block[at]])
            w += change[0] + change[1] + change[2]
            terms += wp.abs(change[0]) + wp.abs(change[1]) + wp.abs(change[2])
            e += 1
            at += 1
        return w >= -(share * k.own[r] + LEAST * wp.max(terms, fastest))

    @wp.func
    def spends_nothing(k: wp.ref[Slot], r: int, miss: dtype):
        """Whether a row's impulse, times what J v' + d/h misses of w, is little beside the data's energy:
        (v' - v*)' M (v' - v*) is at most the sum of |lambda - lambda*| times what is missed.
        """
        return k.lam[r] * k.diag[r] * wp.abs(miss) <= SPENT * k.unit[r] * k.unit[r]

    @wp.func
    def is_held(t: wp.ref[Topology], k: wp.ref[Slot], j: int, told: dtype):
        """Whether a coordinate of the same body, weighed by energy, has momentum to compare with."""
        p = t.dof_block[j]
        own = k.mass[t.mass_at[p] + p][t.dof_part[j], t.dof_part[j]]
        held = int(0)
        for other in range(wp.max(j - 2, 0), wp.min(j + 3, t.nv)):
            if t.dof_body[other] == t.dof_body[j]:
                q = t.dof_block[other]
                part = t.dof_part[other]
                there = k.momentum[q][part] * k.momentum[q][part] * own
                if told * told * k.mass[t.mass_at[q] + q][part, part] <= there:
                    held = 1
        return held

    @wp.func
    def is_carried(t: wp.ref[Topology], k: wp.ref[Slot], j: int, told: dtype):
        """Whether those before it carry a coordinate's body so fast, before the step or as forces have it,
        that in energy what it misses is a rounding of that: on a rail and a lift a wrist has no other
        coordinate of its body to be compared with.
        """
        body = t.dof_body[j]
        f = k.frame[body]
        x, y = dtype(0.0), dtype(0.0)
        for at in range(t.chain_start[body], t.chain_start[body + 1]):
            dof = t.chain[at]
            if t.dof_body[dof] != body:
                arm = mech.column(t, k, dof, f[2], f[3])
                rate = k.v0[dof]
                free = k.vfree[t.dof_block[dof]][t.dof_part[dof]]
                if wp.abs(free) > wp.abs(rate):
                    rate = free
                x += arm[0] * rate
                y += arm[1] * rate
        p = t.dof_block[j]
        own = k.mass[t.mass_at[p] + p][t.dof_part[j], t.dof_part[j]]
        return told * told <= CARRIED * own * mech.number(t, k, MASS, body) * (x * x + y * y)

    @wp.func
    def felt(k: wp.ref[Slot], r: int):
        """What rounding of a row's impulse makes of its velocity: on the curve of a smoothed law, next to
        nothing where it presses by many sigma.
        """
        rounds = ROUND * k.diag[r] * k.lam[r]
        if wp.static(not hard):
            e = nt.smooth(k, r, k.z[r])
            rounds = rounds * wp.min(ONE, e[3] / e[2])
        return rounds

    @wp.func
    def press(t: wp.ref[Topology], k: wp.ref[Slot], start: int, end: int, e: int):
        """Take what a group's rows press entry e with off k.balance; add what is given back of it to k.move,
        what they do by themselves to k.momentum.
        """
        x, y, z = dtype(0.0), dtype(0.0), dtype(0.0)
        mx, my, mz = dtype(0.0), dtype(0.0), dtype(0.0)
        ax, ay, az = dtype(0.0), dtype(0.0), dtype(0.0)
        b = t.row_block[k.pattern[start] + e]
        mass = wp.get_diag(k.mass[t.mass_at[b] + b])
        r = int(start)
        while r < end:
            lam = k.lam[r]
            if wp.static(not hard):
                lam = dtype(given(lam))
            if k.acting[r] > 0 and (lam != ZERO or t.coulomb == 1):
                j = k.jac[k.entry[r] + e]
                size = wp.abs(j)
                most = lam * size
                other = partner(t, k, r)
                if other != r:
                    most = HALF * given_back(k, r, other, e)
                alone = wp.min(k.alone[r], lam)
                if wp.static(hard):
                    if lam > ZERO:
                        alone = wp.min(wp.max(alone, k.passed[r]), lam) + SEEN * k.unit[r] / k.diag[r]
                        side = wp.dot(j, wp.cw_div(j, mass))
                        alone += TOLD * k.own[r] / wp.max(side, TINY)
                x += lam * j[0]
                y += lam * j[1]
                z += lam * j[2]
                mx += most[0]
                my += most[1]
                mz += most[2]
                ax += alone * size[0]
                ay += alone * size[1]
                az += alone * size[2]
            r += 1
        k.balance[b] = k.balance[b] - V3(x, y, z)
        k.move[b] = k.move[b] + V3(mx, my, mz)
        k.momentum[b] = k.momentum[b] + V3(ax, ay, az)

    @wp.func
    def held_by(t: wp.ref[Topology], k: wp.ref[Slot], b: int, part: int, told: dtype):
        """Whether a coordinate of block b has a momentum, or another one of its body, weighed by energy, has
        one to compare with.
        """
        have = k.momentum[b]
        held = told <= have[part]
        body = t.block_dof[3 * b + part]
        if not held and body >= 0:
            body = t.dof_body[body]
            mass = wp.get_diag(k.mass[t.mass_at[b] + b])
            for other in range(3):
                j = t.block_dof[3 * b + other]
                if j >= 0 and told * told * mass[other] <= have[other] * have[other] * mass[part]:
                    held = held or t.dof_body[wp.max(j, 0)] == body
        return held

    @wp.func(inline=False)
    def give_back(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.move: what is given back with Coulomb's friction, as in `press`."""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        for g in range(o.group, o.last_group):
            start = k.group[g]
            for e in range(k.entry[start + 1] - k.entry[start]):
                x, y, z = dtype(0.0), dtype(0.0), dtype(0.0)
                r = start + 0
                while r < k.group[g + 1]:
                    other = partner(t, k, r)  # a pair's first row comes first
                    size = given_back(k, r, other, e)
                    x += size[0]
                    y += size[1]
                    z += size[2]
                    r = other + 1
                b = t.row_block[k.pattern[start] + e]
                k.move[b] = k.move[b] + V3(x, y, z)

    @wp.func(inline=False)
    def plainly_adds_up(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """1 if what `nt.residuals` left of the point at hand proves what `adds_up` asks: of J v' + d/h - w, w
        not being negative, that no row is open by less; of momenta, without those of rows by themselves. With
        Coulomb's friction `give_back` comes before.
        """
        good = int(1)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                if not (wp.abs(k.res[r]) <= HALF * OPEN * k.own[r]):
                    good = 0
                if not (ROUND * k.diag[r] * k.lam[r] <= ENOUGH * k.unit[r]):
                    good = 0
                if not spends_nothing(k, r, k.res[r]):
                    good = 0
        place = o.start + 0
        while place < o.end and good == 1:
            b = k.block[place]
            miss = wp.max(wp.abs(k.balance[b]) - k.lost[b], V3())
            told = (miss + ROUND * k.move[b]) / ENOUGH
            for part in range(3):
                if not held_by(t, k, b, part, told[part]):
                    good = 0
            place += 1
        return good

    @wp.func
    def misses(t: wp.ref[Topology], k: wp.ref[Slot], b: int):
        """Whether a coordinate of block b misses more momentum than the data suggest."""
        miss = wp.max(wp.abs(k.balance[b]) - k.lost[b], V3())
        told = (miss + UNTOLD * k.move[b]) / ENOUGH
        have = k.momentum[b]
        short = False
        for part in range(3):
            if not (told[part] <= have[part]):
                dof = t.block_dof[3 * b + part]
                if dof < 0:
                    short = True
                elif is_held(t, k, dof, told[part]) == 0 and not is_carried(t, k, dof, told[part]):
                    short = True
        return short

    @wp.func(inline=False)
    def adds_up(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """1 if every row is open on its own scale, and M dv = J' lambda, as it is given back, holds on the
        scale of what the data do to every body, its coordinates weighed by energy: its own momentum, those of
        its rows by themselves as far as they press, and what they exchange with it (at most k.most). Nor may
        rounding of a row's impulse count in its velocity.
        """
        nt.mass_times(t, k, o)
        for place in range(o.start, o.end):
            i = k.block[place]
            k.move[i] = V3()
            k.momentum[i] = k.lost[i] / LOST + wp.min(wp.abs(k.balance[i]), k.most[i])
        good = int(1)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                if not (felt(k, r) <= ENOUGH * k.unit[r]):
                    good = 0
                if not is_open(t, k, r, OPEN, k.unit[r]):
                    good = 0
                w = ZERO  # of a hard row that presses, and of others nothing is asked
                if wp.static(not hard):
                    w = k.w[r]
                if not spends_nothing(k, r, k.rate[r] + nt.dot(t, k, k.v, r) - w):
                    good = 0
        for g in range(o.group, o.last_group):
            start = k.group[g]
            for e in range(k.entry[start + 1] - k.entry[start]):
                press(t, k, start, k.group[g + 1], e)
        for place in range(o.start, o.end):
            if misses(t, k, k.block[place]):
                good = 0
        return good

    @wp.func(inline=False)
    def take_impulses(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """After `adds_up`: v' = v_free + M^-1 J' lambda of trees whose data do not suggest what they miss, as
        of what next to nothing moves beside a load: it is the rounding of what else the solution moves.
        """
        for place in range(o.start, o.end):
            b = k.block[place]
            u = t.block_unit[b]
            if t.unit_start[u] == b:
                end = t.unit_start[u + 1]
                takes = int(0)
                for i in range(b, end):
                    if misses(t, k, i):
                        takes = 1
                if takes == 1:
                    for i in range(b, end):
                        k.move[i] = k.balance[i]
                    nt.env.solve(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, b, end)
                    for i in range(b, end):
                        k.v[i] = k.v[i] - k.move[i]

    return SimpleNamespace(
        adds_up=adds_up,
        give_back=give_back,
        plainly_adds_up=plainly_adds_up,
        take_impulses=take_impulses,
        partner=partner,
        is_open=is_open,
    )
