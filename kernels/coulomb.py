"""Hard contact with Coulomb's friction in the plane (the paper's [8]), by active sets, Lemke's behind.

Rows of a frictional pair are (n, t): 0 <= lambda_n _|_ w_n = J_n v' + d/h >= 0, and lambda_t in
[-mu lambda_n, mu lambda_n] opposes v_t = J_t v'. In velocity units, with A = J M^-1 J' (2a):
z_n = A_nn lambda_n - w_n decides whether a row presses (z_n > 0); z_t = A_tt lambda_t - v_t whether it
sticks (|z_t| <= A_tt mu lambda_n) or slides. Given every row's mode the impulses follow from one linear
system; its solution gives new modes, a semismooth Newton step on the natural map. Redundant contacts are met
by a proximal term about the last impulses, which leaves no trace where the iteration ends. Where the modes
cycle, Lemke's method (lemke.py) finds modes to start from: a solution exists [8] unless no velocity opens
the rows. Several solutions may exist (Painleve); the one found first is returned, and it is checked.
"""

import functools
from types import SimpleNamespace

import warp as wp

from .coulomb_alone import make_alone
from .lemke import RAY, make_lemke
from .method import Method
from .rows import make_rows
from .solve import COLD, INFEASIBLE, JAMMED, NONFINITE, NOT_CONVERGED, SOLVED
from .structure import Structure, layout

ITERATIONS = 12  # of the active set, and as many more for every row
TOLERANCE = {wp.float64: 1e-13, wp.float32: 2e-6}  # of the natural map, relative to the problem's size
ACCEPT = {wp.float64: 3e-12, wp.float32: 1e-5}  # the same where rounding may be all that is left
# relative to A_ii: at first, and where rows are nearly redundant
PROXIMAL = {wp.float64: (1e-9, 1e-13), wp.float32: (1e-4, 3e-7)}
OFF, PRESS, STICK, LEFT, RIGHT = 0, 1, 2, 3, 4  # modes; LEFT: lambda_t = -mu lambda_n, RIGHT: + mu lambda_n


