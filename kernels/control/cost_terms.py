"""Costs as sums of terms, each of one state or control: the terms are data, so all such costs share a kernel.

Weights hold the number of running terms and then, for every running and then every final term, FIELDS
numbers: its kind, its component (a state 0 .. nx - 1, or nx + i for control i), its weight w, its target t,
its width d, and the state that is taken off its component, a state or a control (-1: none). With s the
component or the difference, and e = s - t, a term is

    LINEAR    w e                   SQUARE    w e^2
    COSINE    w (1 - cos e)         ABSOLUTE  w (sqrt(e^2 + d^2) - d)
    ABOVE     w max(e, 0)^2         BELOW     w min(e, 0)^2

Of costs some of whose running terms count for a time only each term has TIMED numbers: those, and the first
step at which it counts and the first at which it does so no more. Such costs have kernels of their own.
"""

import warp as wp

from ..factories import cached
from .costs import CostFunctions

KINDS = ("linear", "square", "cosine", "absolute", "above", "below")
LINEAR, SQUARE, COSINE, ABSOLUTE, ABOVE, BELOW = range(len(KINDS))
FIELDS = 6
TIMED = FIELDS + 2


@cached
def make_shape(dtype):
    """``(kind, e, d)``: a term of weight 1, its slope and its curvature."""
    V3 = wp.types.vector(3, dtype)
    ZERO, ONE, TWO = dtype(0.0), dtype(1.0), dtype(2.0)

    @wp.func
    def shape(kind: int, e: dtype, d: dtype):
        if kind == wp.static(SQUARE):
            return V3(e * e, TWO * e, TWO)
        if kind == wp.static(LINEAR):
            return V3(e, ONE, ZERO)
        if kind == wp.static(COSINE):
            return V3(ONE - wp.cos(e), wp.sin(e), wp.cos(e))
        if kind == wp.static(ABSOLUTE):
            root = wp.sqrt(e * e + d * d)
            return V3(root - d, e / root, d * d / (root * root * root))
        if kind == wp.static(ABOVE) and e < ZERO:
            return V3()
        if kind == wp.static(BELOW) and e > ZERO:
            return V3()
        return V3(e * e, TWO * e, TWO)

    return shape


def make_terms(dtype, VX, VU):
    """See the module's docstring; derivatives are exact."""
    return make_sum(dtype, VX, VU)


def make_timed_terms(dtype, VX, VU):
    """Terms of TIMED numbers each."""
    return make_sum(dtype, VX, VU, fields=TIMED)


