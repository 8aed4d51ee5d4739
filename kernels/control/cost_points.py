"""Costs as sums of terms, some of points of bodies: a coordinate in the world, or less that of another point.

Weights are those of `cost_terms.py`; with c = nx + max(nu, 1) components c + 2 p and c + 2 p + 1 are x and
y of point p, and what is taken off is another such. After the terms come the points, POINT numbers each:
the place of its first link, how many links there are from the world on, where it is in the last body. Then
the links, LINK numbers each: the joint (REVOLUTE, PRISMATIC, FREE), its first degree of freedom, anchor,
angle, axis. The last weight is the number of terms. With J = dp/dq, o the place of a joint that turns, and i
before j among the degrees of freedom of the chain:

    J_j = perp(p - o_j), or the joint's direction;     d2p/dq_i dq_j = perp(J_j) if i turns, else 0.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from .cost_terms import FIELDS, make_shape
from .costs import CostFunctions

REVOLUTE, PRISMATIC, FREE = range(3)
POINT, LINK = 4, 7


@cached
def make_reach(dtype, VX):
    """Struct `Reach`; ``reach(weights, row, which, x)``: coordinate `which`, 2 p or 2 p + 1, of the points in
    weights; ``terms_of(weights, row)``: how many terms there are.
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
        points = 1 + FIELDS * terms_of(weights, row)
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


def make_point_terms(dtype, VX, VU):
    """See the module's docstring; derivatives are exact."""
    nx, nu = VX._length_, VU._length_
    MXX, MUX, MUU = (wp.types.matrix(shape, dtype) for shape in ((nx, nx), (nu, nx), (nu, nu)))
    ZERO, ONE = dtype(0.0), dtype(1.0)
    shape, points = make_shape(dtype), make_reach(dtype, VX)
    Reach, reach, terms_of = points.Reach, points.reach, points.terms_of

    @wp.func
    def value_of(weights: wp.array2d(dtype=dtype), row: int, i: int, x: VX, u: VU):
        """What term i is of."""
        at = 1 + FIELDS * i
        j = int(weights[row, at + 1])
        k = int(weights[row, at + 5])
        if j >= wp.static(nx + nu):
            value = reach(weights, row, j - wp.static(nx + nu), x).value
            if k >= 0:
                value -= reach(weights, row, k - wp.static(nx + nu), x).value
            return value
        if j >= wp.static(nx):
            return u[j - wp.static(nx)]
        if k >= 0:
            return x[j] - x[k]
        return x[j]

    @wp.func
    def weighed(weights: wp.array2d(dtype=dtype), row: int, i: int, s: dtype):
        """Term i at the value s of what it is of, its slope and its curvature."""
        at = 1 + FIELDS * i
        e = s - weights[row, at + 3]
        return weights[row, at + 2] * shape(int(weights[row, at]), e, weights[row, at + 4])

    @wp.func
    def total(weights: wp.array2d(dtype=dtype), row: int, first: int, end: int, x: VX, u: VU):
        value = dtype(0.0)
        for i in range(first, end):
            value += weighed(weights, row, i, value_of(weights, row, i, x, u))[0]
        return value

    @wp.func
    def running(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
        return total(weights, row, 0, int(weights[row, 0]), x, u)

    @wp.func
    def final(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        return total(weights, row, int(weights[row, 0]), terms_of(weights, row), x, VU())

    @wp.func
    def bend(r: Reach, sign: dtype, slope: dtype, lxx: MXX):
        """lxx and the slope of a term times the second derivatives of a point's coordinate."""
        out = lxx
        for i in range(nx):
            if r.turns[i] > ZERO:
                for j in range(i, nx):
                    part = sign * slope * r.across[j]
                    out[i, j] = out[i, j] + part
                    if i != j:
                        out[j, i] = out[j, i] + part
        return out

    @wp.func
    def of_point(weights: wp.array2d(dtype=dtype), row: int, i: int, x: VX, lx: VX, lxx: MXX):
        """lx and lxx with those of term i, of a point."""
        at = 1 + FIELDS * i
        k = int(weights[row, at + 5])
        r = reach(weights, row, int(weights[row, at + 1]) - wp.static(nx + nu), x)
        other = Reach()
        if k >= 0:
            other = reach(weights, row, k - wp.static(nx + nu), x)
        t = weighed(weights, row, i, r.value - other.value)
        slope = r.slope - other.slope
        bent = bend(r, ONE, t[1], lxx + t[2] * wp.outer(slope, slope))
        return lx + t[1] * slope, bend(other, -ONE, t[1], bent)

    @wp.func
    def of_state(weights: wp.array2d(dtype=dtype), row: int, i: int, x: VX, lx: VX, lxx: MXX):
        """lx and lxx with those of term i, of a state or of the difference of two."""
        at = 1 + FIELDS * i
        t = weighed(weights, row, i, value_of(weights, row, i, x, VU()))
        slope = VX()
        k = int(weights[row, at + 5])
        slope[int(weights[row, at + 1])] = ONE
        if k >= 0:
            slope[k] = slope[k] - ONE
        return lx + t[1] * slope, lxx + t[2] * wp.outer(slope, slope)

    @wp.func
    def running_derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, step: int):
        lx, lxx, lu, luu = VX(), MXX(), VU(), MUU()
        for i in range(int(weights[row, 0])):
            j = int(weights[row, 1 + FIELDS * i + 1])
            if j >= wp.static(nx + nu):
                lx, lxx = of_point(weights, row, i, x, lx, lxx)
            elif j < wp.static(nx):
                lx, lxx = of_state(weights, row, i, x, lx, lxx)
            else:
                t = weighed(weights, row, i, u[j - nx])
                lu[j - nx] = lu[j - nx] + t[1]
                luu[j - nx, j - nx] = luu[j - nx, j - nx] + t[2]
        return lx, lu, lxx, MUX(), luu

    @wp.func
    def final_derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        lx, lxx = VX(), MXX()
        for i in range(int(weights[row, 0]), terms_of(weights, row)):
            if int(weights[row, 1 + FIELDS * i + 1]) >= wp.static(nx + nu):
                lx, lxx = of_point(weights, row, i, x, lx, lxx)
            else:
                lx, lxx = of_state(weights, row, i, x, lx, lxx)
        return lx, lxx

    return CostFunctions(running, final, running_derivatives, final_derivatives)
