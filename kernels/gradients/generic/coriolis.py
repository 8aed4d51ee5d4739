"""Second derivatives of the generic step's Coriolis forces, which are quadratic in velocities."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.topology import Topology, place
from ...generic.work import LANES, WORK, Slot
from .curves import Curves
from .room import OLD, Room, View
from .step import make_step_adjoint


@cached
def make_coriolis(given: type, residual: str) -> SimpleNamespace:
    """of_velocities(t, k, w, e, b, leaps), of_predicted(t, k, room, w, e, b): add to e.found, at the rates
    and P that are there, what is quadratic in v, and in what the leapfrog predicts. ahead(t, room, b, j,
    column): dp/ds.
    """
    adjoint = make_step_adjoint(given, residual, False)
    ZERO, ONE, HALF = WORK(0.0), WORK(1.0), WORK(0.5)

    @wp.func
    def ahead(t: wp.ref[Topology], room: wp.ref[Room], b: int, j: int, column: int):
        """The derivative of what the leapfrog predicts of dof j."""
        found = room.factor.ahead[b, column / LANES * 3 * t.blocks + place(t, j)]
        return found[column % LANES]

    @wp.func(inline=False)
    def bent(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], e: Curves, b: int, share: WORK):
        """Into e.coriolis second derivatives of Coriolis forces under the rates in the place of v: their
        slopes' differences are exact, whatever their size.
        """
        for c in range(t.nv + 1):  # at v itself, then with one of it greater by 1
            at = wp.static(OLD) * t.nv + wp.max(c - 1, 0)
            v = w.rates[at] + ZERO
            w.rates[at] = v + wp.where(c > 0, ONE, ZERO)
            adjoint.coriolis(t, k, w, share)
            w.rates[at] = v
            for j in range(t.nv):
                if c > 0:
                    e.coriolis[b, j, c - 1] = w.by_v[j] - e.by_move[b, j]
                else:
                    e.by_move[b, j] = w.by_v[j]

    @wp.func
    def of_velocities(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], e: Curves, b: int, leaps: int):
        """The bodies' part is quadratic in v; of a leapfrog's whole step half of it."""
        share = wp.where(leaps == 1, HALF, ONE)
        bent(t, k, w, e, b, share)
        for i in range(t.nv):
            for j in range(t.nv):
                own = HALF * (e.coriolis[b, i, j] + e.coriolis[b, j, i])
                e.found[b, t.nv + i, t.nv + j] = e.found[b, t.nv + i, t.nv + j] + own

    @wp.func(inline=False)
    def of_predicted(
        t: wp.ref[Topology], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View], e: Curves, b: int
    ):
        """And in what the leapfrog predicts, which follows all of s."""
        width = 2 * t.nv + t.nu
        adjoint.rates(t, k, w)
        adjoint.leap.swap(t, k, w)
        bent(t, k, w, e, b, HALF)
        adjoint.leap.take(t, w)
        for i in range(t.nv):
            for c in range(width):
                e.cross[b, c] = ZERO
            for j in range(t.nv):
                own = HALF * (e.coriolis[b, i, j] + e.coriolis[b, j, i])
                for c in range(width):
                    e.cross[b, c] = e.cross[b, c] + own * ahead(t, room, b, j, c)
            for r in range(width):
                by = ahead(t, room, b, i, r)
                for c in range(r + 1):
                    e.found[b, r, c] = e.found[b, r, c] + by * e.cross[b, c]
        for r in range(width):
            for c in range(r):
                e.found[b, c, r] = e.found[b, r, c]

    return SimpleNamespace(of_velocities=of_velocities, of_predicted=of_predicted, ahead=ahead)
