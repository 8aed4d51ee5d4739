"""Springs between points in an adjoint step: lengths, rates of their ends, and slopes back to bodies."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.topology import Topology
from ...generic.work import Slot
from ...structure import WORLD
from .room import View
from .twists import make_twists, turned

TAIL = (1e-3, 1e-5)  # of a spring's length at zero, as in `mechanism/springs.py`


@cached
def make_spans(given: type, graded: bool) -> SimpleNamespace:
    """The struct `Span`; span(t, k, i, rest) of spring i; rate(t, w, set, i, e): velocity of its second end
    against the first; back(.., e, place, first, by_first, second, by_second): slopes by Delta and by two
    such velocities.
    """
    move = make_twists(given, graded)
    z = move.solved
    two, add2, axes, origin = z.two, z.add2, z.axes, z.origin
    TIED = z.COLUMN["spring_point"]
    ONE = wp.float64(1.0)
    SHORT, TINY = (wp.float64(x) for x in TAIL)

    @wp.struct
    class Span:
        ra: wp.vec2d  # the ends from their bodies' origins
        rb: wp.vec2d
        delta: wp.vec2d
        eps: wp.float64
        inv: wp.float64  # 1/s

    @wp.func
    def lever(t: wp.ref[Topology], k: wp.ref[Slot], end: int):
        """A spring's end from its body's origin, in the axes of the world."""
        body = t.spring_body[end]
        local = two(t, k, TIED, end)
        if body == WORLD:
            return local
        return turned(axes(k, body), local)

    @wp.func
    def where_is(t: wp.ref[Topology], k: wp.ref[Slot], body: int, rho: wp.vec2d):
        if body == WORLD:
            return rho
        return origin(k, body) + rho

    @wp.func
    def span(t: wp.ref[Topology], k: wp.ref[Slot], i: int, rest: wp.float64):
        out = Span()
        out.ra = lever(t, k, 2 * i)
        out.rb = lever(t, k, 2 * i + 1)
        first = where_is(t, k, t.spring_body[2 * i], out.ra)
        out.delta = where_is(t, k, t.spring_body[2 * i + 1], out.rb) - first
        out.eps = SHORT * rest + TINY
        out.inv = ONE / (wp.dot(out.delta, out.delta) + out.eps * out.eps)
        return out

    @wp.func
    def moves(t: wp.ref[Topology], w: wp.ref[View], set: int, body: int, rho: wp.vec2d):
        if body == WORLD:
            return wp.vec2d()
        return move.point(t, w, set, body, rho)

    @wp.func
    def rate(t: wp.ref[Topology], w: wp.ref[View], set: int, i: int, e: Span):
        first = moves(t, w, set, t.spring_body[2 * i], e.ra)
        return moves(t, w, set, t.spring_body[2 * i + 1], e.rb) - first

    @wp.func
    def end_back(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], end: int, rho: wp.vec2d, place: wp.vec2d,
        first: int, by_first: wp.vec2d, second: int, by_second: wp.vec2d,
    ):  # fmt: skip
        """Slopes by an end's place and by its velocities under two sets of rates."""
        body = t.spring_body[end]
        by_rho = wp.vec2d()
        if body != WORLD:
            by_rho = move.point_back(t, w, first, body, rho, by_first)
            by_rho += move.point_back(t, w, second, body, rho, by_second)
        add2(t, w, TIED, end, move.attach(t, k, w, body, rho, place, by_rho))

    @wp.func
    def back(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int, e: Span, place: wp.vec2d,
        first: int, by_first: wp.vec2d, second: int, by_second: wp.vec2d,
    ):  # fmt: skip
        end_back(t, k, w, 2 * i, e.ra, -place, first, -by_first, second, -by_second)
        end_back(t, k, w, 2 * i + 1, e.rb, place, first, by_first, second, by_second)

    return SimpleNamespace(solved=z, Span=Span, span=span, rate=rate, back=back, SHORT=TAIL[0])
