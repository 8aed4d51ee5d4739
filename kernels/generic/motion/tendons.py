"""Tendons in a step, and what controls push and pull, as `mechanism/tendons.py` has them.

The force along a tendon with a limit is that of the end of the step: of what is asked for,
f = pull - k (c.(q + h/2 (v' - v)) - L) - d c.v', springs, dampers and controls together, it is C(f), f
clamped to the limit (M64) or, under smoothed laws with a sigma, the mean of that (M65). A step has of it a
line, C(g) + C'(g) (f - g), by which M has C' of the tendon's part; the g is found with v'. Of a clamp it is
one of three, -1 or 1 where it yields to one side, 0 where it does not. Behind the parameters in k.numbers
are, of every tendon, its g and what controls pull, how often that was looked at, the f of then, M and the
forces without the tendons that have a limit, and what `whole.py` keeps.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...mechanism.stiff_springs import SHARE
from ..topology import SMOOTHED, Topology, place
from ..work import V2, WORK, Slot
from .clamps import make_clamps
from .free_motion import make_free_motion
from .mechanism import COLUMN, make_mechanism

EAGER, TOGETHER, MOST = 16, 32.0, 128.0  # looks by whole steps, in which all clamps change at once, at most
ROUNDING, NEAR = 1e-13, 1e-9  # of a force's terms, and of its limit: by so much it may be beyond and is not
MET = 1e-14  # of the limit: by so much a line may miss the mean


@cached
def make_tendons(given: type) -> SimpleNamespace:
    """act(t, k): forces of tendons without a limit, and what they add to M. control_force(t, k, i, u): of an
    actuator. With limits: loosen(t, k), before a step is solved, finds what yields by the motion without
    contact; prepare(t, k) keeps that behind k.vfree, and contact has looks of its own; after it settle(t, k,
    0) -> 1 if other ones yield at k.v, by which M and forces are again; is_settled(t, k) -> 0 if too many
    looks were not enough. tense(t, k): what those that have a limit do, by line(t, k, i) = (C', C - C' g) at
    guess(t, k, i) = g, found(t, k, i) = f; slope(t, k, i): C', 1 of others; sigma_of(t, k, i), 0: a clamp.
    stretch(t, k, i, part): as if without a limit. hold(t, k, back): M and the forces as they are, kept and
    had back.
    """
    dtype = WORK
    mech, motion, clamp = make_mechanism(given), make_free_motion(given), make_clamps().clamp
    number, add_force, add_mass = mech.number, mech.add_force, mech.add_mass
    H, GEAR = COLUMN["step_size"], COLUMN["gear"]
    OF_TENDON = ("stiffness", "damping", "length", "coefficient", "force_limit", "force_sigma")
    TENSION, SLOWING, SLACK, SHARE_OF, LIMIT, SIGMA = (COLUMN[f"tendon_{n}"] for n in OF_TENDON)
    ZERO, ONE, PART = dtype(0.0), dtype(1.0), dtype(SHARE)
    HALF = dtype(0.5)

    @wp.func
    def guess(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """The g of tendon i."""
        return k.numbers[t.width + i]

    @wp.func
    def found(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """What was asked of tendon i, f, when that was looked at last; g may be another point of its line."""
        return k.numbers[t.width + 2 * t.tendons + 1 + i]

    @wp.func
    def sigma_of(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """0: a clamp."""
        return wp.where(t.limited == wp.static(SMOOTHED), number(t, k, SIGMA, i), ZERO)

    @wp.func
    def line(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """What tendon i pulls of what is asked for, and beside that."""
        g = guess(t, k, i)
        sigma = sigma_of(t, k, i)
        if sigma > ZERO:
            c = clamp(number(t, k, LIMIT, i), sigma, g)
            return V2(c[1], c[0] - c[1] * g)
        return V2(wp.where(g == ZERO, ONE, ZERO), g * number(t, k, LIMIT, i))

    @wp.func
    def pulled(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        return k.numbers[t.width + t.tendons + i]

    @wp.func
    def pull(t: wp.ref[Topology], k: wp.ref[Slot], i: int, force: dtype):
        """Add the generalised force of one along tendon i."""
        for n in range(t.tendon_start[i], t.tendon_start[i + 1]):
            add_force(t, k, t.tendon_dof[n], number(t, k, SHARE_OF, n) * force)

    @wp.func
    def stretch(t: wp.ref[Topology], k: wp.ref[Slot], i: int, part: dtype):
        """Add a part of the force of tendon i, and of h C and h^2/2 K of it."""
        h = number(t, k, H, 0)
        start = t.tendon_start[i]
        end = t.tendon_start[i + 1]
        longer = -number(t, k, SLACK, i)
        rate = dtype(0.0)
        for at in range(start, end):
            share = number(t, k, SHARE_OF, at)
            longer += share * k.q[t.tendon_dof[at]]
            rate += share * k.v0[t.tendon_dof[at]]
        stiffness = part * number(t, k, TENSION, i)
        damping = part * number(t, k, SLOWING, i)
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
                stretch(t, k, i, ONE)
            else:
                k.numbers[t.width + t.tendons + i] = ZERO

    @wp.func
    def slope(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """How much more tendon i pulls by what is asked of it."""
        if t.tendon_limited[i] == 0:
            return ONE
        return line(t, k, i)[0]

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
                c = line(t, k, i)
                if c[0] > ZERO:
                    stretch(t, k, i, c[0])
                pull(t, k, i, c[0] * pulled(t, k, i) + c[1])

    @wp.func(inline=False)
    def hold(t: wp.ref[Topology], k: wp.ref[Slot], back: int):
        """Keep M and the forces as they are; or have them back as they were kept."""
        at = t.width + 3 * t.tendons + 1
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
    def asked(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """What is asked of tendon i at k.v, f, and the size of its terms."""
        h = number(t, k, H, 0)
        stiffness = number(t, k, TENSION, i)
        damping = number(t, k, SLOWING, i)
        late = wp.where(t.implicit_stiffness == 1 and stiffness > ZERO, PART * h, ZERO)
        new = wp.where(t.implicit_damping == 1, ONE, ZERO)
        force = pulled(t, k, i) + stiffness * number(t, k, SLACK, i)
        size = wp.abs(pulled(t, k, i)) + wp.abs(stiffness * number(t, k, SLACK, i))
        for n in range(t.tendon_start[i], t.tendon_start[i + 1]):
            j = t.tendon_dof[n]
            share = number(t, k, SHARE_OF, n)
            v = k.v[t.dof_block[j]][t.dof_part[j]]
            change = v - k.v0[j]
            place_part = share * stiffness * (k.q[j] + late * change)
            speed_part = share * damping * (k.v0[j] + new * change)
            force -= place_part + speed_part
            size += wp.abs(place_part) + wp.abs(speed_part)
        return V2(force, size)

    @wp.func
    def side(t: wp.ref[Topology], k: wp.ref[Slot], i: int, f: V2):
        """Where the clamp of tendon i is: -1 or 1 beyond its limit, 0 below it, as it was within a rounding
        of its terms. From one limit to the other 0 comes between: at a limit it may be beyond the other one,
        and as a spring below both.
        """
        rounding = dtype(ROUNDING) * f[1] + dtype(NEAR) * number(t, k, LIMIT, i)
        here = guess(t, k, i)
        if here != ZERO:
            return wp.where(f[0] * here >= number(t, k, LIMIT, i) - rounding, here, ZERO)
        if wp.abs(f[0]) <= number(t, k, LIMIT, i) + rounding:
            return ZERO
        return wp.where(f[0] > ZERO, ONE, -ONE)

    @wp.func
    def nearer(t: wp.ref[Topology], k: wp.ref[Slot], i: int, sigma: dtype, f: V2):
        """The g of a mean: f, but as it was where its line is met there, and 0 between one side of 0 and the
        other: from there, and from less than f on its side, the lines lead to f from one side.
        """
        limit = number(t, k, LIMIT, i)
        here = guess(t, k, i)
        c = line(t, k, i)
        miss = wp.abs(clamp(limit, sigma, f[0])[0] - (c[0] * f[0] + c[1]))
        lost = dtype(ROUNDING) * f[1]  # of f, of which the line misses the square
        if miss <= dtype(MET) * limit + lost * wp.min(c[0], lost / sigma):
            return here
        if f[0] * here < ZERO:
            return ZERO
        looks = int(k.numbers[t.width + 2 * t.tendons])
        half = looks >= EAGER and looks % 8 < 4  # then again as far as they lead
        return here + wp.where(half, HALF, ONE) * (f[0] - here)

    @wp.func(inline=False)
    def look(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """The g of tendon i by k.v; apart from `settle`, for 208 registers on sm_90."""
        f = asked(t, k, i)
        k.numbers[t.width + 2 * t.tendons + 1 + i] = f[0]
        sigma = sigma_of(t, k, i)
        if sigma > ZERO:
            return nearer(t, k, i, sigma, f)
        return side(t, k, i, f)

    @wp.func(inline=False)
    def settle(t: wp.ref[Topology], k: wp.ref[Slot], free: int):
        """`free`: at the velocity without contact, in k.vfree."""
        if free == 1:
            for i in range(t.blocks):
                k.v[i] = k.vfree[i]
        looks = t.width + 2 * t.tendons
        out = int(0)
        for i in range(t.tendons):
            single = k.numbers[looks] >= dtype(TOGETHER) and sigma_of(t, k, i) == ZERO
            if t.tendon_limited[i] == 1 and (out == 0 or not single):
                other = look(t, k, i)
                if other != guess(t, k, i):
                    k.numbers[t.width + i] = other
                    out = int(1)
        again(t, k)
        k.numbers[looks] = k.numbers[looks] + ONE
        return wp.where(k.numbers[looks] < dtype(MOST), out, 0)

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

    @wp.func
    def prepare(t: wp.ref[Topology], k: wp.ref[Slot]):
        for i in range(t.blocks):
            k.vfree[t.blocks + i] = k.vfree[i]
        if is_settled(t, k) == 1:
            k.numbers[t.width + 2 * t.tendons] = ZERO

    return SimpleNamespace(
        prepare=prepare,
        act=act,
        guess=guess,
        found=found,
        line=line,
        slope=slope,
        sigma_of=sigma_of,
        stretch=stretch,
        hold=hold,
        control_force=control_force,
        tense=tense,
        loosen=loosen,
        settle=settle,
        is_settled=is_settled,
    )
