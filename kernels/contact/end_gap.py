"""The gap at the end of a step, in place of its value and slope at the start.

The row of a contact is w = J_n v' + d(q)/h (+- mu J_t v'). Between curved shapes d(q + h v') falls below h w
by a second-order term, so bodies that slide on each other sink in. Here w = d(q + h v')/h (+- mu J_t v')
instead: the difference is added to the row and the problem solved again until it stays. Where a correction is
larger than the one before, half of it is made from then on. One that never settles ends NOT_CONVERGED. A pair
that was out of reach by its velocity at the start may turn into reach within the step: a lower bound of its
distance at the end tells, whatever the motion was.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..mechanism.dynamics import make_mechanism
from ..specialisation import Specialisation
from ..structure import Structure, layout
from .acting import rows_of_pairs
from .rows import make_rows
from .shapes import make_pair

REFINEMENTS = 24
STEADY = {wp.float64: 1e-8, wp.float32: 3e-5}  # change of a row that ends the corrections [m/s]
ROUNDING = {wp.float64: 1e-15, wp.float32: 4e-7}  # of a gap, relative to positions


@cached
def make_unsteady(s: Structure, dtype: type) -> wp.Function:
    """unsteady(q, change, h) -> whether rows changed by more than STEADY and the rounding of a gap."""
    types = make_mechanism(s, dtype).types
    ONE, LEFT, ROUND = dtype(1.0), dtype(STEADY[dtype]), dtype(ROUNDING[dtype])

    @wp.func
    def unsteady(q: types.VQ, change: types.VR, h: dtype):
        return wp.max(wp.abs(change)) > LEFT + ROUND * wp.max(ONE, wp.max(wp.abs(q))) / h

    return unsteady


@cached
def make_end_gap(spec: Specialisation) -> SimpleNamespace:
    """bend(world, q, v, normal, jac, rate, known) -> d(q + h v)/h - (J_n v + d/h) of every row, zero
    for limits and for pairs that are not `known` (bit k: pair k); reached(world, q, v, known) -> the
    other pairs that may touch at q + h v.
    """
    s, dtype, method = spec
    mech = make_mechanism(s, dtype)
    r = make_rows(spec)
    t = mech.types
    VQ, VR, JR, V2 = t.VQ, t.VR, t.JR, t.V2
    VN = wp.types.vector(2 * max(len(s.pairs), 1), dtype)
    H = layout(s).offset("step_size")
    ZERO, HALF = dtype(0.0), dtype(0.5)
    pairs = tuple(make_pair(s, k, dtype) for k in range(len(s.pairs)))
    rows_of = rows_of_pairs(s)
    pair_bit = tuple(1 << k for k in range(len(s.pairs)))

    def make_approach(k: int) -> wp.Function:
        first, last = rows_of[k][0], rows_of[k][-1]

        @wp.func
        def approach(jac: JR, v: VQ):
            # J_n v: the first row (Coulomb, frictionless) or the mean of the two rows J_n +- mu J_t
            out = wp.static(r.dots[first])(jac, v)
            if wp.static(last != first and not r.tangent[last]):
                out = HALF * (out + wp.static(r.dots[last])(jac, v))
            return out

        return approach

    approaches = tuple(make_approach(k) for k in range(len(s.pairs)))

    @wp.func
    def bend(world: t.World, q: VQ, v: VQ, normal: VN, jac: JR, rate: VR, known: int):
        out = VR()
        h = world.params[wp.static(H)]
        frames = wp.static(mech.frames)(world, q + h * v)
        for k in range(wp.static(len(s.pairs))):
            if (known & wp.static(pair_bit[k])) != 0:
                warm = V2(normal[wp.static(2 * k)], normal[wp.static(2 * k + 1)])
                g = wp.static(pairs[k].geometry)(world, frames, warm)
                change = g[2] / h - wp.static(approaches[k])(jac, v) - rate[wp.static(rows_of[k][0])]
                for i in range(wp.static(s.nr)):
                    if wp.static(i in rows_of[k] and not r.tangent[i]):
                        out[i] = change
        return out

    @wp.func
    def reached(world: t.World, q: VQ, v: VQ, known: int):
        out = int(0)
        frames = wp.static(mech.frames)(world, q + world.params[wp.static(H)] * v)
        for k in range(wp.static(len(s.pairs))):
            if (known & wp.static(pair_bit[k])) == 0:
                if not (wp.static(pairs[k].bound)(world, frames) > ZERO):
                    out = out | wp.static(pair_bit[k])
        return out

    return SimpleNamespace(bend=bend, reached=reached)