@functools.cache
def make_active(s: Structure, dtype: type, method: Method) -> SimpleNamespace:
    """The dense problem of the rows in the mask, and the linear system of given modes.

    gather(params, row, minv, vfree, jac, rate, mask) -> Dense; modes(dense, z) -> MODES;
    factor(dense, modes, tau) -> Lu; impulses(dense, modes, lu, target, centre) -> lambda with
    A lambda + target = 0 in the rows that hold; `transposed` is its adjoint.
    """
    r = make_rows(s, dtype, method)
    t = r.types
    NR = s.nr
    VQ, MQ, VR, JR = t.VQ, t.MQ, t.VR, t.JR
    AR = wp.types.matrix((NR, NR), dtype)
    MODES = wp.types.vector(NR, wp.int32)
    ZERO = dtype(0.0)
    SMALLEST = dtype(1e-30)
    FRICTION = layout(s).offset("friction")
    pair = tuple(row.index if row.kind == "contact" else 0 for row in s.rows)

    @wp.struct
    class Dense:
        count: int
        row: MODES  # row of the structure
        tangent: MODES  # 1: friction row of the normal row before it
        a: AR  # A
        b: VR  # J v_free + d/h
        mu: VR
        response: JR  # M^-1 J_i'
        size: dtype  # of the terms of the natural map

    @wp.struct
    class Lu:
        size: int
        unknown: MODES  # row of every unknown
        order: MODES
        m: AR

    @wp.func
    def gather(
        params: wp.array2d(dtype=dtype),
        row: int,
        minv: MQ,
        vfree: VQ,
        jac: JR,
        rate: VR,
        mask: int,
    ):
        out = Dense()
        n = int(0)
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                out.row[n] = wp.static(i)
                out.response[n] = wp.static(r.applies[i])(minv, jac)
                out.b[n] = wp.static(r.dots[i])(jac, vfree) + rate[i]
                size = wp.abs(out.b[n]) + wp.abs(rate[i])
                if wp.static(r.limit[i]):
                    size += wp.abs(vfree[wp.static(s.rows[i].index)])
                else:
                    for j in range(wp.static(s.nv)):
                        size += wp.abs(jac[i, j] * vfree[j])
                out.size = wp.max(out.size, size)
                for k in range(n + 1):
                    value = wp.static(r.dots[i])(jac, out.response[k])
                    out.a[n, k] = value
                    out.a[k, n] = value
                out.a[n, n] = wp.max(out.a[n, n], SMALLEST)
                if wp.static(r.tangent[i]):
                    out.tangent[n] = 1
                    out.mu[n] = params[row, wp.static(FRICTION + pair[i])]
                n += 1
        out.count = n
        return out

    @wp.func
    def modes(dense: Dense, z: VR):
        """The mode of every row; a tie presses not, and sticks."""
        out = MODES()
        for i in range(dense.count):
            if dense.tangent[i] == 0:
                if z[i] > ZERO:
                    out[i] = wp.static(PRESS)
            elif out[i - 1] == wp.static(PRESS):
                bound = dense.a[i, i] * dense.mu[i] * z[i - 1] / dense.a[i - 1, i - 1]
                out[i] = wp.static(STICK)
                if z[i] > bound:
                    out[i] = wp.static(RIGHT)
                if z[i] < -bound:
                    out[i] = wp.static(LEFT)
        return out

    @wp.func
    def ratio(dense: Dense, mode: MODES, i: int):
        """lambda_t/lambda_n of the normal row i while its contact slides, else 0."""
        out = ZERO
        if i + 1 < dense.count:
            if dense.tangent[i + 1] == 1:
                if mode[i + 1] == wp.static(RIGHT):
                    out = dense.mu[i + 1]
                if mode[i + 1] == wp.static(LEFT):
                    out = -dense.mu[i + 1]
        return out

    @wp.func
    def factor(dense: Dense, mode: MODES, tau: dtype):
        """LU factors with partial pivoting of the rows that hold, A + tau diag(A)."""
        out = Lu()
        n = int(0)
        for i in range(dense.count):
            if mode[i] == wp.static(PRESS) or mode[i] == wp.static(STICK):
                out.unknown[n] = i
                n += 1
        out.size = n
        for c in range(n):
            j = out.unknown[c]
            slide = ratio(dense, mode, j)
            if dense.tangent[j] == 1:
                slide = ZERO
            for k in range(n):
                i = out.unknown[k]
                # in units of sqrt(A_ii): pivots of heavy and of light bodies compare
                value = dense.a[i, j]
                if slide != ZERO:
                    value += slide * dense.a[i, j + 1]
                if i == j:
                    value += tau * dense.a[i, i]
                out.m[k, c] = value / wp.sqrt(dense.a[i, i] * dense.a[j, j])
            out.order[c] = c
        for c in range(n):
            best = int(c)
            for k in range(c + 1, n):
                if wp.abs(out.m[k, c]) > wp.abs(out.m[best, c]):
                    best = k
            if best != c:
                held = out.order[c]
                out.order[c] = out.order[best]
                out.order[best] = held
                for j in range(n):
                    value = out.m[c, j]
                    out.m[c, j] = out.m[best, j]
                    out.m[best, j] = value
            pivot = out.m[c, c]
            if wp.abs(pivot) > SMALLEST:
                for k in range(c + 1, n):
                    share = out.m[k, c] / pivot
                    out.m[k, c] = share
                    for j in range(c + 1, n):
                        out.m[k, j] = out.m[k, j] - share * out.m[c, j]
        return out

    @wp.func
    def impulses(dense: Dense, mode: MODES, lu: Lu, target: VR, centre: VR, tau: dtype):
        """lambda with (A + tau diag(A)) lambda = tau diag(A) centre - target in the rows that hold."""
        x = VR()
        for c in range(lu.size):
            i = lu.unknown[lu.order[c]]
            value = (tau * dense.a[i, i] * centre[i] - target[i]) / wp.sqrt(dense.a[i, i])
            for k in range(c):
                value -= lu.m[c, k] * x[k]
            x[c] = value
        for back in range(lu.size):
            c = lu.size - 1 - back
            value = x[c]
            for k in range(c + 1, lu.size):
                value -= lu.m[c, k] * x[k]
            pivot = lu.m[c, c]
            x[c] = wp.where(wp.abs(pivot) > SMALLEST, value / pivot, ZERO)
        out = VR()
        for c in range(lu.size):
            j = lu.unknown[c]
            value = x[c] / wp.sqrt(dense.a[j, j])
            out[j] = value
            if dense.tangent[j] == 0:
                slide = ratio(dense, mode, j)
                if slide != ZERO:
                    out[j + 1] = slide * value
        return out

    @wp.func
    def transposed(dense: Dense, mode: MODES, lu: Lu, target: VR):
        """rho in the rows that hold, of the transposed system: with S the impulses lambda = S lambda_hold
        of all rows, (J_hold M^-1 J' S)' rho = S' target.
        """
        x = VR()
        for c in range(lu.size):
            j = lu.unknown[c]
            value = target[j]
            if dense.tangent[j] == 0:
                slide = ratio(dense, mode, j)
                if slide != ZERO:
                    value += slide * target[j + 1]
            value = value / wp.sqrt(dense.a[j, j])
            for k in range(c):
                value -= lu.m[k, c] * x[k]
            pivot = lu.m[c, c]
            x[c] = wp.where(wp.abs(pivot) > SMALLEST, value / pivot, ZERO)
        out = VR()
        for back in range(lu.size):
            c = lu.size - 1 - back
            value = x[c]
            for k in range(c + 1, lu.size):
                value -= lu.m[k, c] * x[k]
            x[c] = value
            i = lu.unknown[lu.order[c]]
            out[i] = value / wp.sqrt(dense.a[i, i])
        return out

    return SimpleNamespace(
        types=t,
        rows=r,
        Dense=Dense,
        Lu=Lu,
        MODES=MODES,
        gather=gather,
        modes=modes,
        factor=factor,
        impulses=impulses,
        transposed=transposed,
    )


