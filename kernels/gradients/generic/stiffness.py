"""What implicit stiffness adds to the motion part of an adjoint step: h^2/2 P.K (v' - v), -kappa h^2/2 m'K m.

K as in `mechanism/stiff_springs.py`; each is a sum of forms weight P_1.K P_2 of two sets of joint rates.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.topology import Topology
from ...generic.work import Slot
from ...mechanism.stiff_springs import SHARE
from .room import DUAL, NEW, OLD, ROW, View
from .spans import make_spans


@cached
def make_stiffness(given: type, graded: bool) -> SimpleNamespace:
    """motion(..) adds the first, row_joint(.., j, kappa) and row_spring(.., i, kappa) parts of the second."""
    spans = make_spans(given, graded)
    z = spans.solved
    number, add = z.number, z.add
    H, STIFFNESS, PULL, LENGTH = (
        z.COLUMN[n] for n in ("step_size", "stiffness", "spring_stiffness", "spring_length")
    )
    ZERO, ONE, TWO, PART = wp.float64(0.0), wp.float64(1.0), wp.float64(2.0), wp.float64(SHARE)
    HALF, THREE_HALVES, SHORT = wp.float64(0.5), wp.float64(1.5), wp.float64(spans.SHORT)

    @wp.func
    def joint(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], j: int, one: wp.float64, two: wp.float64
    ):
        """h^2/2 k of a joint times two rates: its columns; returns the slope by the second rate."""
        h = number(t, k, H, 0)
        stiffness = number(t, k, STIFFNESS, j)
        if stiffness <= ZERO:
            return ZERO + ZERO
        add(t, w, STIFFNESS, j, PART * h * h * one * two)
        add(t, w, H, 0, TWO * PART * h * stiffness * one * two)
        return PART * h * h * stiffness * one

    @wp.func
    def spring(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int, one: int, two: int, weight: wp.float64
    ):
        """weight h^2/2 P_1.K P_2 of spring i between points: k (G V_1.V_2 + F (Delta.V_1) (Delta.V_2))."""
        stiffness = number(t, k, PULL, i)
        if stiffness <= ZERO:
            return
        h = number(t, k, H, 0)
        share = weight * PART * h * h
        rest = number(t, k, LENGTH, i)
        e = spans.span(t, k, i, rest)
        v1 = spans.rate(t, w, one, i, e)
        v2 = spans.rate(t, w, two, i, e)
        a1 = wp.dot(e.delta, v1)
        a2 = wp.dot(e.delta, v2)
        both = wp.dot(v1, v2)
        root = wp.sqrt(e.inv)
        rho = rest * root
        across = ZERO + ZERO
        along = e.inv
        by_s = -e.inv * e.inv * a1 * a2
        by_rest = ZERO + ZERO
        if rho < ONE:
            across = ONE - rho
            along = rho * e.inv
            by_s = HALF * rho * e.inv * both - THREE_HALVES * rho * e.inv * e.inv * a1 * a2
            by_rest = root * (e.inv * a1 * a2 - both)
        value = across * both + along * a1 * a2
        add(t, w, PULL, i, share * value)
        add(t, w, H, 0, TWO * weight * PART * h * stiffness * value)
        add(t, w, LENGTH, i, share * stiffness * (by_rest + TWO * by_s * e.eps * SHORT))
        scale = share * stiffness
        by_1 = scale * (across * v2 + along * a2 * e.delta)
        by_2 = scale * (across * v1 + along * a1 * e.delta)
        place = scale * (TWO * by_s * e.delta + along * (a2 * v1 + a1 * v2))
        spans.back(t, k, w, i, e, place, one, by_1, two, by_2)

    @wp.func
    def motion(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        if t.implicit_stiffness == 1:
            for at in range(t.sprung):
                j = t.sprung_dof[at]
                change = w.rates[wp.static(NEW) * t.nv + j] - w.rates[wp.static(OLD) * t.nv + j]
                slope = joint(t, k, w, j, w.rates[wp.static(DUAL) * t.nv + j], change)
                w.by_v[j] = w.by_v[j] - slope
            for n in range(2 * t.springs):
                set = wp.where(n % 2 == 0, wp.static(NEW), wp.static(OLD))
                spring(t, k, w, n // 2, wp.static(DUAL), set, wp.where(n % 2 == 0, ONE, -ONE))

    @wp.func
    def row_joint(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], j: int, kappa: wp.float64):
        m = w.rates[wp.static(ROW) * t.nv + j]
        joint(t, k, w, j, -kappa * m, m)

    @wp.func
    def row_spring(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int, kappa: wp.float64):
        spring(t, k, w, i, wp.static(ROW), wp.static(ROW), -kappa)

    return SimpleNamespace(motion=motion, row_joint=row_joint, row_spring=row_spring)
