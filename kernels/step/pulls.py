"""How hard tendons pull in a step, by what it began with and what came of it."""

import warp as wp

from ..factories import cached
from ..mechanism.kinematics import make_types
from ..mechanism.stiff_springs import SHARE
from ..structure import Structure, layout


@cached
def make_pull(s: Structure, index: int, dtype: type) -> wp.Function:
    """pull(world, before, u, after) -> the force along tendon `index`: spring, damper and actuators, as the
    step meets them (M57).
    """
    t, lay = make_types(s, dtype), layout(s)
    VX, VU = wp.types.vector(2 * s.nv, dtype), wp.types.vector(max(s.nu, 1), dtype)
    dofs, nv, CONTROLS = s.tendons[index], s.nv, s.nu
    driven = [s.driven_tendon(a) == index for a in range(s.nu)]
    K, DAMPING, LENGTH = (lay.offset(f"tendon_{n}") + index for n in ("stiffness", "damping", "length"))
    COEFFICIENT, GEAR = lay.offset("tendon_coefficient") + s.tendon_start(index), lay.offset("gear")
    H = lay.offset("step_size")
    NEW = wp.float64(1.0 if s.implicit_damping else 0.0)
    LATE = wp.float64(SHARE if s.implicit_stiffness else 0.0)
    ZERO = wp.float64(0.0)

    @wp.func
    def pull(world: t.World, before: VX, u: VU, after: VX):
        k = wp.float64(world.params[wp.static(K)])
        late = wp.where(k > ZERO, LATE * wp.float64(world.params[wp.static(H)]), ZERO)
        longer = -wp.float64(world.params[wp.static(LENGTH)])
        rate = wp.float64(0.0)
        for n in range(wp.static(len(dofs))):
            share = wp.float64(world.params[wp.static(COEFFICIENT + n)])
            v = wp.float64(before[wp.static(nv + dofs[n])])
            change = wp.float64(after[wp.static(nv + dofs[n])]) - v
            longer += share * (wp.float64(before[wp.static(dofs[n])]) + late * change)
            rate += share * (v + NEW * change)
        force = -(k * longer + wp.float64(world.params[wp.static(DAMPING)]) * rate)
        for a in range(wp.static(CONTROLS)):
            if wp.static(driven[a]):
                force += wp.float64(world.params[wp.static(GEAR + a)]) * wp.float64(u[a])
        return force

    return pull


@cached
def make_pulls(s: Structure, dtype: type) -> wp.Function:
    """pulls(world, before, u, after) -> a vector over the tendons [N, N m], of a step to the next state;
    in specialised kernels none has a limit.
    """
    t = make_types(s, dtype)
    VX, VU = wp.types.vector(2 * s.nv, dtype), wp.types.vector(max(s.nu, 1), dtype)
    VF = wp.types.vector(len(s.tendons), wp.float64)
    of = [make_pull(s, i, dtype) for i in range(len(s.tendons))]

    @wp.func
    def pulls(world: t.World, before: VX, u: VU, after: VX):
        out = VF()
        for i in range(wp.static(len(of))):
            out[i] = wp.static(of[i])(world, before, u, after)
        return out

    return pulls
