"""What several policies are made of.

Differences of periodic state components are wrapped to half a period (the finger's free ellipse looks the
same after a turn by pi).
"""

import warp as wp

from ..factories import cached


@cached
def make_wrap(dtype: type) -> wp.Function:
    """wrapped(d, period): d less the nearest multiple of the period; d itself where the period is 0."""

    @wp.func
    def wrapped(d: dtype, period: dtype):
        if period > dtype(0.0):
            return d - period * wp.round(d / period)
        return d

    return wrapped


@cached
def make_hold(dtype: type) -> wp.Function:
    """held(u, lower, upper): u within its limits; NaN stays NaN."""

    @wp.func
    def held(u: dtype, lower: dtype, upper: dtype):
        if u < lower:
            return lower
        if u > upper:
            return upper
        return u

    return held


@cached
def make_limits(nu: int, dtype: type) -> wp.Function:
    """limited(lower, upper, u): controls within limits (nu,), or as they are where these are empty."""
    VU, held = wp.types.vector(max(nu, 1), dtype), make_hold(dtype)

    @wp.func
    def limited(lower: wp.array(dtype=dtype), upper: wp.array(dtype=dtype), u: VU):
        out = u
        if lower.shape[0] > 0:
            for i in range(nu):
                out[i] = held(u[i], lower[i], upper[i])
        return out

    return limited
