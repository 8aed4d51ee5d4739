"""How hard tendons pull in a step, by what it began with and what came of it, as `step/pulls.py` has it."""

import warp as wp

from ...factories import cached
from ...mechanism.stiff_springs import SHARE
from ..topology import Topology
from ..work import WORK, Slot
from .clamps import make_clamps
from .mechanism import COLUMN, make_mechanism
from .tendons import make_tendons


@cached
def make_pulls(given: type, nv: int, nu: int) -> wp.Function:
    """pulls(t, k, pull, before, u, after) fills pull (tendons,) with the force of every tendon [N, N m],
    within its limit (M64), (M65).
    """
    VX, VU = wp.types.vector(2 * nv, given), wp.types.vector(max(nu, 1), given)
    number, tendons, clamp = make_mechanism(given).number, make_tendons(given), make_clamps().clamp
    H, GEAR = COLUMN["step_size"], COLUMN["gear"]
    OF_TENDON = ("stiffness", "damping", "length", "coefficient", "force_limit")
    TENSION, SLOWING, SLACK, SHARE_OF, LIMIT = (COLUMN[f"tendon_{n}"] for n in OF_TENDON)
    ZERO, ONE, PART = WORK(0.0), WORK(1.0), WORK(SHARE)

    @wp.func
    def asked(t: wp.ref[Topology], k: wp.ref[Slot], i: int, before: VX, after: VX):
        """Of spring and damper of tendon i."""
        stiffness = number(t, k, TENSION, i)
        late = ZERO
        if t.implicit_stiffness == 1 and stiffness > ZERO:
            late = PART * number(t, k, H, 0)
        new = wp.where(t.implicit_damping == 1, ONE, ZERO)
        longer = -number(t, k, SLACK, i)
        rate = WORK(0.0)
        for n in range(t.tendon_start[i], t.tendon_start[i + 1]):
            j = t.tendon_dof[n]
            share = number(t, k, SHARE_OF, n)
            v = WORK(before[nv + j])
            change = WORK(after[nv + j]) - v
            longer += share * (WORK(before[j]) + late * change)
            rate += share * (v + new * change)
        return -(stiffness * longer + number(t, k, SLOWING, i) * rate)

    @wp.func(inline=False)
    def pulls(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        pull: wp.array(dtype=wp.float64),
        before: VX,
        u: VU,
        after: VX,
    ):
        for i in range(t.tendons):
            pull[i] = asked(t, k, i, before, after)
        for a in range(nu):
            if t.actuator[a] < 0:
                i = -1 - t.actuator[a]
                pull[i] = pull[i] + number(t, k, GEAR, a) * WORK(u[a])
        for i in range(t.tendons):
            if t.tendon_limited[i] == 1:
                most = number(t, k, LIMIT, i)
                sigma = tendons.sigma_of(t, k, i)
                if sigma > ZERO:
                    pull[i] = clamp(most, sigma, pull[i])[0]
                else:
                    pull[i] = wp.clamp(pull[i], -most, most)

    return pulls
