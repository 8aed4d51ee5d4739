"""The modes of contacts under Coulomb's friction, and the linear system of given modes.

Rows are (n, t) as in `coulomb.py`. A row presses (z_n > 0) or not; a pressed contact sticks, |z_t| <= A_tt mu
lambda_n, or slides either way.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import make_problem
from ..contact.rows import make_rows
from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout

ROUNDING = {wp.float64: 2e-14, wp.float32: 4e-7}  # of a gap [m]
TOLD = {wp.float64: 5e-11, wp.float32: 1e-5}  # of a row's own scale: what w may miss of it
CANCELLED = {wp.float64: 5e6, wp.float32: 166.0}  # of |A| |lambda|: rounding of more leaves less
PLAIN = {wp.float64: 1e5, wp.float32: 30.0}  # and to which an answer needs no proof that there is one
DOUBTFUL = 2  # beside 0 and 1: earned, if there is a solution at all
OFF, PRESS, STICK, LEFT, RIGHT = 0, 1, 2, 3, 4  # modes; LEFT: lambda_t = -mu lambda_n, RIGHT: + mu lambda_n


@cached
def make_active(spec: Specialisation) -> SimpleNamespace:
    """The dense problem of the rows in the mask, and the linear system of given modes.

    gather(world, problem) -> Dense; is_earned(dense, lambda); modes(dense, z, edge) -> MODES;
    factor(dense, modes, tau) -> Lu; impulses(dense, modes, lu, target, centre) -> lambda with
    A lambda + target = 0 in the rows that hold; `transposed` is its adjoint.
    """
    s, dtype, _ = spec
    r = make_rows(spec)
    t = r.types
    NR = s.nr
    VR, JR = t.VR, t.JR
    Problem = make_problem(s, dtype)
    AR = wp.types.matrix((NR, NR), dtype)
    MODES = wp.types.vector(NR, wp.int32)
    ZERO = dtype(0.0)
    SMALLEST = dtype(1e-30)
    SHARE = dtype(1e-12 if dtype is wp.float64 else 1e-5)
    CLOSE, MOST = dtype(ROUNDING[dtype]), dtype(CANCELLED[dtype])
    MISS, LITTLE = dtype(TOLD[dtype]), dtype(PLAIN[dtype])
    FRICTION, H = layout(s).offset("friction"), layout(s).offset("step_size")
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
        size: VR  # of the terms of the natural map in every row, as J v_free, d/h and A set it
        near: VR  # the same without the terms of other rows that are open at v_free
        own: VR  # of the row's own terms
        shut: int  # 1: a row that no impulse moves (J = 0) is violated
        lost: int  # 1: it has a J, but M^-1 has no digits for it

    @wp.struct
    class Lu:
        size: int
        unknown: MODES  # row of every unknown
        order: MODES
        m: AR

    @wp.func
    def touch(world: t.World, p: Problem):
        """The problem with gaps of 0 where they are roundings of 0; how many are."""
        out = p
        close = CLOSE / world.params[wp.static(H)]
        rounded = int(0)
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0 and wp.static(not r.tangent[i]):
                if out.rate[i] != ZERO and wp.abs(out.rate[i]) <= close:
                    out.rate[i] = ZERO
                    rounded += 1
        return out, rounded

    @wp.func
    def gather(world: t.World, p: Problem):
        out = Dense()
        a, b, own, response = AR(), VR(), VR(), JR()
        row, tangent = MODES(), MODES()
        size, closing = dtype(0.0), dtype(0.0)
        n = int(0)
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                row[n] = wp.static(i)
                response[n] = wp.static(r.applies[i])(p.minv, p.jac)
                b[n] = wp.static(r.dots[i])(p.jac, p.vfree) + p.rate[i]
                terms = wp.abs(b[n]) + wp.abs(p.rate[i])
                lever = ZERO
                if wp.static(r.limit[i]):
                    terms += wp.abs(p.vfree[wp.static(s.rows[i].index)])
                    lever = dtype(1.0)
                else:
                    for j in range(wp.static(s.nv)):
                        terms += wp.abs(p.jac[i, j] * p.vfree[j])
                        lever = wp.max(lever, wp.abs(p.jac[i, j]))
                size = wp.max(size, terms)
                if wp.static(r.tangent[i]) or b[n] < ZERO:
                    closing = wp.max(closing, terms)
                own[n] = terms
                for k in range(n + 1):
                    value = wp.static(r.dots[i])(p.jac, response[k])
                    a[n, k] = value
                    a[k, n] = value
                if wp.static(not r.tangent[i]):
                    if not (a[n, n] > SMALLEST) and b[n] < -SHARE * terms:
                        out.shut = 1
                        if lever > SHARE:
                            out.lost = 1
                a[n, n] = wp.max(a[n, n], SMALLEST)
                if wp.static(r.tangent[i]):
                    tangent[n] = 1
                    out.mu[n] = world.params[wp.static(FRICTION + pair[i])]
                n += 1
        out.count = n
        out.row = row
        out.response = response
        out.b = b
        out.own = own
        out.a = a
        out.tangent = tangent
        sizes, near = VR(), VR()
        most = wp.max(size, SMALLEST)
        for i in range(n):
            # what opens a violated row may move others much faster than it (a guide along the surface)
            value = wp.max(own[i], wp.max(closing, SMALLEST))
            for k in range(n):
                if tangent[k] == 0 and b[k] < ZERO:
                    value = wp.max(value, -b[k] * wp.abs(a[i, k]) / a[k, k])
            near[i] = value
            sizes[i] = wp.max(value, most)
        out.size = sizes
        out.near = near
        return out

    @wp.func
    def reach(dense: Dense):
        """What the impulse of any row alone does to every row's velocity, handed on from row to row."""
        a = dense.a
        b = dense.b
        tangent = dense.tangent
        n = dense.count
        out = VR()
        for i in range(n):
            out[i] = wp.where(tangent[i] == 0, wp.max(-b[i], ZERO), wp.abs(b[i]))
        rounds = int(0)
        while rounds < n:
            rounds += 1
            before = out
            changed = int(0)
            for i in range(n):
                largest = before[i]
                for k in range(n):
                    largest = wp.max(largest, wp.abs(a[i, k]) * before[k] / a[k, k])
                if largest > before[i]:
                    changed = 1
                out[i] = largest
            if changed == 0:
                rounds = n
        return out

    @wp.func
    def is_earned(dense: Dense, lam: VR):
        """1 if every row is open, and rubs as it must, on its contact's own scale, and rounding of the
        impulses leaves it digits; DOUBTFUL if it leaves few.
        """
        most = reach(dense)
        a = dense.a
        b = dense.b
        own = dense.own
        tangent = dense.tangent
        largest = dtype(0.0)
        for i in range(dense.count):
            largest = wp.max(largest, own[i])
        good = int(1)
        for i in range(dense.count):
            w = b[i]
            total = ZERO
            for k in range(dense.count):
                w += a[i, k] * lam[k]
                total += wp.abs(a[i, k] * lam[k])
            allowed = MISS * (own[i] + wp.min(most[i], largest))
            if tangent[i] == 0 and not (w >= -allowed):
                good = 0
            if tangent[i] == 1:
                bound = a[i, i] * dense.mu[i] * wp.max(lam[i - 1], ZERO)
                error = a[i, i] * lam[i] - wp.clamp(a[i, i] * lam[i] - w, -bound, bound)
                if not (wp.abs(error) <= allowed + MISS * own[i - 1]):
                    good = 0
            if not (total <= MOST * (own[i] + most[i])):
                good = 0
            elif total > LITTLE * (own[i] + most[i]):
                good = wp.where(good == 1, wp.static(DOUBTFUL), good)
        return good

    @wp.func
    def modes(dense: Dense, z: VR, edge: dtype):
        """The mode of every row; a tie presses not, and sticks. Contacts slide from mu `edge` on; friction
        that is none holds nothing.
        """
        out = MODES()
        a = dense.a
        mu = dense.mu
        tangent = dense.tangent
        for i in range(dense.count):
            if tangent[i] == 0:
                if z[i] > ZERO:
                    out[i] = wp.static(PRESS)
            elif out[i - 1] == wp.static(PRESS):
                bound = edge * a[i, i] * mu[i] * z[i - 1] / a[i - 1, i - 1]
                out[i] = wp.where(mu[i] > ZERO, wp.static(STICK), wp.static(OFF))
                if z[i] > bound:
                    out[i] = wp.static(RIGHT)
                if z[i] < -bound:
                    out[i] = wp.static(LEFT)
        return out

    @wp.func
    def ratio(dense: Dense, mode: MODES, i: int):
        """lambda_t/lambda_n of the normal row i while its contact slides, else 0."""
        out = ZERO
        tangent = dense.tangent
        if i + 1 < dense.count:
            if tangent[i + 1] == 1:
                if mode[i + 1] == wp.static(RIGHT):
                    out = dense.mu[i + 1]
                if mode[i + 1] == wp.static(LEFT):
                    out = -dense.mu[i + 1]
        return out

    @wp.func
    def factor(dense: Dense, mode: MODES, tau: dtype):
        """LU factors with partial pivoting of the rows that hold, A + tau diag(A)."""
        out = Lu()
        a = dense.a
        tangent = dense.tangent
        m = AR()
        unknown = MODES()
        order = MODES()
        n = int(0)
        for i in range(dense.count):
            if mode[i] == wp.static(PRESS) or mode[i] == wp.static(STICK):
                unknown[n] = i
                n += 1
        out.size = n
        out.unknown = unknown
        for c in range(n):
            j = unknown[c]
            slide = ratio(dense, mode, j)
            if tangent[j] == 1:
                slide = ZERO
            for k in range(n):
                i = unknown[k]
                # in units of sqrt(A_ii): pivots of heavy and of light bodies compare
                value = a[i, j]
                if slide != ZERO:
                    value += slide * a[i, j + 1]
                if i == j:
                    value += tau * a[i, i]
                m[k, c] = value / wp.sqrt(a[i, i] * a[j, j])
            order[c] = c
        for c in range(n):
            best = int(c)
            for k in range(c + 1, n):
                if wp.abs(m[k, c]) > wp.abs(m[best, c]):
                    best = k
            if best != c:
                held = order[c]
                order[c] = order[best]
                order[best] = held
                for j in range(n):
                    value = m[c, j]
                    m[c, j] = m[best, j]
                    m[best, j] = value
            pivot = m[c, c]
            if wp.abs(pivot) > SMALLEST:
                for k in range(c + 1, n):
                    share = m[k, c] / pivot
                    m[k, c] = share
                    for j in range(c + 1, n):
                        m[k, j] = m[k, j] - share * m[c, j]
        out.m = m
        out.order = order
        return out

    @wp.func
    def impulses(dense: Dense, mode: MODES, lu: Lu, target: VR, centre: VR, tau: dtype):
        """lambda with (A + tau diag(A)) lambda = tau diag(A) centre - target in the rows that hold."""
        a = dense.a
        tangent = dense.tangent
        m = lu.m
        unknown = lu.unknown
        order = lu.order
        x = VR()
        for c in range(lu.size):
            i = unknown[order[c]]
            value = (tau * a[i, i] * centre[i] - target[i]) / wp.sqrt(a[i, i])
            for k in range(c):
                value -= m[c, k] * x[k]
            x[c] = value
        for back in range(lu.size):
            c = lu.size - 1 - back
            value = x[c]
            for k in range(c + 1, lu.size):
                value -= m[c, k] * x[k]
            pivot = m[c, c]
            x[c] = wp.where(wp.abs(pivot) > SMALLEST, value / pivot, ZERO)
        out = VR()
        for c in range(lu.size):
            j = unknown[c]
            value = x[c] / wp.sqrt(a[j, j])
            out[j] = value
            if tangent[j] == 0:
                slide = ratio(dense, mode, j)
                if slide != ZERO:
                    out[j + 1] = slide * value
        return out

    @wp.func
    def transposed(dense: Dense, mode: MODES, lu: Lu, target: VR):
        """rho in the rows that hold, of the transposed system: with S the impulses lambda = S lambda_hold
        of all rows, (J_hold M^-1 J' S)' rho = S' target.
        """
        a = dense.a
        tangent = dense.tangent
        m = lu.m
        unknown = lu.unknown
        order = lu.order
        x = VR()
        for c in range(lu.size):
            j = unknown[c]
            value = target[j]
            if tangent[j] == 0:
                slide = ratio(dense, mode, j)
                if slide != ZERO:
                    value += slide * target[j + 1]
            value = value / wp.sqrt(a[j, j])
            for k in range(c):
                value -= m[k, c] * x[k]
            pivot = m[c, c]
            x[c] = wp.where(wp.abs(pivot) > SMALLEST, value / pivot, ZERO)
        out = VR()
        for back in range(lu.size):
            c = lu.size - 1 - back
            value = x[c]
            for k in range(c + 1, lu.size):
                value -= m[k, c] * x[k]
            x[c] = value
            i = unknown[order[c]]
            out[i] = value / wp.sqrt(a[i, i])
        return out

    return SimpleNamespace(
        types=t,
        rows=r,
        Dense=Dense,
        is_earned=is_earned,
        Lu=Lu,
        MODES=MODES,
        touch=touch,
        gather=gather,
        modes=modes,
        factor=factor,
        impulses=impulses,
        transposed=transposed,
    )
