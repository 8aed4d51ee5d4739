"""Points that a search keeps: the best of Newton's method, and an interior one that it left."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..newton import make_newton
from ..work import Island, Slot


@cached
def make_kept(given: type, residual: str) -> SimpleNamespace:
    """keep_best, take_best, leave and go_back, each (k, o)."""
    smooth = make_newton(given, residual).smooth

    @wp.func
    def keep_best(k: wp.ref[Slot], o: Island):
        for place in range(o.start, o.end):
            k.best_v[k.block[place]] = k.v[k.block[place]]
        for r in range(o.row, o.last_row):
            k.best_z[r] = k.z[r]

    @wp.func
    def take_best(k: wp.ref[Slot], o: Island):
        for place in range(o.start, o.end):
            k.v[k.block[place]] = k.best_v[k.block[place]]
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.z[r] = k.best_z[r]
                k.lam[r] = smooth(k, r, k.z[r])[0] * k.inverse[r]

    @wp.func
    def leave(k: wp.ref[Slot], o: Island):
        """Keep the interior point while Newton's method is tried."""
        for place in range(o.start, o.end):
            k.inner_v[k.block[place]] = k.v[k.block[place]]
        for r in range(o.row, o.last_row):
            k.total[r] = k.w[r]

    @wp.func
    def go_back(k: wp.ref[Slot], o: Island):
        for place in range(o.start, o.end):
            k.v[k.block[place]] = k.inner_v[k.block[place]]
        for r in range(o.row, o.last_row):
            k.w[r] = k.total[r]

    return SimpleNamespace(keep_best=keep_best, take_best=take_best, leave=leave, go_back=go_back)
