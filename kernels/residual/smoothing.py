"""Scalar functions of smoothed complementarity, safe in float32.

The mixed form writes D lambda = s(z), w = s(-z) (M11), where s(z) is the mean of max(z + noise, 0):
REM-logistic, eq. (17) with the smoothing function (5), s(z) = sigma log(1 + exp(z/sigma)); REM-normal,
footnote 3, s(z) = z Phi(z/sigma) + sigma phi(z/sigma), both (M12). The hard problem has their limit, s(z) =
max(z, 0). s(z) - s(-z) = z in all of them. A rounding of z far below 0 changes s(z) by as much as the
cancellation in the normal's tail does.
"""

import math
from typing import NamedTuple

import warp as wp

from ..factories import cached


class Smoothing(NamedTuple):
    """Warp functions of one residual.

    smooth(z, sigma, 1/sigma) and kink(z) return (s(z), s(-z), s'(z), s'(-z)) = (D lambda, w, p, 1 - p);
    bend(z, 1/sigma) returns s''(z), at most steepest/sigma; s(z)/sigma is below the resolution of numbers at
    sigma where z < -cut sigma.
    """

    log1p: wp.Function
    smooth: wp.Function
    bend: wp.Function
    kink: wp.Function
    steepest: float
    cut: float


CUT = {  # by distribution and precision
    ("logistic", wp.float64): 37.0,
    ("logistic", wp.float32): 17.0,
    ("normal", wp.float64): 8.3,
    ("normal", wp.float32): 5.3,
}
# differences of derivatives: a part of the smoothing, which a velocity of the size of sigma passes
REACH = 0.03
LARGEST_LAYER = 0.1  # the finest sigma counts up to this; also where there are no rows
HARD_LAYER = 1e-3  # what stands for sigma in the hard problem, to stay on one side of its kinks
STEEPEST = {"logistic": 0.25, "normal": 1.0 / math.sqrt(2.0 * math.pi)}  # largest sigma s''


@cached
def make_smoothing(dtype: type, residual: str) -> Smoothing:
    """Smoothing functions for `dtype` and a residual of `Method`; both of a distribution share them."""
    distribution = "normal" if residual.endswith("normal") else "logistic"
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    ROOT = dtype(1.0 / math.sqrt(2.0))
    DENSITY = dtype(STEEPEST["normal"])
    V4 = wp.types.vector(4, dtype)

    @wp.func
    def log1p(x: dtype):
        # log(1 + x) for x >= -1/2, with the rounding of 1 + x put back to first order
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
    def logistic_bend(z: dtype, inverse_sigma: dtype):
        e = wp.exp(-wp.abs(z) * inverse_sigma)
        y = ONE + e
        return e * inverse_sigma / (y * y)

    @wp.func
    def normal_bend(z: dtype, inverse_sigma: dtype):
        x = z * inverse_sigma
        return DENSITY * inverse_sigma * wp.exp(-HALF * x * x)

    @wp.func
    def normal(z: dtype, sigma: dtype, inverse_sigma: dtype):
        x = wp.abs(z) * inverse_sigma
        small = HALF * wp.erfc(ROOT * x)
        big = ONE - small
        tail = sigma * wp.max(DENSITY * wp.exp(-HALF * x * x) - x * small, ZERO)
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

    smooth, bend = {"logistic": (logistic, logistic_bend), "normal": (normal, normal_bend)}[distribution]
    cut = 0.0 if residual == "hard" else CUT[distribution, dtype]
    return Smoothing(log1p, smooth, bend, kink, STEEPEST[distribution], cut)
