"""Tendons in an adjoint step: h (c.P) (k (c.q - L) + d c.y), y the rates that dampers see, and all columns.

Notation of `mechanism/tendons.py`; P the dual rates. With implicit stiffness h^2/2 k (c.P) c.(v' - v) beside
it, and of a row, whose m = N^-1 J_i' is in the rates ROW, -kappa (h d + h^2/2 k) (c.m)^2. With a limit it is
-h (c.P) C(f) of what is asked for, which changes by C' of what f does (M65); D has all of it.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.motion import tendons as forward
from ...generic.motion.clamps import make_clamps
from ...generic.motion.mechanism import COLUMN, make_mechanism
from ...generic.topology import Topology
from ...generic.work import WORK, Slot
from ...mechanism.stiff_springs import SHARE
from .curves import Curves
from .room import DUAL, NEW, OLD, ROW, View
from .solved import make_solved


@cached
def make_tendons(given: type, graded: bool) -> SimpleNamespace:
    """motion(t, k, w, i), row_part(t, k, w, i, kappa) of tendon i; felt(t, k, w, i) = c.P, and
    pulled(t, k, w, i, force): the columns of a force along it that P.F1 has; slope(t, k, i) = C'.
    """
    z = make_solved(given, graded)
    number, add = z.number, z.add
    pulling = forward.make_tendons(given)
    slope, line, by_limit = pulling.slope, pulling.line, make_clamps().by_limit
    H = z.COLUMN["step_size"]
    OF_TENDON = ("stiffness", "damping", "length", "coefficient", "force_limit", "force_sigma")
    K, DAMPING, LENGTH, COEFFICIENT, LIMIT, NOISE = (z.COLUMN[f"tendon_{n}"] for n in OF_TENDON)
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
    def beside(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int):
        """-h (c.P) of C - C' f, by the limit and its sigma."""
        h = number(t, k, H, 0)
        p = felt(t, k, w, i)
        sigma = pulling.sigma_of(t, k, i)
        by = wp.vec2d(pulling.guess(t, k, i), ZERO)
        if sigma > ZERO:
            by = by_limit(number(t, k, LIMIT, i), sigma, pulling.found(t, k, i))
        add(t, w, LIMIT, i, -h * by[0] * p)
        add(t, w, NOISE, i, -h * by[1] * p)
        force = line(t, k, i)[1]
        add(t, w, H, 0, -force * p)
        pulled(t, k, w, i, -h * force)

    @wp.func
    def motion(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int):
        if t.tendon_limited[i] == 1:
            beside(t, k, w, i)
        part = slope(t, k, i)
        if part == ZERO:
            return
        h = number(t, k, H, 0)
        stiffness = number(t, k, K, i)
        damping = number(t, k, DAMPING, i)
        seen = wp.where(t.implicit_damping == 1, wp.static(NEW), wp.static(OLD))
        p = part * felt(t, k, w, i)
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
        pulled(t, k, w, i, part * (h * tension + late * change))
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

    return SimpleNamespace(motion=motion, row_part=row_part, felt=felt, pulled=pulled, slope=slope)


@cached
def make_clamped(given: type) -> wp.Function:
    """clamped(t, k, w, e, b): adds what bends with forces that are means, -h (c.P) C'' df/ds df/ds', to
    e.found; what is asked for, f, is linear in s = (q, v, u) and in v', which follows them by e.move.
    """
    number = make_mechanism(given).number
    tendons, bend = forward.make_tendons(given), make_clamps().bend
    OF_TENDON = ("stiffness", "damping", "coefficient", "force_limit")
    TENSION, SLOWING, SHARE_OF, LIMIT = (COLUMN[f"tendon_{n}"] for n in OF_TENDON)
    H, GEAR = COLUMN["step_size"], COLUMN["gear"]
    ZERO, PART = WORK(0.0), WORK(SHARE)

    @wp.func
    def asks(t: wp.ref[Topology], k: wp.ref[Slot], e: Curves, b: int, i: int):
        """df/ds of tendon i into e.cross."""
        h = number(t, k, H, 0)
        stiffness = number(t, k, TENSION, i)
        damping = number(t, k, SLOWING, i)
        late = wp.where(t.implicit_stiffness == 1 and stiffness > ZERO, PART * h * stiffness, ZERO)
        new = wp.where(t.implicit_damping == 1, damping, ZERO)
        width = 2 * t.nv + t.nu
        for n in range(width):
            e.cross[b, n] = ZERO
        for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
            j = t.tendon_dof[at]
            share = number(t, k, SHARE_OF, at)
            e.cross[b, j] = e.cross[b, j] - share * stiffness
            e.cross[b, t.nv + j] = e.cross[b, t.nv + j] + share * (late - damping + new)
            for n in range(width):
                e.cross[b, n] = e.cross[b, n] - share * (late + new) * e.move[b, j, n]
        for a in range(t.nu):
            if t.actuator[a] == -1 - i:
                e.cross[b, 2 * t.nv + a] = e.cross[b, 2 * t.nv + a] + number(t, k, GEAR, a)

    @wp.func(inline=False)
    def clamped(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], e: Curves, b: int):
        width = 2 * t.nv + t.nu
        for i in range(t.tendons):
            sigma = wp.where(t.tendon_limited[i] == 1, tendons.sigma_of(t, k, i), ZERO)
            if sigma > ZERO:
                felt = ZERO + ZERO
                for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
                    felt += number(t, k, SHARE_OF, at) * w.rates[wp.static(DUAL) * t.nv + t.tendon_dof[at]]
                bent = bend(number(t, k, LIMIT, i), sigma, tendons.found(t, k, i))
                curve = -number(t, k, H, 0) * felt * bent
                asks(t, k, e, b, i)
                for n in range(width):
                    own = curve * e.cross[b, n]
                    for m in range(width):
                        e.found[b, n, m] = e.found[b, n, m] + own * e.cross[b, m]

    return clamped
