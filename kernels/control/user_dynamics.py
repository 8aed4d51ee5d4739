"""Dynamics given as a Warp function x' = step(params, row, x, u): protocol functions and derivatives.

Derivatives that the user does not supply are taken in double precision of the float64 version of the step: by
Warp's adjoint where that is right, and second derivatives by differences of it (`adjoints.py`); else both by
central differences of fourth order (`differences.py`).
"""

from typing import Any, NamedTuple

import warp as wp

from ..device.adjoints import GRADIENT_STEP, after_adjoints, make_jacobian
from ..device.compile import MOST_UNROLLED, named_by_code
from ..device.differences import FIRST_STEP, SECOND_STEP, reach
from ..factories import cached
from .status import NOT_FINITE


class DynamicsFunctions(NamedTuple):
    """Warp functions of a dynamics for one dtype; the last two may be None.

    step(params, row, x, u) -> x'
    jacobians(params, row, x, u) -> (f_x (nx, nx), f_u (nx, nu))
    curvature(params, row, x, u, i) -> second derivatives of x'[i] with respect to z = (x, u), (nz, nz)
    """

    step: Any
    jacobians: Any = None
    curvature: Any = None


@wp.struct
class NoCarry:
    """Nothing to hand from step to step."""

    unused: wp.int32


@wp.func
def no_carry() -> NoCarry:
    """The empty carry."""
    return NoCarry()


@cached
def make_protocol_step(step, nx, nu, dtype):
    """The step in the solver's form: ``(params, row, x, u, carry) -> (x', carry, status)``."""
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)

    @wp.func
    def protocol_step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, carry: NoCarry):
        return step(params, row, x, u), carry, int(0)

    return protocol_step


@cached
def make_component(step, nx, nu):
    """``(params, row, z, i) -> x'[i]`` of z = (x, u), float64."""
    VX, VU, VZ = (wp.types.vector(n, wp.float64) for n in (nx, nu, nx + nu))

    @wp.func
    def component(params: wp.array2d(dtype=wp.float64), row: int, z: VZ, i: int):
        x, u = VX(), VU()
        for j in range(nx):
            x[j] = z[j]
        for j in range(nu):
            u[j] = z[nx + j]
        return step(params, row, x, u)[i]

    return component


@cached
def make_adjoint_derivatives(step, nx, nu, dtype):
    """Jacobians by Warp's adjoint and second derivatives by central differences of them; signatures as of
    `make_difference_derivatives`.
    """
    inner = wp.float64
    nz = nx + nu
    VZ, MXX, MXU = (
        wp.types.vector(nz, inner),
        wp.types.matrix((nx, nx), inner),
        wp.types.matrix((nx, nu), inner),
    )
    QUARTER, H = inner(0.25), inner(GRADIENT_STEP)
    jacobian = make_jacobian(make_component(step, nx, nu), nz, nx)

    @after_adjoints
    @wp.func
    def jacobians(params: wp.array2d(dtype=inner), row: int, z: VZ):
        found = jacobian(params, row, z)
        fx, fu = MXX(), MXU()
        for i in range(int(nx)):
            for j in range(int(nx)):
                fx[i, j] = found[i, j]
            for j in range(int(nu)):
                fu[i, j] = found[i, nx + j]
        return fx, fu

    @after_adjoints
    @wp.func
    def curvature(
        params: wp.array2d(dtype=inner), row: int, z: VZ, second: wp.array4d(dtype=dtype), cell: int
    ):
        for i in range(int(nx)):
            for r in range(int(nz)):
                for c in range(int(nz)):
                    second[cell, i, r, c] = dtype(0.0)
        for r in range(int(nz)):
            h = H * reach(z[r])
            d = VZ()
            d[r] = h
            along = (jacobian(params, row, z + d) - jacobian(params, row, z - d)) * (QUARTER / h)
            for i in range(int(nx)):
                for c in range(int(nz)):
                    second[cell, i, r, c] += dtype(along[i, c])
                    second[cell, i, c, r] += dtype(along[i, c])

    return jacobians, curvature


