"""Whether dv' of a solved step's derivative is what its bodies and rows may ask for.

Rows of several contacts that are one row but for a rounding, of a corner that sticks beside a side that
slides say, may ask for different changes. No velocities follow them all: the step has a kink there, or jumps,
and what the linear system answers is those changes over that rounding, 1e10 times as large. It holds all
equations on the scale of its own size, so that nothing but the data's scale tells.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..linear.many import make_many
from ..topology import Topology
from ..work import WORK, Lanes, Slot
from .tables import Slopes

FAR = 1e6  # dv' beside what its bodies and rows ask by themselves; of proper ones 1e4 was the most


@cached
def make_asked() -> SimpleNamespace:
    """told(t, k, d, b, n) of d.known and d.given before they are solved for; suffices(t, k, d, b, asked,
    free): 1 if d.found is no more than that; d.known may be overwritten, d.side is not: `system.py` needs it
    for dz.
    """
    dtype, many = WORK, make_many()
    ZERO, ONE, BEYOND = dtype(0.0), dtype(1.0), dtype(FAR * FAR)

    @wp.func
    def told(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, n: int):
        """The squares of what bodies and rows by themselves ask of dv': of both, and of the bodies."""
        out = Lanes()
        known = d.known[b]
        for i in range(t.blocks):
            m = k.mass[t.mass_at[i] + i]
            for part in range(3):
                value = known[3 * i + part] / m[part, part]
                out += wp.cw_mul(value, value)
        free = out
        for r in range(n):
            s = d.row[b, r]
            size = ZERO + ZERO
            for e in range(k.entry[s], k.entry[s + 1]):
                size += wp.dot(k.jac[e], k.jac[e])
            out += wp.cw_mul(d.given[b, r], d.given[b, r]) / size
        return out, free

    @wp.func(inline=False)
    def amplified(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, free: Lanes):
        """By how much M^-1 makes more of d.known than its diagonal does (squared), at least 1; in place."""
        known = d.known[b]
        for u in range(t.units):
            first = t.unit_start[u]
            last = t.unit_start[u + 1]
            many.solve(k.mass_factor, k.mass_factor, t.mass_first, t.mass_at, t.block_id, known, first, last)
        size = Lanes()
        for i in range(3 * t.blocks):
            size += wp.cw_mul(known[i], known[i])
        out = ONE + ZERO
        for lane in range(wp.static(len(Lanes()))):
            if free[lane] > ZERO:
                out = wp.max(out, size[lane] / free[lane])
        return out

    @wp.func
    def suffices(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, asked: Lanes, free: Lanes):
        found = d.found[b]
        size = Lanes()
        for i in range(3 * t.blocks):
            size += wp.cw_mul(found[i], found[i])
        far = ZERO + ZERO
        for lane in range(wp.static(len(Lanes()))):
            if not (size[lane] <= BEYOND * asked[lane]):
                far = wp.max(far, size[lane] / asked[lane])
        if far > ZERO:
            if not (far <= BEYOND * amplified(t, k, d, b, free)):
                return int(0)
        return int(1)

    return SimpleNamespace(told=told, suffices=suffices)
