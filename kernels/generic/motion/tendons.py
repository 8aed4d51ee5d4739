"""Tendons in a step, and what controls push and pull, as `mechanism/tendons.py` has them.

The force along a tendon with a limit, springs, dampers and controls together, is that of the end of the step,
f = pull - k (c.(q + h/2 (v' - v)) - L) - d c.v', while this is at most the limit to either side, and else the
limit, by which M has nothing of it. Which of the three it is (k.yields) is found with v', (M64).
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...mechanism.stiff_springs import SHARE
from ..topology import Topology, place
from ..work import WORK, Slot
from .free_motion import make_free_motion
from .mechanism import COLUMN, make_mechanism

TOGETHER, MOST = 8, 64  # looks in which all tendons change at once; then one does, up to so many
ROUNDING = 1e-9  # of a force's own terms, by which it may be beyond the limit and is not


@cached
def make_tendons(given: type) -> SimpleNamespace:
    """act(t, k): forces of tendons without a limit, and what they add to M. control_force(t, k, i, u): of an
    actuator. With limits: loosen(t, k) -> 1 if what yields by the motion without contact was found, before a
    step is solved; after it changed(t, k, look) -> 1 if other ones yield at k.v, by which M and forces are
    again, -1 if too many looks did not settle it; tense(t, k): what those that have a limit do by k.yields;
    is_steady(t, k, i).
    """
    dtype = WORK
    mech, motion = make_mechanism(given), make_free_motion(given)
    number, add_force, add_mass = mech.number, mech.add_force, mech.add_mass
    H, GEAR = COLUMN["step_size"], COLUMN["gear"]
    OF_TENDON = ("stiffness", "damping", "length", "coefficient", "force_limit")
    TENSION, SLOWING, SLACK, SHARE_OF, LIMIT = (COLUMN[f"tendon_{n}"] for n in OF_TENDON)
    ZERO, ONE, PART = dtype(0.0), dtype(1.0), dtype(SHARE)

    @wp.func
    def pull(t: wp.ref[Topology], k: wp.ref[Slot], i: int, force: dtype):
        """Add the generalised force of one along tendon i."""
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            add_force(t, k, t.tendon_dof[at], number(t, k, SHARE_OF, at) * force)

    @wp.func(inline=False)
    def stretch(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """Add the force of tendon i, and h C and h^2/2 K of it."""
        h = number(t, k, H, 0)
        start = t.tendon_start[i]
        end = t.tendon_start[i + 1]
        longer = -number(t, k, SLACK, i)
        rate = dtype(0.0)
        for at in range(start, end):
            share = number(t, k, SHARE_OF, at)
            longer += share * k.q[t.tendon_dof[at]]
            rate += share * k.v0[t.tendon_dof[at]]
        stiffness = number(t, k, TENSION, i)
        damping = number(t, k, SLOWING, i)
        pull(t, k, i, -(stiffness * longer + damping * rate))
        weight = wp.where(t.implicit_damping == 1, h * damping, ZERO)
        weight += wp.where(t.implicit_stiffness == 1, PART * h * h * wp.max(stiffness, ZERO), ZERO)
        for at in range(start, wp.where(weight > ZERO, end, start)):
            share = weight * number(t, k, SHARE_OF, at)
            for by in range(start, end):
                if place(t, t.tendon_dof[by]) <= place(t, t.tendon_dof[at]):
                    own = share * number(t, k, SHARE_OF, by)
                    add_mass(t, k, t.tendon_dof[at], t.tendon_dof[by], own)

    @wp.func
    def act(t: wp.ref[Topology], k: wp.ref[Slot]):
        for i in range(t.tendons):
            if t.tendon_limited[i] == 0:
                stretch(t, k, i)
            else:
                k.pulled[i] = ZERO

    @wp.func
    def is_steady(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """Whether the force of tendon i is its limit, whatever moves or pulls it a little."""
        return t.tendon_limited[i] == 1 and k.yields[i] != 0

    @wp.func
    def control_force(t: wp.ref[Topology], k: wp.ref[Slot], i: int, u: dtype):
        """Add the force of actuator i; at a tendon with a limit, to what is pulled there."""
        push = number(t, k, GEAR, i) * u
        if t.actuator[i] >= 0:
            add_force(t, k, t.actuator[i], push)
        else:
            tendon = -1 - t.actuator[i]
            if t.tendon_limited[tendon] == 0:
                pull(t, k, tendon, push)
            else:
                k.pulled[tendon] = k.pulled[tendon] + push

    @wp.func(inline=False)
    def tense(t: wp.ref[Topology], k: wp.ref[Slot]):
        for i in range(t.tendons):
            if t.tendon_limited[i] == 1:
                if k.yields[i] == 0:
                    stretch(t, k, i)
                    pull(t, k, i, k.pulled[i])
                else:
                    pull(t, k, i, dtype(k.yields[i]) * number(t, k, LIMIT, i))

    @wp.func(inline=False)
    def again(t: wp.ref[Topology], k: wp.ref[Slot]):
        """M and the forces by what yields now."""
        for i in range(k.mass.shape[0]):
            k.mass[i] = k.bare_mass[i]
        for i in range(t.blocks):
            k.move[i] = k.bare_move[i]
        tense(t, k)

    @wp.func(inline=False)
    def side(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """Where the force of tendon i is at k.v: -1 or 1 beyond its limit, 0 below it, as it was within a
        rounding of its terms.
        """
        h = number(t, k, H, 0)
        stiffness = number(t, k, TENSION, i)
        damping = number(t, k, SLOWING, i)
        late = wp.where(t.implicit_stiffness == 1 and stiffness > ZERO, PART * h, ZERO)
        new = wp.where(t.implicit_damping == 1, ONE, ZERO)
        force = k.pulled[i] + stiffness * number(t, k, SLACK, i)
        size = wp.abs(k.pulled[i]) + wp.abs(stiffness * number(t, k, SLACK, i))
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            j = t.tendon_dof[at]
            share = number(t, k, SHARE_OF, at)
            v = k.v[t.dof_block[j]][t.dof_part[j]]
            change = v - k.v0[j]
            place_part = share * stiffness * (k.q[j] + late * change)
            speed_part = share * damping * (k.v0[j] + new * change)
            force -= place_part + speed_part
            size += wp.abs(place_part) + wp.abs(speed_part)
        most = number(t, k, LIMIT, i)
        rounding = dtype(ROUNDING) * (size + most)
        if wp.abs(wp.abs(force) - most) <= rounding:
            if k.yields[i] == 0 or force * dtype(k.yields[i]) > ZERO:
                return k.yields[i]
        if wp.abs(force) <= most:
            return int(0)
        return wp.where(force > ZERO, 1, -1)

    @wp.func(inline=False)
    def changed(t: wp.ref[Topology], k: wp.ref[Slot], look: int):
        out = int(0)
        for i in range(t.tendons):
            if t.tendon_limited[i] == 1 and (out == 0 or look < TOGETHER):
                found = side(t, k, i)
                if found != k.yields[i]:
                    k.yields[i] = found
                    out = int(1)
        if out == 1:
            if look >= MOST:
                return int(-1)
            again(t, k)
        return out

    @wp.func(inline=False)
    def loosen(t: wp.ref[Topology], k: wp.ref[Slot]):
        for i in range(k.mass.shape[0]):
            k.bare_mass[i] = k.mass[i]
        for i in range(t.blocks):
            k.bare_move[i] = k.move[i]
        for i in range(t.tendons):
            k.yields[i] = 0
        tense(t, k)
        look = int(0)
        more = int(1)
        while more == 1:
            motion.euler(t, k)
            for i in range(t.blocks):
                k.v[i] = k.vfree[i]
            more = changed(t, k, look)
            look += 1
        again(t, k)  # its forces, which the motion without contact made velocities of
        return wp.where(more == 0, 1, 0)

    return SimpleNamespace(
        act=act,
        is_steady=is_steady,
        control_force=control_force,
        tense=tense,
        loosen=loosen,
        changed=changed,
    )
