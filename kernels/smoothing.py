"""Scalar functions of smoothed complementarity, safe in float32.

The mixed form writes D lambda = s(z), w = s(-z). REM-logistic, eq. (17) with the smoothing function (5):
s(z) = sigma log(1 + exp(z/sigma)); the hard problem is reached through s(z) = (z + sqrt(z^2 + 4 kappa^2))/2 with
kappa -> 0 (Chen & Mangasarian's family, the paper's [12]), whose limit is max(z, 0).
"""

import functools
from typing import NamedTuple

import warp as wp


class Smoothing(NamedTuple):
    """Warp functions, each returning (s(z), s(-z), s'(z), s'(-z)) = (D lambda, w, p, 1 - p)."""

    log1p: wp.Function
    logistic: wp.Function
    chks: wp.Function


@functools.cache
def make_smoothing(dtype: type) -> Smoothing:
    """Smoothing functions for `dtype`."""
    ZERO, HALF, ONE, TWO, FOUR = dtype(0.0), dtype(0.5), dtype(1.0), dtype(2.0), dtype(4.0)
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
    def chks(z: dtype, kappa: dtype):
        a = wp.abs(z)
        root = wp.sqrt(a * a + FOUR * kappa * kappa)
        if not root > ZERO:
            return V4(ZERO, ZERO, HALF, HALF)
        big = HALF * (a + root)
        small = kappa * kappa / big
        if z > ZERO:
            return V4(big, small, big / root, small / root)
        return V4(small, big, small / root, big / root)

    return Smoothing(log1p, logistic, chks)
