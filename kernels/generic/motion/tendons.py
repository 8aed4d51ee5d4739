"""Tendons in a step, and what controls push and pull, as `mechanism/tendons.py` has them."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...mechanism.stiff_springs import SHARE
from ..topology import Topology, place
from ..work import WORK, Slot
from .mechanism import COLUMN, make_mechanism


@cached
def make_tendons(given: type) -> SimpleNamespace:
    """act(t, k): forces of tendons and what they add to M. control_force(t, k, i, u): of an actuator."""
    dtype = WORK
    mech = make_mechanism(given)
    number, add_force, add_mass = mech.number, mech.add_force, mech.add_mass
    H, GEAR = COLUMN["step_size"], COLUMN["gear"]
    OF_TENDON = ("stiffness", "damping", "length", "coefficient")
    TENSION, SLOWING, SLACK, SHARE_OF = (COLUMN[f"tendon_{n}"] for n in OF_TENDON)
    ZERO, PART = dtype(0.0), dtype(SHARE)

    @wp.func
    def pull(t: wp.ref[Topology], k: wp.ref[Slot], i: int, force: dtype):
        """Add the generalised force of one along tendon i."""
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            add_force(t, k, t.tendon_dof[at], number(t, k, SHARE_OF, at) * force)

    @wp.func(inline=False)
    def act(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Add the forces of tendons, and h C and h^2/2 K of them."""
        h = number(t, k, H, 0)
        for i in range(t.tendons):
            start = t.tendon_start[i]
            end = t.tendon_start[i + 1]
            stretch = -number(t, k, SLACK, i)
            rate = dtype(0.0)
            for at in range(start, end):
                share = number(t, k, SHARE_OF, at)
                stretch += share * k.q[t.tendon_dof[at]]
                rate += share * k.v0[t.tendon_dof[at]]
            stiffness = number(t, k, TENSION, i)
            damping = number(t, k, SLOWING, i)
            pull(t, k, i, -(stiffness * stretch + damping * rate))
            weight = wp.where(t.implicit_damping == 1, h * damping, ZERO)
            weight += wp.where(t.implicit_stiffness == 1, PART * h * h * wp.max(stiffness, ZERO), ZERO)
            for at in range(start, wp.where(weight > ZERO, end, start)):
                share = weight * number(t, k, SHARE_OF, at)
                for by in range(start, end):
                    if place(t, t.tendon_dof[by]) <= place(t, t.tendon_dof[at]):
                        own = share * number(t, k, SHARE_OF, by)
                        add_mass(t, k, t.tendon_dof[at], t.tendon_dof[by], own)

    @wp.func
    def control_force(t: wp.ref[Topology], k: wp.ref[Slot], i: int, u: dtype):
        """Add the force of actuator i."""
        if t.actuator[i] >= 0:
            add_force(t, k, t.actuator[i], number(t, k, GEAR, i) * u)
        else:
            pull(t, k, -1 - t.actuator[i], number(t, k, GEAR, i) * u)

    return SimpleNamespace(act=act, control_force=control_force)
