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
from .envelope import make_envelope
from .topology import Topology
from .work import M33, V3, WORK, Island, Slot

PROXIMAL = 1e-11  # tau; with 1e-12 rows that all but repeat others cost blocks of three their last digits
ROUNDING = 2e-14  # of M (v' - v_free) where v' and v_free are stored, relative to |M| |v_free|
TOLERANCE = 2e-14  # residual relative to the size of its terms: the aim,
# and what is good enough where rounding, or rows that all but repeat others, end the iteration
ACCEPTED = {wp.float64: 2e-11, wp.float32: 1e-6}
REFINED = 1e-12  # what is worse is refined further: of light bodies' v' the residual of M dv is 30 times that
GIVEN = {wp.float64: 1.1e-16, wp.float32: 6e-8}  # rounding of the impulses that are given back
SUMMED = {wp.float64: 5e-11, wp.float32: 1e-5}  # what it may make of momenta, relative to those in the data


@cached
def make_newton(given: type, residual: str) -> SimpleNamespace:
    """Warp functions: residuals and linear algebra on the acting rows of an island."""
    dtype = WORK
    env = make_envelope()
    sm = make_smoothing(dtype, residual)
    hard = residual == "hard"
    ZERO, ONE = dtype(0.0), dtype(1.0)
    LOST, TOLD = dtype(ROUNDING), dtype(GIVEN[given] * ACCEPTED[given] / SUMMED[given])
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
            for j in range(t.mass_first[i], i):
                m = k.mass[at + j]
                value += m * (k.v[j] - k.vfree[j])
                k.balance[j] = k.balance[j] + wp.transpose(m) * change
            k.balance[i] = value

    @wp.func
    def rounding(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.lost, in all blocks."""
        for i in range(t.blocks):
            at = t.mass_at[i]
            value = sized(k.mass[at + i], k.vfree[i])
            for j in range(t.mass_first[i], i):
                m = k.mass[at + j]
                value += sized(m, k.vfree[j])
                k.lost[j] = k.lost[j] + LOST * sized(wp.transpose(m), k.vfree[i])
            k.lost[i] = LOST * value

    @wp.func
    def missed(balance: dtype, rounds: dtype, move: dtype, most: dtype):
        """Residual of a place: relative to the momentum that it exchanges, beyond rounding."""
        miss = wp.abs(balance) - rounds
        worst = dtype(0.0)
        if miss > ZERO:
            worst = miss / wp.min(move, most)
        told = TOLD * move
        if told > GOOD * most:
            worst = wp.max(worst, told / most)
        return worst

    @wp.func
    def exchange(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Take J' lambda off k.balance and add its terms to k.move."""
        for g in range(o.group, o.last_group):
            start = k.group[g]
            end = k.group[g + 1]
            pattern = k.pattern[start]
            for e in range(k.entry[start + 1] - k.entry[start]):
                x, y, z = dtype(0.0), dtype(0.0), dtype(0.0)  # sums in registers: a vector's are not
                ax, ay, az = dtype(0.0), dtype(0.0), dtype(0.0)
                r = int(start)
                while r < end:
                    if k.acting[r] > 0:
                        impulse = k.lam[r] * k.jac[k.entry[r] + e]
                        x += impulse[0]
                        y += impulse[1]
                        z += impulse[2]
                        ax += wp.abs(impulse[0])
                        ay += wp.abs(impulse[1])
                        az += wp.abs(impulse[2])
                    r += 1
                b = t.row_block[pattern + e]
                k.balance[b] = k.balance[b] - V3(x, y, z)
                k.move[b] = k.move[b] + V3(ax, ay, az)

    @wp.func
    def unbalanced(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.balance, and the largest residual of a place: relative to the momentum that it exchanges, beyond
        rounding. So a light body is judged on its own scale, and a heavy one that a light one hits by what it
        takes up. An exchange that the data do not allow counts as the most that they do (k.most), and
        impulses so large that what is given back of them no longer sums up count, too.
        """
        mass_times(t, k, o)
        for place in range(o.start, o.end):
            i = k.block[place]
            k.move[i] = wp.abs(k.balance[i])
        exchange(t, k, o)
        worst = dtype(0.0)
        finite = dtype(0.0)
        for place in range(o.start, o.end):
            i = k.block[place]
            balance = k.balance[i]
            move = k.move[i]
            most = k.most[i]
            rounds = k.lost[i] + k.unseen[i]
            for j in range(3):
                worst = wp.max(worst, missed(balance[j], rounds[j], move[j], most[j]))
                finite += wp.abs(balance[j])
        if not wp.isfinite(finite):
            worst = ZERO + HUGE
        return worst

    @wp.func(inline=False)
    def residuals(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, yielding: dtype):
        """k.balance and the largest residual; needs k.lam, k.res, k.w. A row yields by `yielding` diag(A)
        (lambda - k.least). Its residual is relative to the velocities that the data set in its island.
        """
        worst = dtype(0.0)
        finite = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                res = k.rate[r] + dot(t, k, k.v, r) - k.w[r]
                if yielding > ZERO:
                    res += yielding * k.diag[r] * (k.lam[r] - k.least[r])
                k.res[r] = res
                if wp.abs(res) > worst * k.unit[r]:
                    worst = wp.abs(res) / k.unit[r]
                finite += wp.abs(res)
        if not wp.isfinite(finite):
            worst = ZERO + HUGE
        return wp.max(worst, unbalanced(t, k, o))

    @wp.func
    def weigh(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, yielding: dtype):
        """k.weight: W."""
        tau = TAU + yielding
        for r in range(o.row, o.last_row):
            p = dtype(0.0)
            if k.acting[r] > 0:
                p = k.p[r]
            if p > ZERO:
                p = p / (k.slack[r] * k.scale[r] + tau * k.diag[r] * p)
            k.weight[r] = p

    @wp.func
    def couple(k: wp.ref[Slot], start: int, end: int, e: int, f: int):
        """J' W J of a group's rows for two of its blocks."""
        a, b, c = dtype(0.0), dtype(0.0), dtype(0.0)
        d, g, h = dtype(0.0), dtype(0.0), dtype(0.0)
        p, q, s = dtype(0.0), dtype(0.0), dtype(0.0)
        r = int(start)
        while r < end:
            weight = k.weight[r]
            if weight > ZERO:
                left = weight * k.jac[k.entry[r] + e]
                right = k.jac[k.entry[r] + f]
                a += left[0] * right[0]
                b += left[0] * right[1]
                c += left[0] * right[2]
                d += left[1] * right[0]
                g += left[1] * right[1]
                h += left[1] * right[2]
                p += left[2] * right[0]
                q += left[2] * right[1]
                s += left[2] * right[2]
            r += 1
        return M33(a, b, c, d, g, h, p, q, s)

    @wp.func(inline=False)
    def assemble(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """M + J' W J: what a pair of bodies' rows add is summed up before it is stored."""
        for place in range(o.start, o.end):
            at = k.at[place]
            b = k.block[place]
            own = place - b + t.mass_first[b]
            for j in range(k.first[place], own):
                k.factor[at + j] = M33()
            for j in range(own, place + 1):
                k.factor[at + j] = k.mass[t.mass_at[b] + j + b - place]
        for g in range(o.group, o.last_group):
            start = k.group[g]
            end = k.group[g + 1]
            pattern = k.pattern[start]
            entries = k.entry[start + 1] - k.entry[start]
            for e in range(entries):
                one = k.place[t.row_block[pattern + e]]
                for f in range(e + 1):
                    two = k.place[t.row_block[pattern + f]]
                    total = couple(k, start, end, e, f)
                    if one < two:
                        k.factor[k.at[two] + one] = k.factor[k.at[two] + one] + wp.transpose(total)
                    else:
                        k.factor[k.at[one] + two] = k.factor[k.at[one] + two] + total

    @wp.func
    def factor(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, yielding: dtype):
        """Factor of M + J' W J for k.p and k.slack."""
        weigh(t, k, o, yielding)
        assemble(t, k, o)
        env.factor(k.factor, k.first, k.at, o.start, o.end)

    @wp.func
    def shift(k: wp.ref[Slot], r: int, mu: dtype, interior: int):
        """e of row r: zero in Newton's method, towards excess = mu in the interior-point method."""
        if interior == 0:
            return ZERO
        return (mu - k.excess[r] - k.cross[r]) / k.total[r]

    @wp.func
    def add_pushes(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.move += J' k.weight of all rows."""
        for g in range(o.group, o.last_group):
            start = k.group[g]
            end = k.group[g + 1]
            pattern = k.pattern[start]
            for e in range(k.entry[start + 1] - k.entry[start]):
                x, y, z = dtype(0.0), dtype(0.0), dtype(0.0)
                r = int(start)
                while r < end:
                    push = k.weight[r] * k.jac[k.entry[r] + e]
                    x += push[0]
                    y += push[1]
                    z += push[2]
                    r += 1
                b = t.row_block[pattern + e]
                k.move[b] = k.move[b] + V3(x, y, z)

    @wp.func(inline=False)
    def direction(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, mu: dtype, interior: int, yielding: dtype):
        """dv into k.move and dz into k.dz with the factor at hand."""
        tau = TAU + yielding
        for place in range(o.start, o.end):
            i = k.block[place]
            k.move[i] = -k.balance[i]
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
            if k.acting[r] > 0:
                e = shift(k, r, mu, interior)
                p = k.p[r]
                ratio = k.diag[r] / k.scale[r]
                total = k.slack[r] + tau * ratio * p
                miss = e - yielding * ratio * e - k.res[r]
                k.weight[r] = (p * miss / total + e) / k.scale[r]
                k.dz[r] = miss / total
                k.divisor[r] = total
        add_pushes(t, k, o)
        env.solve(k.factor, k.first, k.at, k.block, k.move, o.start, o.end)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.dz[r] = k.dz[r] - dot(t, k, k.move, r) / k.divisor[r]

    return SimpleNamespace(
        smooth=smooth,
        dot=dot,
        rounding=rounding,
        residuals=residuals,
        unbalanced=unbalanced,
        assemble=assemble,
        factor=factor,
        direction=direction,
        add_pushes=add_pushes,
        shift=shift,
        GOOD=GOOD,
        mass_times=mass_times,
        LOST=LOST,
        env=env,
    )
