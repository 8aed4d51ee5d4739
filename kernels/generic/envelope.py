"""Cholesky factors of matrices stored by the rows of their lower envelope, one world per thread.

Entry (i, j), first[i] <= j <= i, of a matrix is m[at[i] + j, world]. A factor stores 1/L_ii on its diagonal.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached


@cached
def make_envelope(dtype: type) -> SimpleNamespace:
    """factor(m, first, at, n, world), solve(m, first, at, x, n, world) and forward(.., start, end, ..)."""
    ONE = dtype(1.0)
    LEAST = dtype(1e-17 if dtype is wp.float64 else 1e-9)
    ROUNDING = dtype(2e-16 if dtype is wp.float64 else 1e-7)
    SMALLEST = dtype(1e-300 if dtype is wp.float64 else 1e-37)

    @wp.func
    def factor(
        m: wp.array2d(dtype=dtype), first: wp.array(dtype=int), at: wp.array(dtype=int), n: int, world: int
    ):
        """L in place; a pivot lost to rounding is replaced by one of rounding's size."""
        for i in range(n):
            row = at[i]
            begin = first[i]
            pivot = m[row + i, world]
            size = wp.max(pivot, SMALLEST)
            for j in range(begin, i):
                other = at[j]
                value = m[row + j, world]
                for k in range(wp.max(begin, first[j]), j):
                    value -= m[row + k, world] * m[other + k, world]
                value = value * m[other + j, world]
                m[row + j, world] = value
                pivot -= value * value
            if not (pivot > LEAST * size):
                pivot = ROUNDING * size
            m[row + i, world] = ONE / wp.sqrt(pivot)

    @wp.func
    def forward(
        m: wp.array2d(dtype=dtype),
        first: wp.array(dtype=int),
        at: wp.array(dtype=int),
        x: wp.array2d(dtype=dtype),
        start: int,
        end: int,
        world: int,
    ):
        """L^-1 x in place between the borders of independent blocks."""
        for i in range(start, end):
            row = at[i]
            value = x[i, world]
            for k in range(first[i], i):
                value -= m[row + k, world] * x[k, world]
            x[i, world] = value * m[row + i, world]

    @wp.func
    def solve(
        m: wp.array2d(dtype=dtype),
        first: wp.array(dtype=int),
        at: wp.array(dtype=int),
        x: wp.array2d(dtype=dtype),
        n: int,
        world: int,
    ):
        """(L L')^-1 x in place."""
        forward(m, first, at, x, 0, n, world)
        for r in range(n):
            i = n - 1 - r
            row = at[i]
            value = x[i, world] * m[row + i, world]
            x[i, world] = value
            for k in range(first[i], i):
                x[k, world] = x[k, world] - m[row + k, world] * value

    return SimpleNamespace(factor=factor, forward=forward, solve=solve)
