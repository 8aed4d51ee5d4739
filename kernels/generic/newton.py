"""Linear algebra of a step on (v', z) of any scene by its tables, of one island.

Unknowns are v' and z, lambda = s(z)/D. A step solves M dv - J' dlambda = -r1, J dv + q dz = e - r2, D dlambda
= p dz + e with p = s'(z), q = s'(-z), e = 0 (the interior-point method has other p, q, e). Eliminating dz
leaves (M + J' W J) dv = J' (p (e - r2)/T + e)/D - r1, W = p/(T D), T = q + tau p diag(A)/D. The proximal
term tau keeps redundant rows from making the matrix singular; residuals are exact, so it only slows the last
digits down. v' is an unknown of its own (not v_free + M^-1 J' lambda) because a gram under a tonne would
lose all digits of it.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..residual.smoothing import make_smoothing
from .linear.matrix import make_matrix
from .rows.passes import make_passes, put_inside, weigh
from .topology import Topology
from .work import M33, V3, WORK, Island, Slot

PROXIMAL = 1e-11  # tau; with 1e-12 rows that all but repeat others cost blocks of three their last digits
ROUNDING = 2e-14  # of M (v' - v_free) where v' and v_free are stored, relative to |M| |v_free| or |M| |v|
TOLERANCE = 2e-14  # residual relative to the size of its terms: the aim,
# and what is good enough where rounding, or rows that all but repeat others, end the iteration
ACCEPTED = {wp.float64: 2e-11, wp.float32: 1e-6}
REFINED = 1e-12  # what is worse is refined further: of light bodies' v' the residual of M dv is 30 times that
GIVEN = {wp.float64: 1.1e-16, wp.float32: 6e-8}  # rounding of the impulses that are given back
SUMMED = {wp.float64: 5e-11, wp.float32: 1e-5}  # what it may make of momenta, relative to those in the data


def law_of(residual: str) -> str:
    """The law of a residual, as loops over rows know it (`rows/vectors.py`)."""
    return "hard" if residual == "hard" else "normal" if residual.endswith("normal") else "logistic"


@cached
def make_newton(given: type, residual: str) -> SimpleNamespace:
    """Warp functions: residuals and linear algebra on the acting rows of an island."""
    dtype = WORK
    matrix = make_matrix()
    env, ends = matrix.env, matrix.ends
    sm = make_smoothing(dtype, residual)
    hard = residual == "hard"
    rows = make_passes(law_of(residual))
    ZERO, ONE = dtype(0.0), dtype(1.0)
    LOST, UNLOST = dtype(ROUNDING), dtype(1.0 / ROUNDING)
    TOLD = dtype(GIVEN[given] * ACCEPTED[given] / SUMMED[given])
    SEEN = dtype(TOLERANCE)
    TAU, GOOD, HUGE = dtype(PROXIMAL), dtype(ACCEPTED[given]), dtype(1e300)

    @wp.func
    def smooth(k: wp.ref[Slot], r: int, z: dtype):
        """s(z), s(-z), s'(z), s'(-z) of row r."""
        if wp.static(hard):
            return wp.static(sm.kink)(z)
        sigma = k.sigma[r]
        return wp.static(sm.smooth)(z, sigma, ONE / sigma)

    @wp.func
    def dot(t: wp.ref[Topology], k: wp.ref[Slot], x: wp.ref[wp.array(dtype=V3)], r: int):
        """J_r x"""
        out = dtype(0.0)
        e = k.entry[r]
        at = k.pattern[r]
        end = k.entry[r + 1]
        while e < end:
            out += wp.dot(k.jac[e], x[t.row_block[at]])
            e += 1
            at += 1
        return out

    @wp.func
    def sized(m: M33, x: V3):
        """|m| |x|"""
        a = wp.abs(x)
        return V3(
            wp.abs(m[0, 0]) * a[0] + wp.abs(m[0, 1]) * a[1] + wp.abs(m[0, 2]) * a[2],
            wp.abs(m[1, 0]) * a[0] + wp.abs(m[1, 1]) * a[1] + wp.abs(m[1, 2]) * a[2],
            wp.abs(m[2, 0]) * a[0] + wp.abs(m[2, 1]) * a[1] + wp.abs(m[2, 2]) * a[2],
        )

    @wp.func
    def mass_times(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.balance = M (v' - v_free)"""
        for place in range(o.start, o.end):
            i = k.block[place]
            at = t.mass_at[i]
            change = k.v[i] - k.vfree[i]
            value = k.mass[at + i] * change
            j = t.mass_first[i]
            while j < i:
                m = k.mass[at + j]
                value += m * (k.v[j] - k.vfree[j])
                k.balance[j] = k.balance[j] + wp.transpose(m) * change
                j += 1
            k.balance[i] = value

    @wp.func
    def rounding(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.lost, in all blocks. What a force stops within the step is data, too."""
        for i in range(t.blocks):
            at = t.mass_at[i]
            fast = wp.max(wp.abs(k.vfree[i]), wp.abs(k.before[i]))
            value = sized(k.mass[at + i], fast)
            for j in range(t.mass_first[i], i):
                m = k.mass[at + j]
                value += sized(m, wp.max(wp.abs(k.vfree[j]), wp.abs(k.before[j])))
                k.lost[j] = k.lost[j] + LOST * sized(wp.transpose(m), fast)
            k.lost[i] = LOST * value

    @wp.func
    def put(k: wp.ref[Slot], o: Island, inside: int):
        """lambda and w of rows at z, and their slopes, or inside at a and w; 1 if the matrix changes."""
        if inside == 1:
            put_inside(o.row, o.last_row, k.acting, k.inverse, k.a, k.w, k.lam, k.z)
            return 0
        return wp.static(rows.put)(
            o.row, o.last_row, k.acting, k.z, k.sigma, k.inverse, k.lam, k.w, k.p, k.slack
        )

    @wp.func(inline=False)
    def exchange(t: wp.ref[Topology], k: wp.ref[Slot], g: int):
        """Take J' lambda of a group off k.balance and add its terms to k.move."""
        start, end, entry, entries, _one, _two = ends(t, k, g)
        for e in range(entries):
            x, y, z = dtype(0.0), dtype(0.0), dtype(0.0)  # sums in registers: a vector's are not
            ax, ay, az = dtype(0.0), dtype(0.0), dtype(0.0)
            at = entry + e
            for r in range(start, end):
                if k.acting[r] > 0:
                    impulse = k.lam[r] * k.jac[at]
                    x += impulse[0]
                    y += impulse[1]
                    z += impulse[2]
                    ax += wp.abs(impulse[0])
                    ay += wp.abs(impulse[1])
                    az += wp.abs(impulse[2])
                at += entries
            b = t.row_block[k.pattern[start] + e]
            k.balance[b] = k.balance[b] - V3(x, y, z)
            k.move[b] = k.move[b] + V3(ax, ay, az)

    @wp.func
    def begin_balance(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.balance = M (v' - v_free), k.move its size, k.momentum what the judge takes it for."""
        mass_times(t, k, o)
        for place in range(o.start, o.end):
            i = k.block[place]
            size = wp.abs(k.balance[i])
            k.move[i] = size
            k.momentum[i] = UNLOST * k.lost[i] + wp.min(size, k.most[i])

    @wp.func
    def off(size: dtype, rounds: dtype, move: dtype, most: dtype, worst: dtype):
        """The residual of a coordinate, where it is larger than `worst`."""
        ratio = (size - rounds) / wp.where(move < most, move, most)
        worse = wp.where(ratio > worst, ratio, worst)
        told = TOLD * move
        if told > GOOD * most:
            worse = wp.max(worse, told / most)
        return worse

    @wp.func
    def imbalance(k: wp.ref[Slot], o: Island):
        """The largest residual of a place: relative to the momentum that it exchanges, beyond rounding. So a
        light body is judged on its own scale, and a heavy one that a light one hits by what it takes up. An
        exchange that the data do not allow counts as the most that they do (k.most), and impulses so large
        that what is given back of them no longer sums up count, too.
        """
        worst, finite = V3(), dtype(0.0)
        for place in range(o.start, o.end):
            i = k.block[place]
            size = wp.abs(k.balance[i])
            move = k.move[i]
            most = k.most[i]
            rounds = k.lost[i] + k.unseen[i]
            x = off(size[0], rounds[0], move[0], most[0], worst[0])
            y = off(size[1], rounds[1], move[1], most[1], worst[1])
            worst = V3(x, y, off(size[2], rounds[2], move[2], most[2], worst[2]))
            finite += size[0] + size[1] + size[2]
        if not wp.isfinite(finite):
            return HUGE
        return wp.max(worst[0], wp.max(worst[1], worst[2]))

    @wp.func(inline=False)
    def rounded(k: wp.ref[Slot], o: Island):
        """Of `imbalance`, after it: what the rounding of impulses, as they are given back, counts as."""
        worst = dtype(0.0)
        for place in range(o.start, o.end):
            i = k.block[place]
            for j in range(3):
                told = TOLD * k.move[i][j]
                if told > GOOD * k.most[i][j]:
                    worst = wp.max(worst, told / k.most[i][j])
        return worst

    @wp.func
    def unbalanced(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.balance = M (v' - v_free) - J' lambda, and the largest residual of a place."""
        begin_balance(t, k, o)
        for g in range(o.group, o.last_group):
            exchange(t, k, g)
        return imbalance(k, o)

    @wp.func(inline=False)
    def residuals(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, inside: int, yielding: dtype):
        """lambda, w, k.res and k.balance at a point; the largest residual, whether the matrix changes, and
        inside the largest a. A row yields by `yielding` diag(A) (lambda - k.least). Its residual is relative
        to the velocities that the data set in its island.
        """
        # long: one pass over a group's rows, whose sums stay in registers
        begin_balance(t, k, o)
        changed = put(k, o, inside)
        for g in range(o.group, o.last_group):
            start, end, entry, entries, one, two = ends(t, k, g)
            v = k.v[one]
            u = V3()
            if entries == 2:
                u = k.v[two]
            x, y, z, ax, ay, az = dtype(0.0), dtype(0.0), dtype(0.0), dtype(0.0), dtype(0.0), dtype(0.0)
            p, q, s, ap, aq, az2 = dtype(0.0), dtype(0.0), dtype(0.0), dtype(0.0), dtype(0.0), dtype(0.0)
            at = entry + 0
            for r in range(start, end):
                if k.acting[r] > 0:
                    lam = k.lam[r]
                    res = k.rate[r] - k.w[r]
                    if entries <= 2:
                        j = k.jac[at]
                        m = k.jac[at + entries - 1]
                        res += wp.dot(j, v) + wp.dot(m, u)
                        j = lam * j
                        m = lam * m
                        x += j[0]
                        y += j[1]
                        z += j[2]
                        p += m[0]
                        q += m[1]
                        s += m[2]
                        ax += wp.abs(j[0])
                        ay += wp.abs(j[1])
                        az += wp.abs(j[2])
                        ap += wp.abs(m[0])
                        aq += wp.abs(m[1])
                        az2 += wp.abs(m[2])
                    else:
                        res += dot(t, k, k.v, r)
                    k.res[r] = res
                at += entries
            if entries > 2:
                exchange(t, k, g)
            else:
                k.balance[one] = k.balance[one] - V3(x, y, z)
                k.move[one] = k.move[one] + V3(ax, ay, az)
                if entries == 2:
                    k.balance[two] = k.balance[two] - V3(p, q, s)
                    k.move[two] = k.move[two] + V3(ap, aq, az2)
        worst = wp.static(rows.finish)(
            o.row, o.last_row, k.acting, inside, yielding, SEEN, k.unit, k.res, k.diag, k.lam, k.least, k.a,
            k.z, k.sigma, k.w, k.slack,
        )  # fmt: skip
        off = wp.where(wp.isfinite(worst[1]), worst[0], HUGE)
        return wp.max(off, imbalance(k, o)), changed, worst[2]

    @wp.func
    def weigh_rows(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, yielding: dtype):
        """k.weight: W; k.divisor: 1/T."""
        tau = TAU + yielding
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
        weigh(o.row, o.last_row, k.acting, tau, k.diag, k.inverse, k.p, k.slack, k.divisor, k.weight)

    @wp.func
    def factor(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, yielding: dtype):
        """Factor of M + J' W J for k.p and k.slack."""
        weigh_rows(t, k, o, yielding)
        matrix.assemble(t, k, o)
        env.factor(k.factor, k.first, k.at, o.start, o.end)

    @wp.func
    def push_rows(t: wp.ref[Topology], k: wp.ref[Slot], g: int, mu: dtype, inside: int, yielding: dtype):
        """What a group's rows add to the right-hand side k.move; k.aimed, and k.dz as if dv were zero."""
        start, end, entry, entries, one, two = ends(t, k, g)
        x, y, z = dtype(0.0), dtype(0.0), dtype(0.0)
        p, q, s = dtype(0.0), dtype(0.0), dtype(0.0)
        at = entry + 0
        for r in range(start, end):
            k.weight[r] = ZERO
            if k.acting[r] > 0:
                e = dtype(0.0)
                miss = -k.res[r]
                if inside == 1:
                    e = (mu - k.excess[r] - k.cross[r]) / k.total[r]
                    k.aimed[r] = e
                    miss += e - yielding * k.diag[r] * k.inverse[r] * e
                dz = miss * k.divisor[r]
                k.dz[r] = dz
                push = (k.p[r] * dz + e) * k.inverse[r]
                k.weight[r] = push
                if entries <= 2:
                    j = push * k.jac[at]
                    m = push * k.jac[at + entries - 1]
                    x += j[0]
                    y += j[1]
                    z += j[2]
                    p += m[0]
                    q += m[1]
                    s += m[2]
            at += entries
        if entries > 2:
            matrix.push_group(t, k, g)
        else:
            k.move[one] = k.move[one] + V3(x, y, z)
            if entries == 2:
                k.move[two] = k.move[two] + V3(p, q, s)

    @wp.func
    def turn_rows(t: wp.ref[Topology], k: wp.ref[Slot], g: int, inside: int, least: dtype):
        """k.dz of a group's rows at dv = k.move; see `direction` for what it gives back."""
        start, end, entry, entries, one, two = ends(t, k, g)
        v = k.move[one]
        u = V3()
        if entries == 2:
            u = k.move[two]
        fall = least + ZERO
        at = entry + 0
        for r in range(start, end):
            if k.acting[r] > 0:
                change = dtype(0.0)
                if entries <= 2:
                    change = wp.dot(k.jac[at], v) + wp.dot(k.jac[at + entries - 1], u)
                else:
                    change = dot(t, k, k.move, r)
                dz = k.dz[r] - change * k.divisor[r]
                k.dz[r] = dz
                if inside == 1:
                    da = -k.p[r] * dz - k.aimed[r]
                    dw = k.slack[r] * dz - k.aimed[r]
                    if da > fall * k.a[r]:
                        fall = da / k.a[r]
                    if dw > fall * k.w[r]:
                        fall = dw / k.w[r]
            at += entries
        return fall

    @wp.func(inline=False)
    def direction(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, mu: dtype, inside: int, yielding: dtype):
        """dv into k.move, dz into k.dz and e into k.aimed with the factor at hand. e is zero in Newton's
        method, towards excess = mu in the interior-point method: there also the share of the step in which
        the first a or w is used up, inverted.
        """
        for place in range(o.start, o.end):
            i = k.block[place]
            k.move[i] = -k.balance[i]
        for g in range(o.group, o.last_group):
            push_rows(t, k, g, mu, inside, yielding)
        env.solve(k.factor, k.first, k.at, k.block, k.move, o.start, o.end)
        fall = dtype(0.0)
        for g in range(o.group, o.last_group):
            fall = turn_rows(t, k, g, inside, fall)
        return fall

    return SimpleNamespace(
        smooth=smooth,
        dot=dot,
        sized=sized,
        rounding=rounding,
        residuals=residuals,
        unbalanced=unbalanced,
        rounded=rounded,
        assemble=matrix.assemble,
        weigh_rows=weigh_rows,
        factor=factor,
        direction=direction,
        add_pushes=matrix.add_pushes,
        turn_group=matrix.turn_group,
        ends=ends,
        GOOD=GOOD,
        mass_times=mass_times,
        LOST=LOST,
        env=env,
    )
