"""Overlaps that one step need not push out: they leave by no more than a speed, and stay where the rows of an
island find no way (M60).
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..topology import Topology
from ..work import SETTLED, WORK, Island, Slot

LIMITED, STAYS = 1, 2  # of `fixed`: by the speed, by the room that is left
ROOM = 1e-4  # of sigma, where overlaps stay: smoothed rows that oppose each other have no solution without


@cached
def make_overlaps(residual: str) -> SimpleNamespace:
    """Warp functions: `limited` and `eased`, which a row asks, `let_stay` and `forget`."""
    hard = residual == "hard"
    ZERO, SHARE = WORK(0.0), WORK(ROOM)

    @wp.func
    def limited(t: wp.ref[Topology], rate: WORK):
        """d/h, or by what an overlap is pushed out at most."""
        if t.overlaps == 0:
            return rate
        return wp.max(rate, -t.depenetration_speed)

    @wp.func
    def room(k: wp.ref[Slot], r: int):
        """What row r adds to J v' where it stays."""
        out = ZERO + ZERO
        if wp.static(not hard):
            out = SHARE * k.sigma[r]
        return out

    @wp.func
    def eased(k: wp.ref[Slot], r: int, gap: WORK, is_limited: bool, rate: WORK):
        """What row r, open by `gap`, adds to J v' where that was `rate`, whether limited or d/h."""
        i = k.row[r]
        k.apart[i] = gap
        if k.count[wp.static(SETTLED)] == 0:
            stays = k.stays[i] == 1 and rate <= room(k, r)
            k.fixed[i] = wp.where(stays, wp.static(STAYS), wp.where(is_limited, wp.static(LIMITED), 0))
        return wp.where(k.fixed[i] == wp.static(STAYS), room(k, r), rate)

    @wp.func
    def let_stay(k: wp.ref[Slot], o: Island):
        """The overlaps of an island stay in this step; 1 if there are some that did not."""
        found = int(0)
        for r in range(o.row, o.last_row):
            k.stays[k.row[r]] = 1
            if k.gap[r] < room(k, r):
                found = int(1)
        return found

    @wp.func
    def forget(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Nothing stays, as far as is known."""
        for i in range(t.nr):
            k.stays[i] = 0

    return SimpleNamespace(limited=limited, eased=eased, let_stay=let_stay, forget=forget)
