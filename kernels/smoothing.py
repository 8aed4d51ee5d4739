"""Scalar functions of smoothed complementarity, safe in float32.

The mixed form writes D lambda = s(z), w = s(-z). REM-logistic, eq. (17) with the smoothing function (5):
s(z) = sigma log(1 + exp(z/sigma)); the hard problem has its limit, s(z) = max(z, 0).
"""

import functools
from typing import NamedTuple

import warp as wp


class Smoothing(NamedTuple):
    """Warp functions, each returning (s(z), s(-z), s'(z), s'(-z)) = (D lambda, w, p, 1 - p)."""

    log1p: wp.Function
    logistic: wp.Function
    kink: wp.Function


@functools.cache
def make_smoothing(dtype: type) -> Smoothing:
    """Smoothing functions for `dtype`."""
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    V4 = wp.types.vector(4, dtype)

    @wp.func
    def log1p(x: dtype):
        # log(1 + x) for x >= 0, with the rounding of 1 + x put back to first order
        y = ONE + x
        return wp.log(y) + (x - (y - ONE)) / y

    @wp.func
    def logistic(z: dtype, sigma: dtype, inverse_sigma: dtype):
        e = wp.exp(-wp.abs(z) * inverse_sigma)
        y = ONE + e
        big = ONE / y
        small = e * big
        tail = sigma * (wp.log(y) + (e - (y - ONE)) * big)
        if z > ZERO:
            return V4(z + tail, tail, big, small)
        return V4(tail, tail - z, small, big)

    @wp.func
    def kink(z: dtype):
        if z > ZERO:
            return V4(z, ZERO, ONE, ZERO)
        if z < ZERO:
            return V4(ZERO, -z, ZERO, ONE)
        return V4(ZERO, ZERO, HALF, HALF)

    return Smoothing(log1p, logistic, kink)
