"""Residuals of one complementarity condition a >= 0, b >= 0, ab = 0, with and without noise on b.

`expected_min` is E[min(a, b + noise)], eq. (17) and footnote 3; REM squares it. `expected_square` is E[min(a,
b + noise)^2], eq. (15) and footnote 3, in the forms (M14) to (M16); ERM minimises it. Forms are chosen so
that float32 neither overflows nor cancels: differences a - b enter through what s(z) adds to max(z, 0). sigma
is the standard deviation of normal and uniform noise, the scale of a logistic one. Li_2 here is the standard
dilogarithm, the negative of footnote 3's.
"""

import math
from fractions import Fraction
from typing import NamedTuple

import warp as wp

from ..device.compile import named_by_code
from ..factories import cached
from .smoothing import make_smoothing

NAMES = (
    "min",
    "fischer-burmeister",
    "rem-logistic",
    "rem-normal",
    "erm-logistic",
    "erm-normal",
    "erm-uniform",
)
BERNOULLI = ("1/6", "-1/30", "1/42", "-1/30", "5/66", "-691/2730", "7/6", "-3617/510")  # B_2, B_4, ...


class Residuals(NamedTuple):
    """Warp functions (a, b, sigma) -> residual, by the names of NAMES, and the dilogarithm."""

    by_name: dict[str, wp.Function]
    dilogarithm: wp.Function


@cached
def make_residuals(dtype: type) -> Residuals:
    """Residual functions for `dtype`."""
    ZERO, HALF, ONE, TWO, THREE = (dtype(x) for x in (0.0, 0.5, 1.0, 2.0, 3.0))
    QUARTER = dtype(0.25)
    SIXTH = dtype(math.pi**2 / 6.0)
    WIDTH = dtype(math.sqrt(3.0))
    ROOT, DENSITY = dtype(math.sqrt(0.5)), dtype(1.0 / math.sqrt(2.0 * math.pi))
    terms = [float(Fraction(b) / math.factorial(2 * k + 3)) for k, b in enumerate(BERNOULLI)]
    SERIES = wp.types.vector(len(terms), dtype)(*terms)
    COUNT = len(terms)
    logistic, normal = (make_smoothing(dtype, name) for name in ("rem-logistic", "rem-normal"))
    log1p = logistic.log1p

    @wp.func
    def near(y: dtype):
        # Li_2(-y) for 0 <= y <= 1: its Bernoulli series in log(1 + y) <= .7, which converges within 2 pi
        x = log1p(y)
        power = x * x
        total = ZERO
        for k in range(wp.static(COUNT)):
            total = total * power + SERIES[wp.static(COUNT - 1 - k)]
        return -(x + power * (QUARTER + x * total))

    @wp.func
    def dilogarithm(x: dtype):
        """Li_2(x) for x <= 0."""
        if x < -ONE:
            l = wp.log(-x)
            return -SIXTH - HALF * l * l - near(-ONE / x)
        return near(-x)

    @wp.func
    def minimum(a: dtype, b: dtype, sigma: dtype):
        """min(a, b), eq. (4)."""
        return wp.min(a, b)

    @wp.func
    def fischer_burmeister(a: dtype, b: dtype, sigma: dtype):
        """a + b - sqrt(a^2 + b^2), the second function of eq. (4)."""
        large = wp.max(wp.abs(a), wp.abs(b))
        if large == ZERO:
            return ZERO
        x = a / large
        y = b / large
        root = wp.sqrt(x * x + y * y)
        if x + y > ZERO:
            return large * (TWO * x * y / (x + y + root))
        return large * (x + y - root)

    @wp.func
    def rem_logistic(a: dtype, b: dtype, sigma: dtype):
        """E[min(a, b + logistic noise)], eq. (17)."""
        return wp.min(a, b) - wp.static(logistic.smooth)(-wp.abs(a - b), sigma, ONE / sigma)[0]

    @wp.func
    def rem_normal(a: dtype, b: dtype, sigma: dtype):
        """E[min(a, b + normal noise)], footnote 3."""
        return wp.min(a, b) - wp.static(normal.smooth)(-wp.abs(a - b), sigma, ONE / sigma)[0]

    @wp.func
    def erm_logistic(a: dtype, b: dtype, sigma: dtype):
        """E[min(a, b + logistic noise)^2], footnote 3."""
        t = (a - b) / sigma
        e = wp.exp(-wp.abs(t))
        tail = TWO * a * sigma * log1p(e)
        square = TWO * sigma * sigma
        if t > ZERO:
            return b * b + square * (SIXTH + near(e)) - tail
        return a * a - tail - square * near(e)

    @wp.func
    def erm_normal(a: dtype, b: dtype, sigma: dtype):
        """E[min(a, b + normal noise)^2], eq. (15) regrouped."""
        z = (a - b) / sigma
        below = HALF * wp.erfc(-ROOT * z)
        above = HALF * wp.erfc(ROOT * z)
        density = DENSITY * wp.exp(-HALF * z * z)
        return a * a * above + (b * b + sigma * sigma) * below - sigma * (a + b) * density

    @wp.func
    def erm_uniform(a: dtype, b: dtype, sigma: dtype):
        """E[min(a, b + uniform noise)^2], section 3 of the paper's [1]."""
        width = WIDTH * sigma
        low = b - width
        if a <= low:
            return a * a
        share = HALF * (a - low) / width
        if share >= ONE:
            return b * b + sigma * sigma
        return share * (low * low + low * a + a * a) / THREE + (ONE - share) * a * a

    functions = (minimum, fischer_burmeister, rem_logistic, rem_normal, erm_logistic, erm_normal, erm_uniform)
    return Residuals(dict(zip(NAMES, functions, strict=True)), dilogarithm)


@cached
def make_residual_kernel(dtype: type, name: str) -> wp.Kernel:
    """out[i] = residual `name` at (a[i], b[i], sigma[i])."""
    function = make_residuals(dtype).by_name[name]

    @named_by_code()
    def residual_kernel(
        first: int,
        a: wp.array(dtype=dtype),
        b: wp.array(dtype=dtype),
        sigma: wp.array(dtype=dtype),
        out: wp.array(dtype=dtype),
    ):
        i = first + wp.tid()
        out[i] = wp.static(function)(a[i], b[i], sigma[i])

    return residual_kernel
