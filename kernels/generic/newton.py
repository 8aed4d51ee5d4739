"""Linear algebra of a Newton step on (v', z) of any scene by its tables, and Newton's method itself.

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
from .mechanism import COLUMN
from .topology import Topology
from .work import WORK, Work

PROXIMAL = 1e-12  # tau
ROUNDING = 2e-14  # of M (v' - v_free) where v' and v_free are stored, relative to |M| |v_free|
TOLERANCE = 2e-14  # residual relative to the size of its terms: the aim,
# and what is good enough where rounding, or rows that all but repeat others, end the iteration
ACCEPTED = {wp.float64: 2e-11, wp.float32: 1e-6}
REFINED = 1e-12  # what is worse is refined further: of light bodies' v' the residual of M dv is 30 times that
GIVEN = {wp.float64: 1.1e-16, wp.float32: 6e-8}  # rounding of the impulses that are given back
SUMMED = {wp.float64: 5e-11, wp.float32: 1e-5}  # what it may make of momenta, relative to those in the data


@cached
def make_newton(given: type, residual: str) -> SimpleNamespace:
    """Warp functions: linear algebra on the list of active rows (n of them), residuals and `newton`."""
    dtype = WORK
    env = make_envelope(dtype)
    sm = make_smoothing(dtype, residual)
    hard = residual == "hard"
    SIGMA = COLUMN["sigma"]
    ZERO, ONE, HALF = dtype(0.0), dtype(1.0), dtype(0.5)
    LOST, TOLD = dtype(ROUNDING), dtype(GIVEN[given] * ACCEPTED[given] / SUMMED[given])
    FINE, NEAR, PATIENCE = dtype(min(ACCEPTED[given], REFINED)), dtype(1e-4), 6
    TAU, AIM, GOOD, HUGE = dtype(PROXIMAL), dtype(TOLERANCE), dtype(ACCEPTED[given]), dtype(1e300)

    @wp.func
    def smooth(t: Topology, params: wp.array2d(dtype=given), row: int, i: int, z: dtype):
        """s(z), s(-z), s'(z), s'(-z) of row i."""
        if wp.static(hard):
            return wp.static(sm.kink)(z)
        sigma = dtype(params[row, t.columns[SIGMA] + i])
        return wp.static(sm.smooth)(z, sigma, ONE / sigma)

    @wp.func
    def dot(t: Topology, k: Work, x: wp.array2d(dtype=dtype), i: int, b: int):
        """J_i x"""
        out = dtype(0.0)
        for at in range(t.row_start[i], t.row_start[i + 1]):
            out += k.jac[at, b] * x[t.row_place[at], b]
        return out

    @wp.func
    def add(t: Topology, k: Work, x: wp.array2d(dtype=dtype), i: int, scale: dtype, b: int):
        """x += J_i' scale"""
        for at in range(t.row_start[i], t.row_start[i + 1]):
            p = t.row_place[at]
            x[p, b] = x[p, b] + k.jac[at, b] * scale

    @wp.func
    def mass_times(t: Topology, k: Work, b: int):
        """k.balance = M (v' - v_free)"""
        for i in range(t.nv):
            k.balance[i, b] = ZERO
        for i in range(t.nv):
            xi = k.v[i, b] - k.vfree[i, b]
            value = dtype(0.0)
            for j in range(t.mass_first[i], i):
                m = k.mass[t.mass_at[i] + j, b]
                value += m * (k.v[j, b] - k.vfree[j, b])
                k.balance[j, b] = k.balance[j, b] + m * xi
            k.balance[i, b] = k.balance[i, b] + value + k.mass[t.mass_at[i] + i, b] * xi

    @wp.func
    def rounding(t: Topology, k: Work, b: int):
        """k.lost: what rounding of v' and v_free makes of M (v' - v_free)."""
        for i in range(t.nv):
            k.lost[i, b] = ZERO
        for i in range(t.nv):
            for j in range(t.mass_first[i], i + 1):
                m = LOST * wp.abs(k.mass[t.mass_at[i] + j, b])
                k.lost[i, b] = k.lost[i, b] + m * wp.abs(k.vfree[j, b])
                if j < i:
                    k.lost[j, b] = k.lost[j, b] + m * wp.abs(k.vfree[i, b])

    @wp.func
    def residuals(t: Topology, k: Work, b: int, n: int, yielding: dtype):
        """k.balance and the largest residual; needs k.lam, k.res, k.w. A row yields to its impulse by
        `yielding` diag(A) lambda.

        A row's is relative to the velocities that the data set in its island. That of a place is relative
        to the momentum that it exchanges, beyond rounding: so a light body is judged on its own scale, and a
        heavy one that a light one hits by what it takes up. An exchange that the data do not allow counts as
        the most that they do (k.most), and impulses so large that what is given back of them no longer sums
        up count, too.
        """
        mass_times(t, k, b)
        for i in range(t.nv):
            k.move[i, b] = wp.abs(k.balance[i, b])
        worst = dtype(0.0)
        bad = int(0)
        for r in range(n):
            i = k.active[r, b]
            yields = yielding * k.diag[i, b] * k.lam[i, b]
            k.res[i, b] = k.rate[i, b] + dot(t, k, k.v, i, b) + yields - k.w[i, b]
            worst = wp.max(worst, wp.abs(k.res[i, b]) / k.unit[i, b])
            if not wp.isfinite(k.res[i, b]):
                bad = 1
            lam = k.lam[i, b]
            for at in range(t.row_start[i], t.row_start[i + 1]):
                p = t.row_place[at]
                impulse = k.jac[at, b] * lam
                k.balance[p, b] = k.balance[p, b] - impulse
                k.move[p, b] = k.move[p, b] + wp.abs(impulse)
        for i in range(t.nv):
            miss = wp.abs(k.balance[i, b]) - k.lost[i, b] - k.unseen[i, b]
            if miss > ZERO:
                worst = wp.max(worst, miss / wp.min(k.move[i, b], k.most[i, b]))
            told = TOLD * k.move[i, b]
            if told > GOOD * k.most[i, b]:
                worst = wp.max(worst, told / k.most[i, b])
            if not wp.isfinite(k.balance[i, b]):
                bad = 1
        if bad == 1:
            worst = ZERO + HUGE
        return worst

    @wp.func
    def factor(t: Topology, k: Work, b: int, n: int, yielding: dtype):
        """Factor of M + J' W J for k.p and k.slack."""
        tau = TAU + yielding
        for i in range(t.nv):
            at = t.at[i]
            for j in range(t.first[i], t.mass_first[i]):
                k.factor[at + j, b] = ZERO
            for j in range(t.mass_first[i], i + 1):
                k.factor[at + j, b] = k.mass[t.mass_at[i] + j, b]
        for r in range(n):
            i = k.active[r, b]
            p = k.p[i, b]
            weight = p / (k.slack[i, b] * k.scale[i, b] + tau * k.diag[i, b] * p)
            start = t.row_start[i]
            for one in range(start, t.row_start[i + 1]):
                at = t.at[t.row_place[one]]
                left = weight * k.jac[one, b]
                for two in range(start, one + 1):
                    slot = at + t.row_place[two]
                    k.factor[slot, b] = k.factor[slot, b] + left * k.jac[two, b]
        env.factor(k.factor, t.first, t.at, t.nv, b)

    @wp.func
    def shift(k: Work, i: int, b: int, mu: dtype, interior: int):
        """e of row i: zero in Newton's method, towards excess = mu in the interior-point method."""
        if interior == 0:
            return ZERO
        return (mu - k.excess[i, b]) / k.total[i, b]

    @wp.func
    def direction(t: Topology, k: Work, b: int, n: int, mu: dtype, interior: int, yielding: dtype):
        """dv into k.move and dz into k.dz with the factor at hand."""
        tau = TAU + yielding
        for i in range(t.nv):
            k.move[i, b] = -k.balance[i, b]
        for r in range(n):
            i = k.active[r, b]
            e = shift(k, i, b, mu, interior)
            p = k.p[i, b]
            ratio = k.diag[i, b] / k.scale[i, b]
            total = k.slack[i, b] + tau * ratio * p
            miss = e - yielding * ratio * e - k.res[i, b]
            add(t, k, k.move, i, (p * miss / total + e) / k.scale[i, b], b)
        env.solve(k.factor, t.first, t.at, k.move, t.nv, b)
        for r in range(n):
            i = k.active[r, b]
            e = shift(k, i, b, mu, interior)
            ratio = k.diag[i, b] / k.scale[i, b]
            total = k.slack[i, b] + tau * ratio * k.p[i, b]
            k.dz[i, b] = (e - yielding * ratio * e - k.res[i, b] - dot(t, k, k.move, i, b)) / total

    @wp.func
    def evaluate(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, n: int):
        """lambda, slopes and residuals at (k.v, k.z); the largest of these."""
        for r in range(n):
            i = k.active[r, b]
            e = smooth(t, params, row, i, k.z[i, b])
            k.lam[i, b] = e[0] / k.scale[i, b]
            k.w[i, b] = e[1]
            k.p[i, b] = e[2]
            k.slack[i, b] = e[3]
        return residuals(t, k, b, n, ZERO)

    @wp.func
    def newton(
        t: Topology,
        k: Work,
        params: wp.array2d(dtype=given),
        row: int,
        b: int,
        n: int,
        iterations: int,
    ):
        """Full steps from (k.v, k.z) while they help; the best point stays, 1 if it is a solution."""
        best = ZERO + HUGE
        misses = int(0)
        patience = int(2)
        it = int(0)
        while it < iterations and misses < patience and best > AIM:
            worst = evaluate(t, k, params, row, b, n)
            if worst > HALF * best:
                misses += 1
            if worst < best:
                best = worst + ZERO
                for i in range(t.nv):
                    k.best_v[i, b] = k.v[i, b]
                for r in range(n):
                    i = k.active[r, b]
                    k.best_z[i, b] = k.z[i, b]
            patience = wp.where(best > FINE and best < NEAR, PATIENCE, 2)  # nearly solved: refine it further
            if not (worst < HUGE):
                misses = patience
            it += 1
            if it < iterations and misses < patience and best > AIM:
                factor(t, k, b, n, ZERO)
                direction(t, k, b, n, ZERO, 0, ZERO)
                for i in range(t.nv):
                    k.v[i, b] = k.v[i, b] + k.move[i, b]
                for r in range(n):
                    i = k.active[r, b]
                    k.z[i, b] = k.z[i, b] + k.dz[i, b]
        for i in range(t.nv):
            k.v[i, b] = k.best_v[i, b]
        for r in range(n):
            i = k.active[r, b]
            k.z[i, b] = k.best_z[i, b]
            k.lam[i, b] = smooth(t, params, row, i, k.z[i, b])[0] / k.scale[i, b]
        return wp.where(best <= GOOD, 1, 0)

    return SimpleNamespace(
        smooth=smooth,
        dot=dot,
        add=add,
        rounding=rounding,
        residuals=residuals,
        factor=factor,
        direction=direction,
        shift=shift,
        newton=newton,
        GOOD=GOOD,
        mass_times=mass_times,
        LOST=LOST,
        env=env,
        SIGMA=SIGMA,
    )
