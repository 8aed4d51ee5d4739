"""Gradient by the parameters of tendons, notation of `mechanism/tendons.py`.

A tendon adds (c.P) (k (l - L) + c.y) of a share of k and its damping to the scalar P.F1, and half h^2 k (c.P)
(c.w) where its stiffness is met late; an actuator adds -h u gear c.P.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..mechanism.kinematics import make_types
from ..mechanism.tendons import make_drive, make_tendon
from ..structure import Structure, layout
from .places import make_places


@cached
def make_tendon_gradient(s: Structure, index: int, dtype: type) -> SimpleNamespace:
    """pulling(world, pose, y, P, share, grad), as of a spring between points; stiffness(world, P, w, share,
    grad): of share P.K w, none of a negative k.
    """
    tendon = make_tendon(s, index, dtype)
    t, at = tendon.types, tendon.columns
    add = make_places(s, dtype).add
    VQ, ZERO = t.VQ, dtype(0.0)
    along, dofs = tendon.along, tendon.dofs

    @wp.func
    def pulling(world: t.World, pose: t.Pose, y: VQ, p: VQ, share: dtype, grad: wp.array(dtype=dtype)):
        felt = along(world, p)
        rate = along(world, y)
        stretch = along(world, pose.q) - world.params[wp.static(at.LENGTH)]
        k = share * world.params[wp.static(at.K)]
        d = world.params[wp.static(at.DAMPING)]
        add(grad, wp.static(at.K), share * felt * stretch)
        add(grad, wp.static(at.LENGTH), -k * felt)
        add(grad, wp.static(at.DAMPING), felt * rate)
        tension = k * stretch + d * rate
        for n in range(wp.static(len(dofs))):
            by_force = felt * (k * pose.q[wp.static(dofs[n])] + d * y[wp.static(dofs[n])])
            add(grad, wp.static(at.COEFFICIENT + n), tension * p[wp.static(dofs[n])] + by_force)

    @wp.func
    def stiffness(world: t.World, p: VQ, w: VQ, share: dtype, grad: wp.array(dtype=dtype)):
        k = share * world.params[wp.static(at.K)]
        if world.params[wp.static(at.K)] > ZERO:
            felt = along(world, p)
            rate = along(world, w)
            add(grad, wp.static(at.K), share * felt * rate)
            for n in range(wp.static(len(dofs))):
                both = rate * p[wp.static(dofs[n])] + felt * w[wp.static(dofs[n])]
                add(grad, wp.static(at.COEFFICIENT + n), k * both)

    return SimpleNamespace(pulling=pulling, stiffness=stiffness)


@cached
def make_drive_gradient(s: Structure, index: int, dtype: type) -> wp.Function:
    """gradient(world, h, P, u, grad) of actuator `index`: by its gear, and by its tendon's coefficients."""
    drive = make_drive(s, index, dtype)
    t, add = make_types(s, dtype), make_places(s, dtype).add
    GEAR = layout(s).offset("gear") + index
    tendon = drive.tendon
    dofs = () if tendon is None else tendon.dofs
    COEFFICIENT = 0 if tendon is None else tendon.columns.COEFFICIENT

    @wp.func
    def gradient(world: t.World, h: dtype, p: t.VQ, u: dtype, grad: wp.array(dtype=dtype)):
        add(grad, wp.static(GEAR), -h * wp.static(drive.felt)(world, p) * u)
        pulled = -h * world.params[wp.static(GEAR)] * u
        for n in range(wp.static(len(dofs))):
            add(grad, wp.static(COEFFICIENT + n), pulled * p[wp.static(dofs[n])])

    return gradient
