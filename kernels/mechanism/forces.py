"""The generalised force of a step: springs, damping, gravity and motion, controls, external forces."""

import warp as wp

from ..factories import cached
from ..structure import Structure
from .dynamics import make_mechanism


@cached
def make_forces(s: Structure, dtype: type) -> wp.Function:
    """forces(params, row, q, frames, jb, v, u, external, world) -> r + u (nv); none external if world < 0."""
    mech = make_mechanism(s, dtype)
    t = mech.types

    @wp.func
    def forces(
        params: wp.array2d(dtype=dtype),
        row: int,
        q: t.VQ,
        fr: t.FRAMES,
        jb: t.JB,
        v: t.VQ,
        u: t.VU,
        external: wp.array2d(dtype=dtype),
        world: int,
    ):
        f = wp.static(mech.force)(params, row, q, fr, jb, v)
        if wp.static(s.nu > 0):
            f += wp.static(mech.control_force)(params, row, u)
        if world >= 0 and external.shape[0] > 0:
            f += wp.static(mech.body_force)(params, row, jb, external, world)
        return f

    return forces