@cached
def make_difference_derivatives(step, nx, nu, dtype):
    """Differences of the step: ``jacobians(params, row, z) -> (f_x, f_u)`` and
    ``curvature(params, row, z, second, cell)``, which writes in the dtype of ``second``.
    """
    inner = wp.float64
    nz = nx + nu
    VX, VU, VZ = wp.types.vector(nx, inner), wp.types.vector(nu, inner), wp.types.vector(nz, inner)
    MXX, MXU = wp.types.matrix((nx, nx), inner), wp.types.matrix((nx, nu), inner)
    TWO, EIGHT, TWELVE = inner(2.0), inner(8.0), inner(12.0)
    SIXTEEN, THIRTY, QUARTER = inner(16.0), inner(30.0), inner(0.25)
    H1, H2 = inner(FIRST_STEP), inner(SECOND_STEP)

    @wp.func
    def step_at(params: wp.array2d(dtype=inner), row: int, z: VZ):
        x, u = VX(), VU()
        for i in range(nx):
            x[i] = z[i]
        for i in range(nu):
            u[i] = z[nx + i]
        return step(params, row, x, u)

    @wp.func
    def bend(params: wp.array2d(dtype=inner), row: int, z: VZ, d: VZ, middle: VX):
        near = step_at(params, row, z + d) + step_at(params, row, z - d)
        far = step_at(params, row, z + TWO * d) + step_at(params, row, z - TWO * d)
        return (SIXTEEN * near - far - THIRTY * middle) / TWELVE

    @wp.func
    def difference_jacobians(params: wp.array2d(dtype=inner), row: int, z: VZ):
        fx, fu = MXX(), MXU()
        for j in range(nz):
            h = H1 * reach(z[j])
            d = VZ()
            d[j] = h
            near = step_at(params, row, z + d) - step_at(params, row, z - d)
            far = step_at(params, row, z + TWO * d) - step_at(params, row, z - TWO * d)
            column = (EIGHT * near - far) / (TWELVE * h)
            for i in range(nx):
                if j < nx:
                    fx[i, j] = column[i]
                else:
                    fu[i, j - nx] = column[i]
        return fx, fu

    @wp.func
    def difference_curvature(
        params: wp.array2d(dtype=inner), row: int, z: VZ, second: wp.array4d(dtype=dtype), cell: int
    ):
        middle = step_at(params, row, z)
        for r in range(nz):
            hr = H2 * reach(z[r])
            for c in range(r + 1):
                hc = H2 * reach(z[c])
                d = VZ()
                d[r] = hr
                if c == r:
                    value = bend(params, row, z, d, middle) / (hr * hr)
                else:
                    d[c] = hc
                    value = bend(params, row, z, d, middle)
                    d[c] = -hc
                    value = QUARTER * (value - bend(params, row, z, d, middle)) / (hr * hc)
                for i in range(nx):
                    second[cell, i, r, c] = dtype(value[i])
                    second[cell, i, c, r] = dtype(value[i])

    return difference_jacobians, difference_curvature


@cached
def make_linearize_kernel(functions, nx, nu, second_order, dtype, exact=False):
    """Kernel ``(first, xs, us, params, mask, fx, fu, second, status)`` over B N.

    ``functions`` and ``params`` are of float64 if a derivative is not the user's, else of dtype. ``exact``:
    whether Warp's adjoint of the step is right.
    """
    curved_by_hand = functions.curvature is not None
    found = functions.jacobians is None or (second_order and not curved_by_hand)
    inner = wp.float64 if found else dtype
    nz = nx + nu
    VX, VU, VZ = wp.types.vector(nx, inner), wp.types.vector(nu, inner), wp.types.vector(nz, inner)
    step, jacobians, curvature = functions
    if found:
        make = make_adjoint_derivatives if exact else make_difference_derivatives
        found_jacobians, found_curvature = make(step, nx, nu, dtype)

    @named_by_code(max_unroll=MOST_UNROLLED if exact else 1)
    def linearize(
        first: int,
        xs: wp.array3d(dtype=dtype),
        us: wp.array3d(dtype=dtype),
        params: wp.array2d(dtype=inner),
        mask: wp.array(dtype=wp.int32),
        out_fx: wp.array4d(dtype=dtype),
        out_fu: wp.array4d(dtype=dtype),
        second: wp.array4d(dtype=dtype),
        status: wp.array2d(dtype=wp.int32),
    ):
        cell = first + wp.tid()
        horizon = us.shape[1]
        b = cell / horizon
        k = cell - b * horizon
        if mask[b] == 0:
            return
        row = wp.where(params.shape[0] == 1, 0, b)
        x, u, z = VX(), VU(), VZ()
        for i in range(nx):
            x[i] = inner(xs[b, k, i])
            z[i] = x[i]
        for i in range(nu):
            u[i] = inner(us[b, k, i])
            z[nx + i] = u[i]
        if wp.static(jacobians is None):
            fx, fu = found_jacobians(params, row, z)
        else:
            fx, fu = jacobians(params, row, x, u)
        code = int(0)
        if not (wp.isfinite(fx) and wp.isfinite(fu)):
            code = NOT_FINITE
        status[b, k] = code
        for i in range(int(nx)):
            for j in range(int(nx)):
                out_fx[b, k, i, j] = dtype(fx[i, j])
            for j in range(int(nu)):
                out_fu[b, k, i, j] = dtype(fu[i, j])
        if wp.static(second_order and curved_by_hand):
            for i in range(nx):
                block = curvature(params, row, x, u, i)
                for r in range(nz):
                    for c in range(nz):
                        second[cell, i, r, c] = dtype(block[r, c])
        elif wp.static(second_order):
            found_curvature(params, row, z, second, cell)

    return linearize


def make_linear(dtype, VX, VU):
    """x' = A x + B u + c with exact derivatives; parameters A, B by rows, c."""
    nx, nu = VX._length_, VU._length_
    MXX, MXU = wp.types.matrix((nx, nx), dtype), wp.types.matrix((nx, nu), dtype)
    MZZ = wp.types.matrix((nx + nu, nx + nu), dtype)
    AT_B = nx * nx
    AT_C = AT_B + nx * nu

    @wp.func
    def jacobians(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        a, b = MXX(), MXU()
        for i in range(nx):
            for j in range(nx):
                a[i, j] = params[row, i * nx + j]
            for j in range(nu):
                b[i, j] = params[row, AT_B + i * nu + j]
        return a, b

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        a, b = jacobians(params, row, x, u)
        offset = VX()
        for i in range(nx):
            offset[i] = params[row, AT_C + i]
        return a * x + b * u + offset

    @wp.func
    def curvature(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, i: int):
        return MZZ()

    return DynamicsFunctions(step, jacobians, curvature)