@functools.cache
def make_coulomb_solver(s: Structure, dtype: type, method: Method) -> wp.Function:
    """solve(params, row, minv, vfree, jac, rate, scale, sigma, mask, warm) -> v', z, lambda, status, it."""
    active = make_active(s, dtype, method)
    lemke = make_lemke(s, dtype, active.Dense)
    single = make_alone(s, dtype, method)
    t = active.types
    VQ, MQ, VR, JR = t.VQ, t.MQ, t.VR, t.JR
    Dense = active.Dense
    ZERO = dtype(0.0)
    TOL, ENOUGH = dtype(TOLERANCE[dtype]), dtype(ACCEPT[dtype])
    TAU, NEARLY_NONE = (dtype(x) for x in PROXIMAL[dtype])
    HUGE, SMALLEST = dtype(1e30), dtype(1e-30)
    EPSILON = dtype(4e-16 if dtype is wp.float64 else 6e-8)
    PROOF = dtype(0.0015 if dtype is wp.float64 else 1.0)  # worst is compared with 3e-12 or 1e-5
    UNUSED = dtype(0.5 * COLD)

    @wp.func
    def alone(dense: Dense):
        # z of every contact as if it were the only one
        z = VR()
        for i in range(dense.count):
            if dense.tangent[i] == 0:
                z[i] = -dense.b[i]
                with_friction = int(0)
                if i + 1 < dense.count:
                    with_friction = dense.tangent[i + 1]
                if with_friction == 1 and dense.b[i] < ZERO:
                    ann = dense.a[i, i]
                    att = dense.a[i + 1, i + 1]
                    ant = dense.a[i, i + 1]
                    mu = dense.mu[i + 1]
                    det = ann * att - ant * ant
                    ln = (ant * dense.b[i + 1] - att * dense.b[i]) / det
                    lt = (ant * dense.b[i] - ann * dense.b[i + 1]) / det
                    if not (ln > ZERO and wp.abs(lt) <= mu * ln):
                        slide = wp.where(lt > ZERO, mu, -mu)
                        if not (ann + slide * ant > ZERO):
                            slide = -slide
                        ln = -dense.b[i] / (ann + slide * ant)
                        lt = slide * ln
                    z[i] = ann * ln
                    z[i + 1] = att * lt - (dense.b[i + 1] + ant * ln + att * lt)
        return z

    @wp.struct
    class Trial:
        lam: VR
        z: VR
        worst: dtype  # of the natural map

    @wp.func
    def judge(dense: Dense, lam: VR):
        # z and the natural map at these impulses
        out = Trial()
        out.lam = lam
        for i in range(dense.count):
            w = dense.b[i]
            rounding = ZERO
            for j in range(dense.count):
                w += dense.a[i, j] * lam[j]
                rounding += wp.abs(dense.a[i, j] * lam[j])
            out.z[i] = dense.a[i, i] * lam[i] - w
            error = ZERO
            if dense.tangent[i] == 0:
                error = wp.abs(wp.min(dense.a[i, i] * lam[i], w))
            else:
                bound = dense.a[i, i] * dense.mu[i] * wp.max(lam[i - 1], ZERO)
                error = wp.abs(dense.a[i, i] * lam[i] - wp.clamp(out.z[i], -bound, bound))
            # impulses that cancel may hide what is wrong, and may be all that is wrong
            error = wp.max(error - EPSILON * rounding, PROOF * EPSILON * rounding)
            if not (error <= out.worst):  # a NaN stays
                out.worst = error
        return out

    @wp.func
    def settle(dense: Dense, z: VR, size: dtype, tau: dtype, before: Trial):
        # active sets from z; the best trial, or the one before
        best = before
        here = Trial()
        here.z = z
        for i in range(dense.count):
            if dense.tangent[i] == 0:
                here.lam[i] = wp.max(z[i], ZERO) / dense.a[i, i]
            else:
                bound = dense.mu[i] * here.lam[i - 1]
                here.lam[i] = wp.clamp(z[i] / dense.a[i, i], -bound, bound)
        it = int(0)
        while it < wp.static(ITERATIONS) + dense.count:
            it += 1
            mode = active.modes(dense, here.z)
            lu = active.factor(dense, mode, tau)
            lam = active.impulses(dense, mode, lu, dense.b, here.lam, tau)
            here = judge(dense, lam)
            if here.worst < best.worst:
                best = here
            if not (here.worst > TOL * size):
                it = wp.static(ITERATIONS) + dense.count
        return best

    @wp.func
    def solve(
        params: wp.array2d(dtype=dtype),
        row: int,
        minv: MQ,
        vfree: VQ,
        jac: JR,
        rate: VR,
        scale: VR,
        sigma: VR,
        mask: int,
        warm: VR,
    ):
        v, z_alone, lam_alone, found = single(params, row, minv, vfree, jac, rate, mask)
        if found == 1:
            return v, z_alone, lam_alone, wp.static(SOLVED), int(0)
        dense = active.gather(params, row, minv, vfree, jac, rate, mask)
        finite = int(1)
        for i in range(dense.count):
            if not wp.isfinite(dense.b[i]):
                finite = 0
        size = wp.max(dense.size, SMALLEST)
        z = alone(dense)
        for i in range(dense.count):
            before = warm[dense.row[i]]
            if wp.static(len(s.pairs) > 1) and wp.abs(before) < UNUSED:
                z[i] = before
        status = int(wp.static(NOT_CONVERGED))
        best = Trial()
        best.worst = HUGE
        if finite == 0:
            status = wp.static(NONFINITE)
        attempt = int(0)
        while status == wp.static(NOT_CONVERGED) and attempt < 6:
            if attempt == 2:
                lam, found = lemke(dense, int(1))
                z = judge(dense, lam).z
                if found == wp.static(RAY):
                    status = wp.static(JAMMED)
                    lam, opens = lemke(dense, int(0))
                    if opens == wp.static(RAY):
                        status = wp.static(INFEASIBLE)
            elif attempt == 4:
                z = alone(dense)  # where the warm start misled
            elif attempt > 0:
                z = best.z
            if status == wp.static(NOT_CONVERGED):
                tau = wp.where(attempt % 2 == 0, TAU, NEARLY_NONE)
                best = settle(dense, z, size, tau, best)
                if best.worst <= ENOUGH * size:
                    status = wp.static(SOLVED)
            attempt += 1
        v = vfree
        lam_out = VR()
        z_out = VR()
        for i in range(dense.count):
            k = dense.row[i]
            lam_out[k] = best.lam[i]
            z_out[k] = best.z[i]
            v += best.lam[i] * dense.response[i]
        return v, z_out, lam_out, status, attempt

    return solve
