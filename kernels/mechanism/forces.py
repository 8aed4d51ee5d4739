"""The generalised force of a step: springs, damping, gravity and motion, controls, external forces."""

import warp as wp

from ..factories import cached
from ..structure import Structure
from .dynamics import make_mechanism


@cached
def make_forces(s: Structure, dtype: type) -> wp.Function:
    """forces(world, pose, v, u) -> r + u (nv), with external forces."""
    mech = make_mechanism(s, dtype)
    t = mech.types

    @wp.func
    def forces(world: t.World, pose: t.Pose, v: t.VQ, u: t.VU):
        f = wp.static(mech.force)(world, pose, v)
        if wp.static(s.nu > 0):
            f += wp.static(mech.control_force)(world, u)
        if world.pushed == 1:
            f += wp.static(mech.body_force)(world, pose.jacobians)
        return f

    return forces
