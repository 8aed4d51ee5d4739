"""Central differences of fourth order in double precision, for functions that come without derivatives.

First derivatives: (f(-2h) - 8 f(-h) + 8 f(h) - f(2h)) / 12h. Second derivatives along a direction d:
D(d) = (-f(-2d) + 16 f(-d) - 30 f(0) + 16 f(d) - f(2d)) / 12, mixed ones
(D(d_i + d_j) - D(d_i - d_j)) / 4. Steps are powers of two, times |z_i|/100 where that is larger than 1: what
is far from 0, as an angle after many turns, may change as fast as what is near.
"""

import warp as wp

from ..factories import cached

FIRST_STEP = 2.0**-10
SECOND_STEP = 2.0**-8
FAR = 0.01


@wp.func
def reach(z: wp.float64):
    """What steps at z are times."""
    return wp.max(wp.float64(1.0), wp.float64(FAR) * wp.abs(z))


@cached
def make_gradient(value, nz, size):
    """``(numbers, row, z, index) -> d value / d z`` by the first ``size`` of nz numbers, float64."""
    VZ = wp.types.vector(nz, wp.float64)
    TWO, EIGHT, TWELVE = wp.float64(2.0), wp.float64(8.0), wp.float64(12.0)
    H = wp.float64(FIRST_STEP)

    @wp.func
    def gradient(numbers: wp.array2d(dtype=wp.float64), row: int, z: VZ, index: int):
        slope = VZ()
        for i in range(int(size)):  # not unrolled
            h = H * reach(z[i])
            d = VZ()
            d[i] = h
            near = value(numbers, row, z + d, index) - value(numbers, row, z - d, index)
            far = value(numbers, row, z + TWO * d, index) - value(numbers, row, z - TWO * d, index)
            slope[i] = (EIGHT * near - far) / (TWELVE * h)
        return slope

    return gradient


@cached
def make_scalar_differences(running, final, nx, nu):
    """Warp functions like `CostFunctions.running_derivatives` and `.final_derivatives`, float64."""
    dtype = wp.float64
    nz = nx + nu
    VX, VU, VZ = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype), wp.types.vector(nz, dtype)
    MXX, MZZ = wp.types.matrix((nx, nx), dtype), wp.types.matrix((nz, nz), dtype)
    MUX, MUU = wp.types.matrix((nu, nx), dtype), wp.types.matrix((nu, nu), dtype)
    TWO, TWELVE = dtype(2.0), dtype(12.0)
    SIXTEEN, THIRTY, QUARTER = dtype(16.0), dtype(30.0), dtype(0.25)
    H2 = dtype(SECOND_STEP)

    @wp.func
    def running_at(weights: wp.array2d(dtype=dtype), row: int, z: VZ, k: int):
        x, u = VX(), VU()
        for i in range(nx):
            x[i] = z[i]
        for i in range(nu):
            u[i] = z[nx + i]
        return running(weights, row, x, u, k)

    @wp.func
    def final_at(weights: wp.array2d(dtype=dtype), row: int, z: VZ, k: int):
        x = VX()
        for i in range(nx):
            x[i] = z[i]
        return final(weights, row, x)

    def make(value, size):
        """Gradient and Hessian of value with respect to the first ``size`` components of z."""
        gradient = make_gradient(value, nz, size)

        @wp.func
        def bend(weights: wp.array2d(dtype=dtype), row: int, z: VZ, k: int, d: VZ, middle: dtype):
            near = value(weights, row, z + d, k) + value(weights, row, z - d, k)
            far = value(weights, row, z + TWO * d, k) + value(weights, row, z - TWO * d, k)
            return (SIXTEEN * near - far - THIRTY * middle) / TWELVE

        @wp.func
        def derivatives(weights: wp.array2d(dtype=dtype), row: int, z: VZ, k: int):
            hessian = MZZ()
            middle = value(weights, row, z, k)
            for i in range(size):
                hi = H2 * reach(z[i])
                for j in range(i + 1):
                    hj = H2 * reach(z[j])
                    e = VZ()
                    e[i] = hi
                    if j == i:
                        hessian[i, i] = bend(weights, row, z, k, e, middle) / (hi * hi)
                    else:
                        e[j] = hj
                        value_ij = bend(weights, row, z, k, e, middle)
                        e[j] = -hj
                        value_ij -= bend(weights, row, z, k, e, middle)
                        hessian[i, j] = QUARTER * value_ij / (hi * hj)
                        hessian[j, i] = hessian[i, j]
            return gradient(weights, row, z, k), hessian

        return derivatives

    along_running, along_final = make(running_at, nz), make(final_at, nx)

    @wp.func
    def running_derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
        z = VZ()
        for i in range(nx):
            z[i] = x[i]
        for i in range(nu):
            z[nx + i] = u[i]
        slope, hessian = along_running(weights, row, z, k)
        lx, lu, lxx, lux, luu = VX(), VU(), MXX(), MUX(), MUU()
        for i in range(nx):
            lx[i] = slope[i]
            for j in range(nx):
                lxx[i, j] = hessian[i, j]
        for i in range(nu):
            lu[i] = slope[nx + i]
            for j in range(nx):
                lux[i, j] = hessian[nx + i, j]
            for j in range(nu):
                luu[i, j] = hessian[nx + i, nx + j]
        return lx, lu, lxx, lux, luu

    @wp.func
    def final_derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        z = VZ()
        for i in range(nx):
            z[i] = x[i]
        slope, hessian = along_final(weights, row, z, 0)
        lx, lxx = VX(), MXX()
        for i in range(nx):
            lx[i] = slope[i]
            for j in range(nx):
                lxx[i, j] = hessian[i, j]
        return lx, lxx

    return running_derivatives, final_derivatives
