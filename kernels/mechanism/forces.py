"""The generalised force of a step: springs, damping, gravity and motion, controls, external forces."""

import warp as wp

from ..factories import cached
from ..structure import Structure
from .dynamics import make_mechanism


@cached
def make_forces(s: Structure, dtype: type) -> wp.Function:
    """forces(world, q, frames, jb, v, u) -> r + u (nv), with external forces."""
    mech = make_mechanism(s, dtype)
    t = mech.types

    @wp.func
    def forces(world: t.World, q: t.VQ, fr: t.FRAMES, jb: t.JB, v: t.VQ, u: t.VU):
        f = wp.static(mech.force)(world, q, fr, jb, v)
        if wp.static(s.nu > 0):
            f += wp.static(mech.control_force)(world, u)
        if world.pushed == 1:
            f += wp.static(mech.body_force)(world, jb)
        return f

    return forces
