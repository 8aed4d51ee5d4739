"""Overlaps that one step need not push out: they leave by no more than a speed, and stay where the rows of
bodies that hang together or touch find no way (M60).

An island may have several parts that neither hang together nor touch: what is near enough to meet in a step
has one. Those whose overlaps have to stay are told by trying (`island.py`).
"""

from types import SimpleNamespace

import warp as wp

from ...contact.problem import COLD
from ...factories import cached
from ..motion.mechanism import COLUMN, make_mechanism
from ..topology import Topology
from ..work import SETTLED, WORK, Island, Slot

LIMITED, STAYS = 1, 2  # of `fixed`: by the speed, by the room that is left
ROOM = 1e-4  # of sigma, where overlaps stay: smoothed rows that oppose each other have no solution without


@cached
def make_overlaps(given: type, residual: str) -> SimpleNamespace:
    """Warp functions: `limited` and `eased`, which a row asks; `divide` and `stay` of an island's parts;
    `forget`.
    """
    hard = residual == "hard"
    ZERO, SHARE, UNUSED = WORK(0.0), WORK(ROOM), WORK(COLD)
    number = make_mechanism(given).number
    SIGMA = COLUMN["sigma"]

    @wp.func
    def limited(t: wp.ref[Topology], rate: WORK):
        """d/h, or by what an overlap is pushed out at most."""
        if t.overlaps == 0:
            return rate
        return wp.max(rate, -t.depenetration_speed)

    @wp.func
    def eased(t: wp.ref[Topology], k: wp.ref[Slot], r: int, gap: WORK, is_limited: bool, rate: WORK):
        """What row r, open by `gap`, adds to J v' where that was `rate`, whether limited or d/h."""
        i = k.row[r]
        k.apart[i] = gap
        room = ZERO + ZERO
        if wp.static(not hard):
            room = SHARE * number(t, k, SIGMA, i)
        if k.count[wp.static(SETTLED)] == 0:
            stays = k.stays[i] > 0 and rate <= room
            k.fixed[i] = wp.where(stays, wp.static(STAYS), wp.where(is_limited, wp.static(LIMITED), 0))
        return wp.where(k.fixed[i] == wp.static(STAYS), room, rate)

    @wp.func
    def name_of(k: wp.ref[Slot], u: int):
        """The unit after which what unit u touches is named."""
        name = int(u)
        while k.queue[name] != name:
            name = k.queue[name]
        return name

    @wp.func
    def closes(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """Whether row r overlaps or touches, or v_free closes it."""
        if k.apart[k.row[r]] <= ZERO:
            return True
        w = k.gap[r]
        at = k.pattern[r]
        for e in range(k.entry[r], k.entry[r + 1]):
            w += wp.dot(k.jac[e], k.vfree[t.row_block[at]])
            at += 1
        return w <= ZERO

    @wp.func
    def units_of(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """The names of the first and the last unit that row r moves."""
        end = k.pattern[r] + k.entry[r + 1] - k.entry[r] - 1
        first = name_of(k, t.block_unit[t.row_block[k.pattern[r]]])
        return first, name_of(k, t.block_unit[t.row_block[end]])

    @wp.func(inline=False)
    def divide(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.stays: the part, 1, 2, ..., that rows are of, of those with overlaps; their number. All stay."""
        for place in range(o.start, o.end):
            u = t.block_unit[k.block[place]]
            k.queue[u] = u
        for r in range(o.row, o.last_row):
            k.stays[k.row[r]] = 0
            first, other = units_of(t, k, r)
            if first != other and closes(t, k, r):
                k.queue[wp.max(first, other)] = wp.min(first, other)
        parts = int(0)
        for r in range(o.row, o.last_row):
            if k.apart[k.row[r]] < ZERO and k.stays[k.row[r]] == 0:
                parts += 1
                name, _other = units_of(t, k, r)
                for s in range(o.row, o.last_row):
                    first, other = units_of(t, k, s)
                    if first == name or other == name:
                        k.stays[k.row[s]] = parts
        return parts

    @wp.func
    def stay(k: wp.ref[Slot], o: Island, part: int, stays: int):
        """The overlaps of a part stay, or are to open (stays = 0); nothing to start from."""
        for r in range(o.row, o.last_row):
            k.z[r] = UNUSED
            i = k.row[r]
            if wp.abs(k.stays[i]) == part:
                k.stays[i] = wp.where(stays == 1, part, -part)

    @wp.func
    def forget(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Nothing stays, as far as is known."""
        for i in range(t.nr):
            k.stays[i] = 0

    return SimpleNamespace(limited=limited, eased=eased, divide=divide, stay=stay, forget=forget)
