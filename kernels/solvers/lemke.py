"""Lemke's method for hard contact with Coulomb's friction, as the last resort of `coulomb.py`.

The linear complementarity problem of the paper's [8] in the plane, for a contact with normal impulse c,
friction b+ - b- and slip speed g: w_n = J_n v' + d/h _|_ c, +-J_t v' + g _|_ b+-, mu c - b+ - b- _|_ g. Its
matrix is copositive, so that the method ends with a solution or on a ray. Without friction a ray y >= 0
should prove that no velocity opens the rows (Farkas): J' y = 0 and y . d/h < 0. That is checked against J
and d/h: of a gram beside a tonne A has no digits left. Always in float64, A = J M^-1 J' and J v_free + d/h
too, so that rows that depend on each other do so to 1e-16 and the rounding of float32 gives them no
solutions of their own; scaled to A_ii = 1. Ties between redundant contacts are broken by a perturbation of
the right-hand side, far below the tolerance of the modes that are wanted from here.
"""

from typing import Any

import warp as wp

from ..contact.problem import SMALLEST, make_problem
from ..contact.rows import make_rows
from ..factories import cached
from ..specialisation import Specialisation

FOUND, RAY, LIMIT = 0, 1, 2
NONE = -1
PERTURBATION = 1e-10
SMALLEST_PIVOT = 1e-11
PER_CONTACT = 4  # c, b+, b-, g
STEPS_PER_UNKNOWN = 12
SPEED = {wp.float64: 1e6, wp.float32: 1e5}  # that opens nothing, relative to the problem's


