"""What adjoints read of a world's solved step: the only place that knows how `Work` keeps it."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.motion.mechanism import COLUMN, make_mechanism
from ...generic.topology import Topology
from ...generic.work import Slot
from .room import DUAL, NEW, OLD, View


@cached
def make_solved(given: type, graded: bool) -> SimpleNamespace:
    """origin(k, body), axes(k, body) = (cos, sin), rates(t, k, w): P, v and v' by dof;
    number and two(t, k, name, i) of the parameters, add and add2 to the gradient by them if `graded`.
    """
    number = make_mechanism(given).number

    @wp.func
    def origin(k: wp.ref[Slot], body: int):
        f = k.frame[body]
        return wp.vec2d(f[2], f[3])

    @wp.func
    def axes(k: wp.ref[Slot], body: int):
        f = k.frame[body]
        return wp.vec2d(f[0], f[1])

    @wp.func
    def rates(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        """From w.p and the solution; v is in its place already."""
        for j in range(t.nv):
            b = t.dof_block[j]
            w.rates[wp.static(DUAL) * t.nv + j] = -w.p[b][t.dof_part[j]]
            w.rates[wp.static(NEW) * t.nv + j] = k.v[b][t.dof_part[j]]

    @wp.func
    def two(t: wp.ref[Topology], k: wp.ref[Slot], name: int, i: int):
        return wp.vec2d(number(t, k, name, 2 * i), number(t, k, name, 2 * i + 1))

    @wp.func
    def add(t: wp.ref[Topology], w: wp.ref[View], name: int, i: int, value: wp.float64):
        if wp.static(graded):
            column = t.columns[name] + i
            w.grad[column] = w.grad[column] + value

    @wp.func
    def add2(t: wp.ref[Topology], w: wp.ref[View], name: int, i: int, value: wp.vec2d):
        add(t, w, name, 2 * i, value[0])
        add(t, w, name, 2 * i + 1, value[1])

    return SimpleNamespace(origin=origin, axes=axes, rates=rates, number=number, two=two, add=add, add2=add2,
                           COLUMN=COLUMN, OLD=OLD)  # fmt: skip
