"""Tendons in a step, and what controls push and pull, as `mechanism/tendons.py` has them.

The force along a tendon with a limit, springs, dampers and controls together, is that of the end of the step,
f = pull - k (c.(q + h/2 (v' - v)) - L) - d c.v', while this is at most the limit to either side, and else the
limit, by which M has nothing of it. Which of the three it is (it yields to one side, -1 or 1, or 0, not) is
found with v', (M64). Behind the parameters in k.numbers are, of every tendon, which it is and what controls
pull, how often that was looked at, then M and the forces without the tendons that have a limit.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...mechanism.stiff_springs import SHARE
from ..topology import Topology, place
from ..work import WORK, Slot
from .free_motion import make_free_motion
from .mechanism import COLUMN, make_mechanism

TOGETHER, MOST = 8.0, 64.0  # looks in which all tendons change at once; then one does, up to so many
ROUNDING, NEAR = 1e-13, 1e-9  # of a force's terms, and of its limit: by so much it may be beyond and is not


@cached
def make_tendons(given: type) -> SimpleNamespace:
    """act(t, k): forces of tendons without a limit, and what they add to M. control_force(t, k, i, u): of an
    actuator. With limits: loosen(t, k), before a step is solved, finds what yields by the motion without
    contact; after it settle(t, k, 0) -> 1 if other ones yield at k.v, by which M and forces are again;
    is_settled(t, k) -> 0 if too many looks were not enough. tense(t, k): what those that have a limit do;
    yields(t, k, i), and is_steady(t, k, i), whether that is not 0.
    """
    dtype = WORK
    mech, motion = make_mechanism(given), make_free_motion(given)
    number, add_force, add_mass = mech.number, mech.add_force, mech.add_mass
    H, GEAR = COLUMN["step_size"], COLUMN["gear"]
    OF_TENDON = ("stiffness", "damping", "length", "coefficient", "force_limit")
    TENSION, SLOWING, SLACK, SHARE_OF, LIMIT = (COLUMN[f"tendon_{n}"] for n in OF_TENDON)
    ZERO, ONE, PART = dtype(0.0), dtype(1.0), dtype(SHARE)

    @wp.func
    def yields(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """Which of the three tendon i is."""
        return k.numbers[t.width + i]

    @wp.func
    def pulled(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        return k.numbers[t.width + t.tendons + i]

    @wp.func
    def pull(t: wp.ref[Topology], k: wp.ref[Slot], i: int, force: dtype):
        """Add the generalised force of one along tendon i."""
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            add_force(t, k, t.tendon_dof[at], number(t, k, SHARE_OF, at) * force)

    @wp.func
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

    @wp.func(inline=False)
    def act(t: wp.ref[Topology], k: wp.ref[Slot]):
        for i in range(t.tendons):
            if t.tendon_limited[i] == 0:
                stretch(t, k, i)
            else:
                k.numbers[t.width + t.tendons + i] = ZERO

    @wp.func
    def is_steady(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """Whether the force of tendon i is its limit, whatever moves or pulls it a little."""
        return t.tendon_limited[i] == 1 and yields(t, k, i) != ZERO

    @wp.func
    def pull_on(t: wp.ref[Topology], k: wp.ref[Slot], tendon: int, push: dtype):
        """Add the force of an actuator of a tendon; where it has a limit, to what is pulled there."""
        if t.tendon_limited[tendon] == 0:
            pull(t, k, tendon, push)
        else:
            k.numbers[t.width + t.tendons + tendon] = pulled(t, k, tendon) + push

    @wp.func
    def control_force(t: wp.ref[Topology], k: wp.ref[Slot], i: int, u: dtype):
        """Add the force of actuator i."""
        if t.actuator[i] >= 0:
            add_force(t, k, t.actuator[i], number(t, k, GEAR, i) * u)
        else:
            pull_on(t, k, -1 - t.actuator[i], number(t, k, GEAR, i) * u)

    @wp.func(inline=False)
    def tense(t: wp.ref[Topology], k: wp.ref[Slot]):
        for i in range(t.tendons):
            if t.tendon_limited[i] == 1:
                if yields(t, k, i) == ZERO:
                    stretch(t, k, i)
                    pull(t, k, i, pulled(t, k, i))
                else:
                    pull(t, k, i, yields(t, k, i) * number(t, k, LIMIT, i))

    @wp.func(inline=False)
    def hold(t: wp.ref[Topology], k: wp.ref[Slot], back: int):
        """Keep M and the forces as they are; or have them back as they were kept."""
        at = t.width + 2 * t.tendons + 1
        for i in range(k.mass.shape[0]):
            for n in range(9):
                if back == 1:
                    k.mass[i][n // 3, n % 3] = k.numbers[at + 9 * i + n]
                else:
                    k.numbers[at + 9 * i + n] = k.mass[i][n // 3, n % 3]
        at += 9 * k.mass.shape[0]
        for i in range(t.blocks):
            for n in range(3):
                if back == 1:
                    k.move[i][n] = k.numbers[at + 3 * i + n]
                else:
                    k.numbers[at + 3 * i + n] = k.move[i][n]

    @wp.func
    def again(t: wp.ref[Topology], k: wp.ref[Slot]):
        """M and the forces by what yields now."""
        hold(t, k, 1)
        tense(t, k)

    @wp.func(inline=False)
    def side(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """Where the force of tendon i is at k.v: -1 or 1 beyond its limit, 0 below it, as it was within a
        rounding of its terms. From one limit to the other 0 comes between: at a limit it may be beyond the
        other one, and as a spring below both.
        """
        h = number(t, k, H, 0)
        stiffness = number(t, k, TENSION, i)
        damping = number(t, k, SLOWING, i)
        late = wp.where(t.implicit_stiffness == 1 and stiffness > ZERO, PART * h, ZERO)
        new = wp.where(t.implicit_damping == 1, ONE, ZERO)
        force = pulled(t, k, i) + stiffness * number(t, k, SLACK, i)
        size = wp.abs(pulled(t, k, i)) + wp.abs(stiffness * number(t, k, SLACK, i))
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            j = t.tendon_dof[at]
            share = number(t, k, SHARE_OF, at)
            v = k.v[t.dof_block[j]][t.dof_part[j]]
            change = v - k.v0[j]
            place_part = share * stiffness * (k.q[j] + late * change)
            speed_part = share * damping * (k.v0[j] + new * change)
            force -= place_part + speed_part
            size += wp.abs(place_part) + wp.abs(speed_part)
        rounding = dtype(ROUNDING) * size + dtype(NEAR) * number(t, k, LIMIT, i)
        here = yields(t, k, i)
        if here != ZERO:
            return wp.where(force * here >= number(t, k, LIMIT, i) - rounding, here, ZERO)
        if wp.abs(force) <= number(t, k, LIMIT, i) + rounding:
            return ZERO
        return wp.where(force > ZERO, ONE, -ONE)

    @wp.func(inline=False)
    def settle(t: wp.ref[Topology], k: wp.ref[Slot], free: int):
        """`free`: at the velocity without contact, in k.vfree."""
        if free == 1:
            for i in range(t.blocks):
                k.v[i] = k.vfree[i]
        at = t.width + 2 * t.tendons
        out = int(0)
        for i in range(t.tendons):
            if t.tendon_limited[i] == 1 and (out == 0 or k.numbers[at] < dtype(TOGETHER)):
                found = side(t, k, i)
                if found != yields(t, k, i):
                    k.numbers[t.width + i] = found
                    out = int(1)
        again(t, k)
        k.numbers[at] = k.numbers[at] + ONE
        return wp.where(k.numbers[at] < dtype(MOST), out, 0)

    @wp.func
    def is_settled(t: wp.ref[Topology], k: wp.ref[Slot]):
        return wp.where(k.numbers[t.width + 2 * t.tendons] < dtype(MOST), 1, 0)

    @wp.func(inline=False)
    def loosen(t: wp.ref[Topology], k: wp.ref[Slot]):
        hold(t, k, 0)
        for i in range(t.tendons):
            k.numbers[t.width + i] = ZERO
        k.numbers[t.width + 2 * t.tendons] = ZERO
        tense(t, k)
        more = int(1)
        while more == 1:
            motion.euler(t, k)
            more = settle(t, k, 1)

    return SimpleNamespace(
        act=act,
        yields=yields,
        is_steady=is_steady,
        control_force=control_force,
        tense=tense,
        loosen=loosen,
        settle=settle,
        is_settled=is_settled,
    )
