"""Tendons in an adjoint step: h (c.P) (k (c.q - L) + d c.y), y the rates that dampers see, and all columns.

Notation of `mechanism/tendons.py`; P the dual rates. With implicit stiffness h^2/2 k (c.P) c.(v' - v) beside
it, and of a row, whose m = N^-1 J_i' is in the rates ROW, -kappa (h d + h^2/2 k) (c.m)^2.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.motion import tendons as forward
from ...generic.topology import Topology
from ...generic.work import Slot
from ...mechanism.stiff_springs import SHARE
from .room import DUAL, NEW, OLD, ROW, View
from .solved import make_solved


@cached
def make_tendons(given: type, graded: bool) -> SimpleNamespace:
    """motion(t, k, w, i), row_part(t, k, w, i, kappa) of tendon i; felt(t, k, w, i) = c.P, and
    pulled(t, k, w, i, force): the columns of a force along it that P.F1 has; is_steady(t, k, i).
    """
    z = make_solved(given, graded)
    number, add = z.number, z.add
    pulling = forward.make_tendons(given)
    is_steady, yields = pulling.is_steady, pulling.yields
    H = z.COLUMN["step_size"]
    OF_TENDON = ("stiffness", "damping", "length", "coefficient", "force_limit")
    K, DAMPING, LENGTH, COEFFICIENT, LIMIT = (z.COLUMN[f"tendon_{n}"] for n in OF_TENDON)
    ZERO, TWO, PART = wp.float64(0.0), wp.float64(2.0), wp.float64(SHARE)

    @wp.func
    def along(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int, set: int):
        """c.y of a set of rates."""
        out = ZERO + ZERO
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            out += number(t, k, COEFFICIENT, at) * w.rates[set * t.nv + t.tendon_dof[at]]
        return out

    @wp.func
    def felt(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int):
        return along(t, k, w, i, wp.static(DUAL))

    @wp.func
    def pulled(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int, force: wp.float64):
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            add(t, w, COEFFICIENT, at, force * w.rates[wp.static(DUAL) * t.nv + t.tendon_dof[at]])

    @wp.func
    def steady(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int):
        """Of a force at its limit: -h (c.P) of it."""
        h = number(t, k, H, 0)
        p = felt(t, k, w, i)
        force = yields(t, k, i) * number(t, k, LIMIT, i)
        add(t, w, LIMIT, i, -h * yields(t, k, i) * p)
        add(t, w, H, 0, -force * p)
        pulled(t, k, w, i, -h * force)

    @wp.func
    def motion(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int):
        if is_steady(t, k, i):
            steady(t, k, w, i)
            return
        h = number(t, k, H, 0)
        stiffness = number(t, k, K, i)
        damping = number(t, k, DAMPING, i)
        seen = wp.where(t.implicit_damping == 1, wp.static(NEW), wp.static(OLD))
        p = felt(t, k, w, i)
        rate = along(t, k, w, i, seen)
        stretch = -number(t, k, LENGTH, i)
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            stretch += number(t, k, COEFFICIENT, at) * w.q[t.tendon_dof[at]]
        late = ZERO + ZERO  # h^2/2 k
        change = ZERO + ZERO
        if t.implicit_stiffness == 1:
            late = PART * h * h * wp.max(stiffness, ZERO)
            change = along(t, k, w, i, wp.static(NEW)) - along(t, k, w, i, wp.static(OLD))
        add(t, w, K, i, h * p * stretch)
        if late > ZERO:
            add(t, w, K, i, PART * h * h * p * change)
            add(t, w, H, 0, TWO * PART * h * stiffness * p * change)
        add(t, w, LENGTH, i, -h * p * stiffness)
        add(t, w, DAMPING, i, h * p * rate)
        tension = stiffness * stretch + damping * rate
        add(t, w, H, 0, tension * p)
        pulled(t, k, w, i, h * tension + late * change)
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            j = t.tendon_dof[at]
            own = number(t, k, COEFFICIENT, at) * p
            moved = late * (w.rates[wp.static(NEW) * t.nv + j] - w.rates[wp.static(OLD) * t.nv + j])
            moved += h * (stiffness * w.q[j] + damping * w.rates[seen * t.nv + j])
            add(t, w, COEFFICIENT, at, p * moved)
            w.by_q[j] = w.by_q[j] + h * stiffness * own
            w.by_v[j] = w.by_v[j] - late * own
            if t.implicit_damping == 0:
                w.by_v[j] = w.by_v[j] + h * damping * own

    @wp.func
    def row_part(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int, kappa: wp.float64):
        if is_steady(t, k, i):
            return
        h = number(t, k, H, 0)
        m = along(t, k, w, i, wp.static(ROW))
        weight = ZERO + ZERO
        if t.implicit_damping == 1:
            damping = number(t, k, DAMPING, i)
            weight += h * damping
            add(t, w, DAMPING, i, -kappa * h * m * m)
            add(t, w, H, 0, -kappa * damping * m * m)
        stiffness = number(t, k, K, i)
        if t.implicit_stiffness == 1 and stiffness > ZERO:
            weight += PART * h * h * stiffness
            add(t, w, K, i, -kappa * PART * h * h * m * m)
            add(t, w, H, 0, -kappa * TWO * PART * h * stiffness * m * m)
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            own = w.rates[wp.static(ROW) * t.nv + t.tendon_dof[at]]
            add(t, w, COEFFICIENT, at, -TWO * kappa * weight * m * own)

    return SimpleNamespace(motion=motion, row_part=row_part, felt=felt, pulled=pulled, is_steady=is_steady)