def make_sum(dtype, VX, VU, points=None, fields=FIELDS):
    """The sum of terms of so many numbers, some of `points` (`cost_points.make_points`) if there are such."""
    nx, nu = VX._length_, VU._length_
    MXX, MUX, MUU = (wp.types.matrix(shape, dtype) for shape in ((nx, nx), (nu, nx), (nu, nu)))
    V3 = wp.types.vector(3, dtype)
    shape, pointed, timed = make_shape(dtype), points is not None, fields == TIMED

    @wp.func
    def place(weights: wp.array2d(dtype=dtype), row: int, i: int):
        return int(weights[row, 1 + fields * i + 1])

    @wp.func
    def less(weights: wp.array2d(dtype=dtype), row: int, i: int):
        return int(weights[row, 1 + fields * i + 5])

    @wp.func
    def difference(weights: wp.array2d(dtype=dtype), row: int, i: int, x: VX, j: int):
        """State j, less the one that term i takes off it."""
        k = less(weights, row, i)
        if k >= 0:
            return x[j] - x[k]
        return x[j]

    @wp.func
    def slope(lx: VX, j: int, k: int, t: V3):
        out = lx
        out[j] = out[j] + t[1]
        if k >= 0:
            out[k] = out[k] - t[1]
        return out

    @wp.func
    def curvature(lxx: MXX, j: int, k: int, t: V3):
        out = lxx
        out[j, j] = out[j, j] + t[2]
        if k >= 0:
            out[k, k] = out[k, k] + t[2]
            out[j, k] = out[j, k] - t[2]
            out[k, j] = out[k, j] - t[2]
        return out

    @wp.func
    def weighed(weights: wp.array2d(dtype=dtype), row: int, i: int, s: dtype):
        """Term i at the component's value s, its slope and its curvature."""
        at = 1 + fields * i
        e = s - weights[row, at + 3]
        return weights[row, at + 2] * shape(int(weights[row, at]), e, weights[row, at + 4])

    @wp.func
    def counts(weights: wp.array2d(dtype=dtype), row: int):
        """Number of running terms, and of all."""
        if wp.static(pointed):
            return int(weights[row, 0]), points.terms_of(weights, row)
        return int(weights[row, 0]), (weights.shape[1] - 1) / fields

    @wp.func
    def of_state(weights: wp.array2d(dtype=dtype), row: int, i: int, x: VX):
        """What term i is of, where that is no control."""
        j = place(weights, row, i)
        if wp.static(pointed):
            if j >= wp.static(nx + nu):
                return points.value(weights, row, j - wp.static(nx + nu), less(weights, row, i), x)
        return difference(weights, row, i, x, j)

    @wp.func
    def bent(weights: wp.array2d(dtype=dtype), row: int, i: int, x: VX, lx: VX, lxx: MXX):
        """lx and lxx with those of term i, which is of no control."""
        j, k = place(weights, row, i), less(weights, row, i)
        t = weighed(weights, row, i, of_state(weights, row, i, x))
        if wp.static(pointed):
            if j >= wp.static(nx + nu):
                return points.add_slopes(weights, row, j - wp.static(nx + nu), k, x, t, lx, lxx)
        return slope(lx, j, k, t), curvature(lxx, j, k, t)

    @wp.func
    def counts_at(weights: wp.array2d(dtype=dtype), row: int, i: int, step: int):
        """Whether running term i counts at a step."""
        if wp.static(timed):
            first = 1 + fields * i + wp.static(FIELDS)
            return dtype(step) >= weights[row, first] and dtype(step) < weights[row, first + 1]
        return True

    @wp.func
    def is_control(j: int):
        return j >= nx and j < wp.static(nx + nu)

    @wp.func
    def control_less(weights: wp.array2d(dtype=dtype), row: int, i: int, x: VX, value: dtype):
        """A control, less the state that term i takes off it."""
        k = less(weights, row, i)
        if k >= 0:
            return value - x[k]
        return value

    @wp.func
    def running(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
        many, _ = counts(weights, row)
        value = dtype(0.0)
        for i in range(many):
            if counts_at(weights, row, i, k):
                j = place(weights, row, i)
                if is_control(j):
                    value += weighed(weights, row, i, control_less(weights, row, i, x, u[j - nx]))[0]
                else:
                    value += weighed(weights, row, i, of_state(weights, row, i, x))[0]
        return value

    @wp.func
    def final(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        first, end = counts(weights, row)
        value = dtype(0.0)
        for i in range(first, end):
            value += weighed(weights, row, i, of_state(weights, row, i, x))[0]
        return value

    @wp.func
    def running_derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, step: int):
        many, _ = counts(weights, row)
        lx, lxx = VX(), MXX()
        lu, luu, lux = VU(), MUU(), MUX()
        for i in range(many):
            if counts_at(weights, row, i, step):
                j = place(weights, row, i)
                if is_control(j):
                    t = weighed(weights, row, i, control_less(weights, row, i, x, u[j - nx]))
                    lu[j - nx] = lu[j - nx] + t[1]
                    luu[j - nx, j - nx] = luu[j - nx, j - nx] + t[2]
                    k = less(weights, row, i)
                    if k >= 0:
                        lx[k] = lx[k] - t[1]
                        lxx[k, k] = lxx[k, k] + t[2]
                        lux[j - nx, k] = lux[j - nx, k] - t[2]
                else:
                    lx, lxx = bent(weights, row, i, x, lx, lxx)
        return lx, lu, lxx, lux, luu

    @wp.func
    def final_derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        first, end = counts(weights, row)
        lx, lxx = VX(), MXX()
        for i in range(first, end):
            lx, lxx = bent(weights, row, i, x, lx, lxx)
        return lx, lxx

    return CostFunctions(running, final, running_derivatives, final_derivatives)