@cached
def make_lemke(spec: Specialisation, dense_type: Any) -> wp.Function:
    """lemke(problem, dense, friction, ease) -> (lambda of the rows, FOUND, RAY or LIMIT).

    friction = 0 leaves friction out; a RAY is then a proof. `ease` is added to d/h.
    """
    s, dtype, _ = spec
    r = make_rows(spec)
    Problem, VQ = make_problem(s, dtype), r.types.VQ
    NR, NV = s.nr, s.nv
    frictional = sum(1 for p in s.pairs if p.friction)
    N = NR - 2 * frictional + PER_CONTACT * frictional
    D = wp.float64
    VR = wp.types.vector(NR, dtype)
    TABLE = wp.types.matrix((N, N + 2), D)  # columns: nonbasic variables, right-hand side
    INDEX = wp.types.vector(N, wp.int32)
    COLUMNS = wp.types.vector(N + 1, wp.int32)
    ZERO, ONE = D(0.0), D(1.0)
    AR, BR = wp.types.matrix((NR, NR), D), wp.types.vector(NR, D)
    JR, PULL = wp.types.matrix((NR, NV), D), wp.types.vector(NV, D)
    GOLDEN = D(0.6180339887498949)
    PERTURB, LEAST, FLOOR = D(PERTURBATION), D(SMALLEST_PIVOT), D(SMALLEST)
    FASTEST = D(SPEED[dtype])
    NORMAL, PLUS, SLIP = 0, 1, 3  # 2: b-

    @wp.struct
    class Lifted:
        size: int
        kind: INDEX
        row: INDEX  # of the dense problem
        sign: wp.types.vector(N, D)
        a: AR  # of the dense problem, scaled to a diagonal of 1
        b: BR
        root: BR  # sqrt(A_ii)

    @wp.func
    def measure(p: Problem, dense: dense_type, l: Lifted, ease: dtype):
        out = l
        jac = JR()  # J, then J M^-1, of the rows in the system
        response = JR()
        for i in range(wp.static(NR)):
            row_i = wp.static(r.adds[i])(VQ(), p.jac, dtype(1.0))
            for n in range(dense.count):
                if dense.row[n] == i:
                    out.b[n] = D(p.rate[i]) + D(wp.where(dense.tangent[n] == 0, ease, dtype(0.0)))
                    for j in range(wp.static(NV)):
                        jac[n, j] = D(row_i[j])
                        out.b[n] = out.b[n] + D(row_i[j]) * D(p.vfree[j])
        for n in range(dense.count):
            for j in range(wp.static(NV)):
                for k in range(wp.static(NV)):
                    response[n, j] = response[n, j] + jac[n, k] * D(p.minv[k, j])
            for m in range(n + 1):
                value = ZERO
                for j in range(wp.static(NV)):
                    value += response[n, j] * jac[m, j]
                out.a[n, m] = value
                out.a[m, n] = value
        for n in range(dense.count):
            out.root[n] = wp.sqrt(wp.max(out.a[n, n], FLOOR))
            out.b[n] = out.b[n] / out.root[n]
        for n in range(dense.count):
            for m in range(dense.count):
                out.a[n, m] = out.a[n, m] / (out.root[n] * out.root[m])
        return out

    @wp.func
    def lift(p: Problem, dense: dense_type, friction: int, ease: dtype):
        out = measure(p, dense, Lifted(), ease)
        n = int(0)
        for i in range(dense.count):
            if dense.tangent[i] == 0:
                out.kind[n] = wp.static(NORMAL)
                out.row[n] = i
                out.sign[n] = ONE
                n += 1
            elif friction == 1:
                for k in range(3):
                    out.kind[n + k] = wp.static(PLUS) + k
                    out.row[n + k] = i
                    out.sign[n + k] = ONE
                out.sign[n + 1] = ZERO - ONE
                n += 3
        out.size = n
        return out

    @wp.func
    def entry(dense: dense_type, l: Lifted, i: int, j: int):
        # M_ij of w = M x + q
        a = l.row[i]
        b = l.row[j]
        if l.kind[i] != wp.static(SLIP) and l.kind[j] != wp.static(SLIP):
            return l.sign[i] * l.sign[j] * l.a[a, b]
        if l.kind[i] != wp.static(SLIP):  # + g in the rows of b+ and b-
            return wp.where(a == b and l.kind[i] != wp.static(NORMAL), ONE, ZERO)
        if l.kind[j] == wp.static(NORMAL) and b == a - 1:
            return D(dense.mu[a]) * l.root[a] / l.root[b]
        return wp.where(a == b and l.kind[j] != wp.static(SLIP), ZERO - ONE, ZERO)

    @wp.func
    def proves_shut(p: Problem, dense: dense_type, y: BR):
        """Whether no velocity up to SPEED times the problem's opens the rows, by weights y >= 0 of them."""
        pull = PULL()
        work = ZERO
        size = ZERO
        for i in range(wp.static(NR)):
            row_i = wp.static(r.adds[i])(VQ(), p.jac, dtype(1.0))
            for n in range(dense.count):
                if dense.row[n] == i and dense.tangent[n] == 0:
                    terms = wp.abs(D(p.rate[i]))
                    work -= y[n] * D(p.rate[i])
                    for j in range(wp.static(NV)):
                        pull[j] = pull[j] + y[n] * D(row_i[j])
                        terms += wp.abs(D(row_i[j]) * D(p.vfree[j]))
                    size = wp.max(size, terms)
        moves = ZERO
        for j in range(wp.static(NV)):
            moves += wp.abs(pull[j])
        return work > FASTEST * size * moves

    @wp.func
    def dictionary(dense: dense_type, l: Lifted, largest: D):
        """basic = right-hand side + sum of columns, for variables x_i: i, w_i: n + i, z0: 2 n; which row
        leaves first.
        """
        n = l.size
        table = TABLE()
        basic = INDEX()
        nonbasic = COLUMNS()
        jitter = D(0.5)
        leaving = int(0)
        for i in range(n):
            for j in range(n):
                table[i, j] = entry(dense, l, i, j)
            table[i, n] = ONE
            jitter = jitter + GOLDEN
            jitter = jitter - wp.floor(jitter)
            q = PERTURB * (ONE + jitter)
            if l.kind[i] != wp.static(SLIP):
                q += l.sign[i] * l.b[l.row[i]] / largest
            table[i, n + 1] = q
            basic[i] = n + i
            nonbasic[i] = i
            if q < table[leaving, n + 1]:
                leaving = i
        nonbasic[n] = 2 * n
        return table, basic, nonbasic, leaving

    @wp.func
    def impulses(l: Lifted, table: TABLE, basic: INDEX, largest: D):
        """lambda of the dense problem's rows."""
        n = l.size
        lam = VR()
        for i in range(n):
            k = basic[i]
            if k < n:
                if l.kind[k] != wp.static(SLIP):
                    a = l.row[k]
                    value = l.sign[k] * table[i, n + 1] * largest / l.root[a]
                    lam[a] = lam[a] + dtype(value)
        return lam

    @wp.func
    def ray(l: Lifted, table: TABLE, basic: INDEX, variable: int, entering: int):
        """Weights of the dense problem's rows, by which the impulses grow along a ray without friction."""
        y = BR()
        if variable < l.size:
            y[l.row[variable]] = ONE / l.root[l.row[variable]]
        for i in range(l.size):
            if basic[i] < l.size:
                a = l.row[basic[i]]
                y[a] = wp.max(table[i, entering], ZERO) / l.root[a]
        return y

    @wp.func(inline=False)  # a last resort: in line it would cost the steps that do without
    def lemke(p: Problem, dense: dense_type, friction: int, ease: dtype):
        l = lift(p, dense, friction, ease)
        n = l.size
        largest = D(1e-300)
        for i in range(n):
            if l.kind[i] != wp.static(SLIP):
                largest = wp.max(largest, wp.abs(l.b[l.row[i]]))
        table, basic, nonbasic, leaving = dictionary(dense, l, largest)
        status = int(wp.static(LIMIT))
        if table[leaving, n + 1] >= ZERO:
            status = wp.static(FOUND)
        entering = int(n)  # column
        steps = int(0)
        while status == wp.static(LIMIT) and steps < wp.static(STEPS_PER_UNKNOWN) * (n + 1):
            steps += 1
            # exchange: basic[leaving] against nonbasic[entering]
            pivot = table[leaving, entering]
            for j in range(n + 2):
                if j != entering:
                    table[leaving, j] = -table[leaving, j] / pivot
            table[leaving, entering] = ONE / pivot
            for i in range(n):
                if i != leaving:
                    share = table[i, entering]
                    if share != ZERO:
                        for j in range(n + 2):
                            if j != entering:
                                table[i, j] = table[i, j] + share * table[leaving, j]
                        table[i, entering] = share * table[leaving, entering]
            out = basic[leaving]
            basic[leaving] = nonbasic[entering]
            nonbasic[entering] = out
            if out == 2 * n:
                status = wp.static(FOUND)
            else:
                partner = wp.where(out < n, out + n, out - n)
                for j in range(n + 1):
                    if nonbasic[j] == partner:
                        entering = j
                leaving = int(wp.static(NONE))
                least = D(1e300)
                for i in range(n):
                    slope = table[i, entering]
                    if slope < -LEAST:
                        limit = wp.max(table[i, n + 1], ZERO) / (-slope)
                        better = limit < least
                        if basic[i] == 2 * n and limit <= least * (ONE + PERTURB):
                            better = True  # z0 leaves where it can
                        if better:
                            least = limit
                            leaving = i
                if leaving == wp.static(NONE):
                    status = wp.static(RAY)
        if status == wp.static(RAY) and friction == 0:
            y = ray(l, table, basic, nonbasic[entering], entering)
            if not proves_shut(p, dense, y):
                status = wp.static(LIMIT)
        return impulses(l, table, basic, largest), status

    return lemke
