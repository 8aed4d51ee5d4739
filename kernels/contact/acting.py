"""Which rows can act in a step: they join the system when a velocity brings them within reach.

A row whose w = J v + d/h is more than `cut` noise levels above zero has an impulse below rounding. A pair
whose distance is not known yet is left alone while a lower bound of it says the same.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..residual.noise import make_noise
from ..residual.smoothing import make_smoothing
from ..specialisation import Specialisation
from ..structure import Structure, layout
from .rows import make_rows, make_speed
from .shapes import make_pair


@cached
def make_acting(spec: Specialisation, exact_gap: bool) -> SimpleNamespace:
    """Warp functions: near[k](world, frames, v), whether pair k can act; limits and contacts[k],
    (world, rate, jac, sigma, v, mask) -> the mask with the limits' or pair k's rows that can act.

    `exact_gap`: every pair counts as near.
    """
    s, dtype, method = spec
    rows = make_rows(spec)
    noise = make_noise(spec)
    t = rows.types
    VQ, VR, JR = t.VQ, t.VR, t.JR
    NR, NP = s.nr, len(s.pairs)
    H = layout(s).offset("step_size")
    CUT = dtype(make_smoothing(dtype, method.residual).cut)
    rows_of = rows_of_pairs(s)

    def make_near(k: int) -> wp.Function:
        pair, own = make_pair(s, k, dtype), rows_of[k]
        speed = make_speed(s, k, dtype)

        @wp.func
        def near(world: t.World, fr: t.FRAMES, v: VQ):
            # from a lower bound of d and a bound on the approach speed
            if wp.static(exact_gap or pair.exact_bound or method.state_noise):
                return True
            gap = wp.static(pair.bound)(world, fr) / world.params[wp.static(H)]
            level = dtype(0.0)
            for i in range(wp.static(NR)):
                if wp.static(i in own):
                    level = wp.max(level, wp.static(noise.level[i])(world, VR()))
            return not (gap - wp.static(speed)(world, fr, v) > CUT * level)

        return near

    def make_grow(tested: tuple[int, ...], bits: tuple[int, ...]) -> wp.Function:
        @wp.func
        def grow(world: t.World, rate: VR, jac: JR, sigma: VR, v: VQ, mask: int):
            out = mask
            for i in range(wp.static(NR)):
                if wp.static(i in tested):
                    w = wp.static(rows.dots[i])(jac, v) + rate[i]
                    if not (w > CUT * wp.static(noise.level[i])(world, sigma)):
                        out = out | wp.static(bits[i])
            return out

        return grow

    def make_contact(k: int) -> wp.Function:
        tested = tuple(i for i in rows_of[k] if not rows.tangent[i])  # friction acts where its normal does
        # the two rows of a hard contact come together: one after the other costs a solve each
        bits = tuple(sum(1 << j for j in (rows_of[k] if method.hard else (i,))) for i in range(NR))
        return make_grow(tested, bits)

    limits = tuple(i for i in range(NR) if rows.limit[i])
    return SimpleNamespace(
        near=tuple(make_near(k) for k in range(NP)),
        limits=make_grow(limits, tuple(1 << i for i in range(NR))),
        contacts=tuple(make_contact(k) for k in range(NP)),
    )


def rows_of_pairs(s: Structure) -> tuple[tuple[int, ...], ...]:
    """The rows of every pair."""
    return tuple(
        tuple(i for i, row in enumerate(s.rows) if row.kind == "contact" and row.index == k)
        for k in range(len(s.pairs))
    )
