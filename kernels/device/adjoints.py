"""Derivatives of users' functions by Warp's adjoint, in double precision: exact first, differences of them.

Second derivatives are central differences of exact gradients, (g(z + d) - g(z - d)) / 2h with h = 1e-5
max(1, |z_i|), made symmetric: of second order, and yet better than fourth-order differences of values, which
need steps of 4e-3. Where an adjoint is not finite, as that of sqrt(z) at 0, differences of values stand in.

Loops of a user's function must be unrolled, or their adjoint is wrong (`compile.MOST_UNROLLED`); loops here
that must not be have a bound that Warp takes for a variable. Whether an adjoint is right is for the caller
to find out with the kernel of `make_probe_kernel`: `slcp_warp.gradients.adjoint_check`.
"""

import warp as wp

from ..factories import cached
from .compile import MOST_UNROLLED, named_by_code
from .differences import make_gradient

GRADIENT_STEP = 2.0**-17
MOST_ROWS = 8  # outputs whose adjoints are unrolled, so that they share what they have in common


@wp.struct
class Given:
    """What a function is not differentiated by; `wp.grad` takes arrays in a struct only."""

    numbers: wp.array2d(dtype=wp.float64)
    row: wp.int32
    index: wp.int32


def after_adjoints(function):
    """Decorator: a `wp.func` that calls one with `wp.grad`, which Warp 1.19 writes after all others."""
    function.adj.uses_grad_call = True
    return function


@cached
def make_exact_gradient(value, nz):
    """``(numbers, row, z, index) -> d value / d z`` by Warp's adjoint alone."""
    VZ = wp.types.vector(nz, wp.float64)

    @wp.func
    def asked(given: Given, z: VZ):
        return value(given.numbers, given.row, z, given.index)

    @wp.func
    def exact(numbers: wp.array2d(dtype=wp.float64), row: int, z: VZ, index: int):
        given = Given()
        given.numbers = numbers
        given.row = row
        given.index = index
        _, slope = wp.grad(asked)(given, z)
        return slope

    return exact


@cached
def make_jacobian(component, nz, rows):
    """``(numbers, row, z) -> (rows, nz)``, row i the gradient of component(numbers, row, z, i)."""
    VZ, MRZ = wp.types.vector(nz, wp.float64), wp.types.matrix((rows, nz), wp.float64)
    exact, differences = make_exact_gradient(component, nz), make_gradient(component, nz, nz)

    @after_adjoints
    @wp.func
    def jacobian(numbers: wp.array2d(dtype=wp.float64), row: int, z: VZ):
        found = MRZ()
        if wp.static(rows <= MOST_ROWS):
            for i in range(rows):
                found[i] = exact(numbers, row, z, i)
        else:
            for i in range(int(rows)):
                found[i] = exact(numbers, row, z, i)
        if not wp.isfinite(found):
            for i in range(int(rows)):
                found[i] = differences(numbers, row, z, i)
        return found

    return jacobian


@cached
def make_probe_kernel(value, nz):
    """Kernel that lays the adjoint of ``value`` beside its values: ``(zs, along, index, moves, ...)``.

    slope[j] is that of value at zs[j] along along[j]; values[j, m] is value at zs[j] + moves[m] along[j].
    """
    VZ = wp.types.vector(nz, wp.float64)
    exact = make_exact_gradient(value, nz)

    @named_by_code(max_unroll=MOST_UNROLLED)
    def probe(
        numbers: wp.array2d(dtype=wp.float64),
        zs: wp.array2d(dtype=wp.float64),
        along: wp.array2d(dtype=wp.float64),
        index: wp.array(dtype=wp.int32),
        moves: wp.array(dtype=wp.float64),
        slope: wp.array(dtype=wp.float64),
        values: wp.array2d(dtype=wp.float64),
    ):
        j = wp.tid()
        z, d = VZ(), VZ()
        for i in range(int(nz)):
            z[i] = zs[j, i]
            d[i] = along[j, i]
        slope[j] = wp.dot(exact(numbers, 0, z, index[j]), d)
        for m in range(moves.shape[0]):
            values[j, m] = value(numbers, 0, z + moves[m] * d, index[j])

    return probe
