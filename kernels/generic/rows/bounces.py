"""Pairs that bounce: J_n v' + e J_n v in place of d/h where a contact closes in this step."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..motion.mechanism import COLUMN, make_mechanism
from ..topology import CONTACT, Topology
from ..work import NEAR, V3, WORK, Island, Slot


@cached
def make_bounces(given: type) -> SimpleNamespace:
    """Warp functions: `bounced`, which a row asks, `normal_rate`, `forget` and `give_up`."""
    dtype = WORK
    number = make_mechanism(given).number
    RESTITUTION = COLUMN["restitution"]
    ZERO, ONE, TWO = dtype(0.0), dtype(1.0), dtype(2.0)

    @wp.func
    def normal_rate(
        t: wp.ref[Topology], k: wp.ref[Slot], pair: int, r: int, x: wp.ref[wp.array(dtype=V3)], start: int
    ):
        """J_n x of a pair whose first row is r, x from `start` on."""
        out = dtype(0.0)
        rows = t.pair_row[pair + 1] - t.pair_row[pair]
        for i in range(r, r + rows):
            at = k.pattern[i]
            for e in range(k.entry[i], k.entry[i + 1]):
                out += wp.dot(k.jac[e], x[start + t.row_block[at]])
                at += 1
        return out / dtype(rows)

    @wp.func(inline=False)
    def bounced(t: wp.ref[Topology], k: wp.ref[Slot], pair: int, r: int, rate: dtype):
        """What the rows of a pair add to J v': d/h, or e J_n v where the pair closes in this step (M54),
        faster than what forces change of that in two steps, by which what lies still does.
        """
        if k.bounce[pair] < ZERO:  # there is no room for it in this step
            return rate
        k.bounce[pair] = ZERO
        e = wp.min(number(t, k, RESTITUTION, pair), ONE)
        if not (e > ZERO):
            return rate
        meets = normal_rate(t, k, pair, r, k.before, 0)
        free = wp.where(t.limited > 0, t.blocks, 0)  # where forces with a limit lead without contact
        change = normal_rate(t, k, pair, r, k.vfree, free) - meets
        if not (rate + meets + change <= ZERO and -meets > TWO * wp.abs(change)):
            return rate
        k.bounce[pair] = e
        return e * meets

    @wp.func
    def forget(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Of the step before."""
        for n in range(k.count[wp.static(NEAR)]):
            k.bounce[k.near[n]] = ZERO

    @wp.func
    def give_up(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """No pair of an island bounces in this step; 1 if one did."""
        found = int(0)
        for r in range(o.row, o.last_row):
            i = k.row[r]
            if t.row_kind[i] == wp.static(CONTACT):
                pair = t.row_index[i]
                if k.bounce[pair] > ZERO:
                    found = int(1)
                k.bounce[pair] = -ONE
        return found

    @wp.func
    def allow(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Pairs of an island may bounce again."""
        for r in range(o.row, o.last_row):
            i = k.row[r]
            if t.row_kind[i] == wp.static(CONTACT):
                k.bounce[t.row_index[i]] = ZERO

    return SimpleNamespace(
        bounced=bounced, normal_rate=normal_rate, forget=forget, allow=allow, give_up=give_up
    )
