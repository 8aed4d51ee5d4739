"""LANES right-hand sides at once with the factors of `envelope.py` and `lu.py`: what derivatives need.

After a solved step k.factor holds factors of M + J' W J (W = p/(T D), T = q + tau p diag(A)/D) of every
island, or what the caller put there; the proximal term tau in them is the caller's to refine against.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..topology import Topology
from ..work import M33, Lanes, Slot


@cached
def make_many() -> SimpleNamespace:
    """solve(m, u, first, at, block, x, start, end): (L U)^-1 x in place between the borders of an independent
    part, x being (3 blocks) of LANES: component c of block b at 3 b + c. m holds L and u the transpose of U;
    of a Cholesky factor both are the same. With m and u exchanged the transposed system is solved.
    take_momentum(t, k, x, out): out -= M x.
    """

    @wp.func
    def times(m: M33, row: int, x: wp.array(dtype=Lanes), b: int):
        """Component `row` of m x_b."""
        return m[row, 0] * x[3 * b] + m[row, 1] * x[3 * b + 1] + m[row, 2] * x[3 * b + 2]

    @wp.func
    def replace(m: M33, x: wp.array(dtype=Lanes), b: int):
        """x_b = m x_b"""
        one = times(m, 0, x, b)
        two = times(m, 1, x, b)
        x[3 * b + 2] = times(m, 2, x, b)
        x[3 * b] = one
        x[3 * b + 1] = two

    @wp.func
    def take(m: M33, x: wp.array(dtype=Lanes), source: int, b: int):
        """x_b -= m x_source"""
        for row in range(3):
            x[3 * b + row] = x[3 * b + row] - times(m, row, x, source)

    @wp.func
    def solve(
        m: wp.array(dtype=M33),
        u: wp.array(dtype=M33),
        first: wp.array(dtype=int),
        at: wp.array(dtype=int),
        block: wp.array(dtype=int),
        x: wp.array(dtype=Lanes),
        start: int,
        end: int,
    ):
        for i in range(start, end):
            row = at[i]
            for j in range(first[i], i):
                take(m[row + j], x, block[j], block[i])
            replace(m[row + i], x, block[i])
        for back in range(end - start):
            i = end - 1 - back
            row = at[i]
            replace(wp.transpose(u[row + i]), x, block[i])
            for j in range(first[i], i):
                take(wp.transpose(u[row + j]), x, block[i], block[j])

    @wp.func
    def take_momentum(
        t: wp.ref[Topology], k: wp.ref[Slot], x: wp.array(dtype=Lanes), out: wp.array(dtype=Lanes)
    ):
        """out -= M x"""
        for i in range(t.blocks):
            at = t.mass_at[i]
            for j in range(t.mass_first[i], i + 1):
                m = k.mass[at + j]
                for part in range(3):
                    out[3 * i + part] = out[3 * i + part] - times(m, part, x, j)
                    if j < i:
                        out[3 * j + part] = out[3 * j + part] - times(wp.transpose(m), part, x, i)

    return SimpleNamespace(solve=solve, take_momentum=take_momentum)
