"""LU factors of matrices of 3 x 3 blocks in an envelope of symmetric shape, without pivoting, one world a
thread.

Of a matrix K block (i, j), first[i] <= j <= i, is m[at[i] + j], and the transpose of block (j, i) is u[at[i]
+ j] (nothing there for j = i). The factors K = L U stand in the same places, the transpose of U in u, with
the inverses of their diagonal blocks: of a symmetric matrix both are the Cholesky factor of `envelope.py`,
and with m and u exchanged K' is solved.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..work import M33, V3, WORK
from .blocks import pays, reduced


@cached
def make_lu() -> SimpleNamespace:
    """factor(m, u, first, at, start, end) and solve(m, u, first, at, block, x, start, end)."""
    dtype = WORK
    ZERO, ONE = dtype(0.0), dtype(1.0)
    LEAST, ROUNDING, SMALLEST = dtype(1e-17), dtype(2e-16), dtype(1e-300)

    @wp.func
    def pivot(value: dtype, given: dtype):
        """A pivot, or one of rounding's size where it is lost to rounding."""
        size = wp.max(wp.abs(given), SMALLEST)
        if not (wp.abs(value) > LEAST * size):
            return ROUNDING * size
        return value

    @wp.func
    def inverse(a: dtype, b: dtype, c: dtype, l10: dtype, l20: dtype, l21: dtype):
        """The inverse of a triangle whose diagonal's inverses are a, b, c."""
        low = -l10 * a * b
        return M33(a, ZERO, ZERO, low, b, ZERO, -(l20 * a + l21 * low) * c, -l21 * b * c, c)

    @wp.func
    def inverse_factors(d: M33, x: dtype, y: dtype, z: dtype):
        """L^-1 and the transpose of U^-1 of d = L U; x, y, z: what its diagonal is a difference of."""
        p = pivot(d[0, 0], x)
        a = ONE / wp.sqrt(wp.abs(p))
        s = wp.sign(p)
        l10 = d[1, 0] * a * s
        l20 = d[2, 0] * a * s
        u01 = d[0, 1] * a
        u02 = d[0, 2] * a
        q = pivot(d[1, 1] - l10 * u01, y)
        b = ONE / wp.sqrt(wp.abs(q))
        r = wp.sign(q)
        l21 = (d[2, 1] - l20 * u01) * b * r
        u12 = (d[1, 2] - l10 * u02) * b
        o = pivot(d[2, 2] - l20 * u02 - l21 * u12, z)
        c = ONE / wp.sqrt(wp.abs(o))
        return inverse(a, b, c, l10, l20, l21), inverse(a * s, b * r, c * wp.sign(o), u01, u02, u12)

    @wp.func
    def factor(
        m: wp.array(dtype=M33),
        u: wp.array(dtype=M33),
        first: wp.array(dtype=int),
        at: wp.array(dtype=int),
        start: int,
        end: int,
    ):
        """L and U' in place, between the borders of an independent part."""
        for i in range(start, end):
            row = at[i]
            begin = first[i]
            d = m[row + i]
            x = d[0, 0] + ZERO
            y = d[1, 1] + ZERO
            z = d[2, 2] + ZERO
            for j in range(begin, i):
                other = at[j]
                lower = m[row + j]
                upper = u[row + j]
                k = wp.max(begin, first[j])
                if pays(j - k):
                    lower = reduced(lower, m, row + k, u, other + k, j - k)
                    upper = reduced(upper, u, row + k, m, other + k, j - k)
                    k = j
                while k < j:
                    lower -= m[row + k] * wp.transpose(u[other + k])
                    upper -= u[row + k] * wp.transpose(m[other + k])
                    k += 1
                lower = lower * wp.transpose(u[other + j])
                upper = upper * wp.transpose(m[other + j])
                m[row + j] = lower
                u[row + j] = upper
                d -= lower * wp.transpose(upper)
            left, right = inverse_factors(d, x, y, z)
            m[row + i] = left
            u[row + i] = right

    @wp.func
    def solve(
        m: wp.array(dtype=M33),
        u: wp.array(dtype=M33),
        first: wp.array(dtype=int),
        at: wp.array(dtype=int),
        block: wp.array(dtype=int),
        x: wp.array(dtype=V3),
        start: int,
        end: int,
    ):
        """K^-1 x in place between the borders of an independent part; the i-th block is block[i] of x."""
        for i in range(start, end):
            row = at[i]
            value = x[block[i]]
            for k in range(first[i], i):
                value -= m[row + k] * x[block[k]]
            x[block[i]] = m[row + i] * value
        for r in range(end - start):
            i = end - 1 - r
            row = at[i]
            value = wp.transpose(u[row + i]) * x[block[i]]
            x[block[i]] = value
            for k in range(first[i], i):
                x[block[k]] = x[block[k]] - wp.transpose(u[row + k]) * value

    return SimpleNamespace(factor=factor, solve=solve)
