"""Costs as sums of terms, some of points of bodies: a coordinate in the world, or less that of another point.

Weights are those of `cost_terms.py`; with c = nx + max(nu, 1) components c + 2 p and c + 2 p + 1 are x and
y of point p, and what is taken off is another such. After the terms come the points, POINT numbers each:
the place of its first link, how many links there are from the world on, where it is in the last body. Then
the links, LINK numbers each: the joint (of `JOINT`), its first degree of freedom, anchor, angle, axis. The
last weight is the number of terms. Derivatives are those of (M52).
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..generic.topology import JOINT
from .cost_terms import FIELDS, TIMED, make_sum

PRISMATIC, FREE = JOINT["prismatic"], JOINT["free"]
POINT, LINK = 4, 7


@cached
def make_reach(dtype, VX, fields=FIELDS):
    """Struct `Reach`; ``reach(weights, row, which, x)``: coordinate `which`, 2 p or 2 p + 1, of the points in
    weights of so many numbers a term; ``terms_of(weights, row)``: how many terms there are.
    """
    nx = VX._length_
    V2 = wp.types.vector(2, dtype)
    ZERO, ONE = dtype(0.0), dtype(1.0)

    @wp.struct
    class Reach:
        """A coordinate of a point, its slope, and which degrees of freedom turn the point."""

        value: dtype
        slope: VX
        across: VX  # slope of the other coordinate, with the sign that a quarter turn gives it
        turns: VX

    @wp.func
    def terms_of(weights: wp.array2d(dtype=dtype), row: int):
        return int(weights[row, weights.shape[1] - 1])

    @wp.func
    def turned(c: dtype, s: dtype, x: dtype, y: dtype):
        return V2(c * x - s * y, s * x + c * y)

    @wp.func
    def reach(weights: wp.array2d(dtype=dtype), row: int, which: int, x: VX):
        point = which / 2
        points = 1 + fields * terms_of(weights, row)
        first = points + POINT * point
        link = int(weights[row, first])
        count = int(weights[row, first + 1])
        out = Reach()
        jx, jy, ox, oy = VX(), VX(), VX(), VX()
        place = V2()
        angle = dtype(0.0)
        for _one in range(count):
            joint = int(weights[row, link])
            dof = int(weights[row, link + 1])
            c, s = wp.cos(angle), wp.sin(angle)
            at = V2(weights[row, link + 2], weights[row, link + 3])
            if joint == wp.static(PRISMATIC):
                axis = turned(c, s, weights[row, link + 5], weights[row, link + 6])
                jx[dof] = axis[0]
                jy[dof] = axis[1]
                at += x[dof] * V2(weights[row, link + 5], weights[row, link + 6])
            if joint == wp.static(FREE):
                jx[dof] = c
                jy[dof] = s
                jx[dof + 1] = -s
                jy[dof + 1] = c
                at += V2(x[dof], x[dof + 1])
            place += turned(c, s, at[0], at[1])
            angle += weights[row, link + 4]
            if joint != wp.static(PRISMATIC):
                turn = dof + wp.where(joint == wp.static(FREE), 2, 0)
                out.turns[turn] = ONE
                ox[turn] = place[0]
                oy[turn] = place[1]
                angle += x[turn]
            link += wp.static(LINK)
        place += turned(wp.cos(angle), wp.sin(angle), weights[row, first + 2], weights[row, first + 3])
        for j in range(nx):
            if out.turns[j] > ZERO:
                jx[j] = oy[j] - place[1]
                jy[j] = place[0] - ox[j]
        if which % 2 == 0:
            out.value = place[0]
            out.slope = jx
            out.across = -jy
        else:
            out.value = place[1]
            out.slope = jy
            out.across = jx
        return out

    return SimpleNamespace(Reach=Reach, reach=reach, terms_of=terms_of)


@cached
def make_points(dtype, VX, VU, fields=FIELDS):
    """What `cost_terms.make_sum` asks of points; `less` is a component as the weights have it, or below 0.

    ``value(weights, row, which, less, x)``: a coordinate, less another one. ``add_slopes(.., t, lx, lxx)``:
    lx and lxx with those of a term of it, of value, slope and curvature t. ``terms_of(weights, row)``.
    """
    nx = VX._length_
    MXX, V3 = wp.types.matrix((nx, nx), dtype), wp.types.vector(3, dtype)
    ZERO = dtype(0.0)
    BEGIN = nx + VU._length_
    points = make_reach(dtype, VX, fields)
    Reach, reach = points.Reach, points.reach

    @wp.func
    def other(weights: wp.array2d(dtype=dtype), row: int, less: int, x: VX):
        """What is taken off."""
        if less >= 0:
            return reach(weights, row, less - wp.static(BEGIN), x)
        return Reach()

    @wp.func
    def value(weights: wp.array2d(dtype=dtype), row: int, which: int, less: int, x: VX):
        return reach(weights, row, which, x).value - other(weights, row, less, x).value

    @wp.func
    def bend(r: Reach, slope: dtype, lxx: MXX):
        """lxx and the slope of a term times the second derivatives of a point's coordinate (M52)."""
        out = lxx
        for i in range(nx):
            if r.turns[i] > ZERO:
                for j in range(i, nx):
                    part = slope * r.across[j]
                    out[i, j] = out[i, j] + part
                    if i != j:
                        out[j, i] = out[j, i] + part
        return out

    @wp.func
    def add_slopes(
        weights: wp.array2d(dtype=dtype), row: int, which: int, less: int, x: VX, t: V3, lx: VX, lxx: MXX
    ):
        here, there = reach(weights, row, which, x), other(weights, row, less, x)
        slope = here.slope - there.slope
        bent = bend(here, t[1], lxx + t[2] * wp.outer(slope, slope))
        return lx + t[1] * slope, bend(there, -t[1], bent)

    return SimpleNamespace(value=value, add_slopes=add_slopes, terms_of=points.terms_of)


def make_point_terms(dtype, VX, VU):
    """See the module's docstring; derivatives are exact."""
    return make_sum(dtype, VX, VU, make_points(dtype, VX, VU))


def make_timed_point_terms(dtype, VX, VU):
    """Terms of TIMED numbers each, some of points."""
    return make_sum(dtype, VX, VU, make_points(dtype, VX, VU, TIMED), TIMED)
