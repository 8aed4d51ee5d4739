"""Cholesky factors of matrices of 3 x 3 blocks stored by the rows of their lower envelope.

Block (i, j), first[i] <= j <= i, of a matrix is m[at[i] + j]; of a diagonal block both triangles are
stored. A factor L has the inverses of its diagonal blocks in their place. One world is one thread.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..work import M33, V3, WORK
from .blocks import pays, reduced


@cached
def make_envelope() -> SimpleNamespace:
    """factor(m, first, at, start, end), solve(m, first, at, block, x, start, end) and `forward`."""
    dtype = WORK
    ZERO, ONE = dtype(0.0), dtype(1.0)
    LEAST, ROUNDING, SMALLEST = dtype(1e-17), dtype(2e-16), dtype(1e-290)

    @wp.func
    def kept(value: dtype, size: dtype):
        """A pivot; one that is lost to rounding is replaced by one of rounding's size."""
        if not (value > LEAST * size):
            return ROUNDING * size
        return value

    @wp.func
    def inverse_root(d: M33, x: dtype, y: dtype, z: dtype):
        """L^-1 of d = L L'; x, y, z: the size of what its diagonal is a difference of. One pivot waits for
        another one's division only: the roots are taken beside that.
        """
        a = ONE / kept(d[0, 0], wp.max(x, SMALLEST))
        l10 = d[1, 0] * a
        l20 = d[2, 0] * a
        b = ONE / kept(d[1, 1] - l10 * d[1, 0], wp.max(y, SMALLEST))
        rest = d[2, 1] - l20 * d[1, 0]
        l21 = rest * b
        c = ONE / kept(d[2, 2] - l20 * d[2, 0] - l21 * rest, wp.max(z, SMALLEST))
        a = wp.sqrt(a)
        b = wp.sqrt(b)
        c = wp.sqrt(c)
        return M33(a, ZERO, ZERO, -l10 * b, b, ZERO, (l10 * l21 - l20) * c, -l21 * c, c)

    @wp.func(inline=False)
    def factor(
        m: wp.array(dtype=M33), first: wp.array(dtype=int), at: wp.array(dtype=int), start: int, end: int
    ):
        """L in place, between the borders of an independent part."""
        for i in range(start, end):
            row = at[i]
            begin = first[i]
            d = m[row + i]
            x = d[0, 0] + ZERO
            y = d[1, 1] + ZERO
            z = d[2, 2] + ZERO
            for j in range(begin, i):
                other = at[j]
                value = m[row + j]
                k = wp.max(begin, first[j])
                if pays(j - k):
                    value = reduced(value, m, row + k, m, other + k, j - k)
                    k = j
                while k < j:
                    value -= m[row + k] * wp.transpose(m[other + k])
                    k += 1
                value = value * wp.transpose(m[other + j])
                m[row + j] = value
                d -= value * wp.transpose(value)
            m[row + i] = inverse_root(d, x, y, z)

    @wp.func
    def forward(
        m: wp.array(dtype=M33),
        first: wp.array(dtype=int),
        at: wp.array(dtype=int),
        block: wp.array(dtype=int),
        x: wp.array(dtype=V3),
        start: int,
        end: int,
    ):
        """L^-1 x in place between the borders of an independent part; block i of L is block[i] of x. The last
        block's result is handed on in registers, which a chain of bodies waits for.
        """
        u, v, w = dtype(0.0), dtype(0.0), dtype(0.0)
        i = int(start)
        while i < end:
            row = at[i]
            value = x[block[i]]
            a = value[0] + ZERO
            b = value[1] + ZERO
            c = value[2] + ZERO
            k = first[i]
            if k < i:
                while k < i - 1:
                    less = m[row + k] * x[block[k]]
                    a -= less[0]
                    b -= less[1]
                    c -= less[2]
                    k += 1
                less = m[row + k] * V3(u, v, w)
                a -= less[0]
                b -= less[1]
                c -= less[2]
            done = m[row + i] * V3(a, b, c)
            x[block[i]] = done
            u = done[0] + ZERO
            v = done[1] + ZERO
            w = done[2] + ZERO
            i += 1

    @wp.func(inline=False)
    def solve(
        m: wp.array(dtype=M33),
        first: wp.array(dtype=int),
        at: wp.array(dtype=int),
        block: wp.array(dtype=int),
        x: wp.array(dtype=V3),
        start: int,
        end: int,
    ):
        """(L L')^-1 x in place."""
        forward(m, first, at, block, x, start, end)
        i = end - 1
        u, v, w = dtype(0.0), dtype(0.0), dtype(0.0)  # what later blocks take off block i - 1
        while i >= start:
            row = at[i]
            value = wp.transpose(m[row + i]) * (x[block[i]] - V3(u, v, w))
            x[block[i]] = value
            u = ZERO + ZERO
            v = ZERO + ZERO
            w = ZERO + ZERO
            k = first[i]
            if k < i:
                less = wp.transpose(m[row + i - 1]) * value
                u = less[0] + ZERO
                v = less[1] + ZERO
                w = less[2] + ZERO
                while k < i - 1:
                    x[block[k]] = x[block[k]] - wp.transpose(m[row + k]) * value
                    k += 1
            i -= 1

    return SimpleNamespace(factor=factor, forward=forward, solve=solve)
