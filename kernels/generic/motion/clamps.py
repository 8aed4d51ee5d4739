"""The mean of a force that is clamped, where what is asked for is uncertain (M65)."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...residual.smoothing import make_smoothing
from ..work import V2, WORK

FLAT = 1e-60  # less is no slope: squares of what follows from it are numbers


@cached
def make_clamps() -> SimpleNamespace:
    """clamp(limit, sigma, f) -> (C, dC/df), sigma > 0; by_limit(limit, sigma, f) -> (dC/dlimit, dC/dsigma);
    bend(limit, sigma, f) -> d2C/df2.
    """
    dtype = WORK
    log1p = make_smoothing(WORK, "logistic").log1p
    ZERO, ONE, NONE = dtype(0.0), dtype(1.0), dtype(FLAT)
    HALF, TWO = dtype(0.5), dtype(2.0)

    @wp.func
    def tail(x: dtype, sigma: dtype):
        """log(1 + e), e = exp(-|x|/sigma), its slope by log(sigma), and 1/(1 + exp(x/sigma))"""
        far = wp.abs(x) / sigma
        e = wp.exp(-far)
        small = e / (ONE + e)
        more = wp.where(e > ZERO, far * small, ZERO)
        return log1p(e), more, wp.where(x > ZERO, small, ONE - small)

    @wp.func
    def less(x: dtype, sigma: dtype):
        """1 - exp(-x/sigma), x >= 0, with all digits"""
        t = wp.tanh(HALF * x / sigma)
        return TWO * t / (ONE + t)

    @wp.func
    def clamp(limit: dtype, sigma: dtype, f: dtype):
        size = wp.abs(f)
        near = wp.min(size, limit)
        _s, _a, on = tail(size + limit, sigma)
        _t, _b, off = tail(size - limit, sigma)
        e = wp.exp(-wp.abs(size - limit) / sigma)
        mean = near + sigma * log1p(-e * less(TWO * near, sigma) / (ONE + e))  # s(f + F) - s(f - F) - F
        slope = off - on
        return V2(wp.where(f < ZERO, -mean, mean), wp.where(slope > NONE, slope, ZERO))

    @wp.func
    def by_limit(limit: dtype, sigma: dtype, f: dtype):
        above, more, on = tail(f + limit, sigma)
        below, beyond, off = tail(f - limit, sigma)
        return V2(ONE - on - off, above - below + more - beyond)

    @wp.func
    def bend(limit: dtype, sigma: dtype, f: dtype):
        _a, _m, on = tail(f + limit, sigma)
        _b, _l, off = tail(f - limit, sigma)
        return (on * (ONE - on) - off * (ONE - off)) / sigma

    return SimpleNamespace(clamp=clamp, by_limit=by_limit, bend=bend)
