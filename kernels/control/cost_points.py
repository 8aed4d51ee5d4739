"""Costs as sums of terms, some of points of bodies: a coordinate in the world, or less that of another point.

Weights are those of `cost_terms.py`; with c = nx + max(nu, 1) components c + 2 p and c + 2 p + 1 are x and
y of point p, and what is taken off is another such. A point is a weighed sum of points of bodies, one, or
the centres of mass of several. After the terms come the points, POINT numbers each: the place of its first
part, and how many there are. Then all parts, PART numbers each: its weight, the place of its first link, how
many links there are from the world on, where it is in the last body. Then the links, LINK numbers each: the
joint (of `JOINT`), its first degree of freedom, anchor, angle, axis. The last weight is the number of terms.
Derivatives are those of (M52).
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..generic.topology import JOINT
from .cost_terms import FIELDS, TIMED, make_sum

PRISMATIC, FREE = JOINT["prismatic"], JOINT["free"]
POINT, PART, LINK = 2, 5, 7


@cached
def make_reach(dtype, VX, fields=FIELDS):
    """Struct `Reach`; of coordinate `which`, 2 p or 2 p + 1, of the points in weights of so many numbers a
    term: ``parts(weights, row, which)``: where its first part is, and how many; ``reach(weights, row, part,
    which, x)`` of one of them, ``value(weights, row, which, x)`` of all; ``terms_of(weights, row)``: how many
    terms there are.
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
    def parts(weights: wp.array2d(dtype=dtype), row: int, which: int):
        first = 1 + fields * terms_of(weights, row) + POINT * (which / 2)
        return int(weights[row, first]), int(weights[row, first + 1])

    @wp.func
    def reach(weights: wp.array2d(dtype=dtype), row: int, part: int, which: int, x: VX):
        link = int(weights[row, part + 1])
        count = int(weights[row, part + 2])
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
        place += turned(wp.cos(angle), wp.sin(angle), weights[row, part + 3], weights[row, part + 4])
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

    @wp.func
    def value(weights: wp.array2d(dtype=dtype), row: int, which: int, x: VX):
        first, count = parts(weights, row, which)
        out = dtype(0.0)
        for i in range(count):
            part = first + wp.static(PART) * i
            out += weights[row, part] * reach(weights, row, part, which, x).value
        return out

    return SimpleNamespace(parts=parts, reach=reach, value=value, terms_of=terms_of)


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
    reach, parts = points.reach, points.parts

    @wp.func
    def value(weights: wp.array2d(dtype=dtype), row: int, which: int, less: int, x: VX):
        out = points.value(weights, row, which, x)
        if less >= 0:
            out -= points.value(weights, row, less - wp.static(BEGIN), x)
        return out

    @wp.func
    def slope_of(weights: wp.array2d(dtype=dtype), row: int, which: int, x: VX):
        first, count = parts(weights, row, which)
        out = VX()
        for i in range(count):
            part = first + wp.static(PART) * i
            out += weights[row, part] * reach(weights, row, part, which, x).slope
        return out

    @wp.func
    def bend(weights: wp.array2d(dtype=dtype), row: int, which: int, x: VX, slope: dtype, lxx: MXX):
        """lxx and the slope of a term times the second derivatives of a point's coordinate (M52)."""
        first, count = parts(weights, row, which)
        out = lxx
        for one in range(count):
            at = first + wp.static(PART) * one
            r = reach(weights, row, at, which, x)
            share = slope * weights[row, at]
            for i in range(nx):
                if r.turns[i] > ZERO:
                    for j in range(i, nx):
                        part = share * r.across[j]
                        out[i, j] = out[i, j] + part
                        if i != j:
                            out[j, i] = out[j, i] + part
        return out

    @wp.func
    def add_slopes(
        weights: wp.array2d(dtype=dtype), row: int, which: int, less: int, x: VX, t: V3, lx: VX, lxx: MXX
    ):
        slope = slope_of(weights, row, which, x)
        if less >= 0:
            slope -= slope_of(weights, row, less - wp.static(BEGIN), x)
        bent = bend(weights, row, which, x, t[1], lxx + t[2] * wp.outer(slope, slope))
        if less >= 0:
            bent = bend(weights, row, less - wp.static(BEGIN), x, -t[1], bent)
        return lx + t[1] * slope, bent

    return SimpleNamespace(value=value, add_slopes=add_slopes, terms_of=points.terms_of)


def make_point_terms(dtype, VX, VU):
    """See the module's docstring; derivatives are exact."""
    return make_sum(dtype, VX, VU, make_points(dtype, VX, VU))


def make_timed_point_terms(dtype, VX, VU):
    """Terms of TIMED numbers each, some of points."""
    return make_sum(dtype, VX, VU, make_points(dtype, VX, VU, TIMED), TIMED)
