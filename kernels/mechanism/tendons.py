"""Tendons: springs and dampers of a weighted sum of coordinates, l = sum_j c_j q_j, and what drives them.

A tendon of stiffness k, damping c and length L pulls with k (l - L) + c dl/dt, on coordinate j c_j times as
much (M57). As l is linear in q its matrices k c c' are constant, and nothing of it has second derivatives.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..structure import Structure, layout
from .kinematics import make_types


@cached
def make_tendon(s: Structure, index: int, dtype: type) -> SimpleNamespace:
    """Warp functions of tendon `index`; those with a total add to it.

    along(world, y) = c.y. pull(world, force, total): of a force along l. force(world, q, v, total): r.
    stiffness(world, share, total): share k c c' of a k of either sign, stiff(..): of a positive one;
    damping(world, share, total): share times the damping, of c c'.
    """
    t, lay = make_types(s, dtype), layout(s)
    VQ, MQ = t.VQ, t.MQ
    ZERO = dtype(0.0)
    dofs = s.tendons[index]
    SIZE = len(dofs)
    K, DAMPING, LENGTH = (lay.offset(f"tendon_{n}") + index for n in ("stiffness", "damping", "length"))
    COEFFICIENT = lay.offset("tendon_coefficient") + s.tendon_start(index)

    @wp.func
    def along(world: t.World, y: VQ):
        out = ZERO
        for n in range(wp.static(SIZE)):
            out += world.params[wp.static(COEFFICIENT + n)] * y[wp.static(dofs[n])]
        return out

    @wp.func
    def pull(world: t.World, force: dtype, total: VQ):
        out = total
        for n in range(wp.static(SIZE)):
            share = world.params[wp.static(COEFFICIENT + n)] * force
            out[wp.static(dofs[n])] = out[wp.static(dofs[n])] + share
        return out

    @wp.func
    def force(world: t.World, q: VQ, v: VQ, total: VQ):
        stretch = along(world, q) - world.params[wp.static(LENGTH)]
        tension = world.params[wp.static(K)] * stretch + world.params[wp.static(DAMPING)] * along(world, v)
        return pull(world, -tension, total)

    @wp.func
    def add(world: t.World, weight: dtype, total: MQ):
        out = total
        for n in range(wp.static(SIZE)):
            one = weight * world.params[wp.static(COEFFICIENT + n)]
            for m in range(wp.static(SIZE)):
                both = one * world.params[wp.static(COEFFICIENT + m)]
                out[wp.static(dofs[n]), wp.static(dofs[m])] = (
                    out[wp.static(dofs[n]), wp.static(dofs[m])] + both
                )
        return out

    @wp.func
    def stiffness(world: t.World, share: dtype, total: MQ):
        return add(world, share * world.params[wp.static(K)], total)

    @wp.func
    def stiff(world: t.World, share: dtype, total: MQ):
        return add(world, share * wp.max(world.params[wp.static(K)], ZERO), total)

    @wp.func
    def damping(world: t.World, share: dtype, total: MQ):
        return add(world, share * world.params[wp.static(DAMPING)], total)

    return SimpleNamespace(
        types=t,
        along=along,
        pull=pull,
        force=force,
        stiffness=stiffness,
        stiff=stiff,
        damping=damping,
        dofs=dofs,
        columns=SimpleNamespace(K=K, DAMPING=DAMPING, LENGTH=LENGTH, COEFFICIENT=COEFFICIENT),
    )


@cached
def make_drive(s: Structure, index: int, dtype: type) -> SimpleNamespace:
    """Warp functions of what actuator `index` drives: push(world, force, total) adds the force to its degree
    of freedom, or along its tendon; felt(world, y): the rate of that at rates y.
    """
    t = make_types(s, dtype)
    VQ = t.VQ
    dof = s.actuators[index]
    if dof < 0:
        tendon = make_tendon(s, s.driven_tendon(index), dtype)
        return SimpleNamespace(push=tendon.pull, felt=tendon.along, tendon=tendon)

    @wp.func
    def push(world: t.World, force: dtype, total: VQ):
        out = total
        out[wp.static(dof)] = out[wp.static(dof)] + force
        return out

    @wp.func
    def felt(world: t.World, y: VQ):
        return y[wp.static(dof)]

    return SimpleNamespace(push=push, felt=felt, tendon=None)
