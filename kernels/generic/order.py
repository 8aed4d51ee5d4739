"""The order of a world's problem, made from its near pairs whenever their list changes.

Units that near pairs connect are an *island*, a problem of its own. Inside an island the units are in reverse
order of Cuthill and McKee, from an end of their graph, so that M + J' W J has a narrow envelope; where that
needs more room than there is, in the static order, whose envelope with all pairs there is room for. Rows are
grouped by the blocks they act on: what a body exchanges with another one is summed up before it is stored.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import COLD
from ..factories import cached
from .topology import CONTACT, Topology
from .work import GROUPS, ISLANDS, NEAR, ORDERS, ROWS, WORK, Slot

UNTOUCHED, WAITING, SEEN = -1, -2, -3  # instead of a unit's island


@cached
def make_order() -> SimpleNamespace:
    """rearrange(t, k): islands, the order of elimination and rows from k.near."""
    UNUSED = WORK(COLD)

    @wp.func
    def keep_warm(t: wp.ref[Topology], k: wp.ref[Slot]):
        """z of rows that stay to the scene's rows; the list of pairs in ascending order."""
        for r in range(k.count[wp.static(ROWS)]):
            i = k.row[r]
            stays = t.row_kind[i] != wp.static(CONTACT)
            if not stays:
                stays = k.known[t.row_index[i]] > 0
            if stays:
                k.warm[i] = k.z[r]
        for n in range(1, k.count[wp.static(NEAR)]):
            pair = k.near[n]
            at = int(n)
            while at > 0 and k.near[wp.max(at - 1, 0)] > pair:
                k.near[at] = k.near[at - 1]
                at -= 1
            k.near[at] = pair

    @wp.func
    def link(k: wp.ref[Slot], u: int, other: int):
        """An arrow of the graph, once."""
        start = k.island_group[u]
        new = int(1)
        for e in range(start, start + k.at[u]):
            if k.link[e] == other:
                new = 0
        if new == 1:
            k.link[start + k.at[u]] = other
            k.at[u] = k.at[u] + 1

    @wp.func
    def graph(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Which units near pairs connect; a unit's neighbours, from k.island_group on in k.link, by their own
        number of neighbours.
        """
        for u in range(t.units + 1):
            k.island_group[u] = 0
            if u < t.units:
                k.at[u] = 0
        for u in range(t.units):
            k.island[u] = wp.static(UNTOUCHED)
        for n in range(t.limits):
            k.island[t.block_unit[t.row_block[t.row_start[t.limit_row[n]]]]] = wp.static(WAITING)
        for n in range(k.count[wp.static(NEAR)]):
            for side in range(2):
                u = t.pair_unit[2 * k.near[n] + side]
                if u >= 0:
                    k.island[u] = wp.static(WAITING)
                    k.island_group[u + 1] = k.island_group[u + 1] + 1
        for u in range(t.units):
            k.island_group[u + 1] = k.island_group[u + 1] + k.island_group[u]
        for n in range(k.count[wp.static(NEAR)]):
            one = t.pair_unit[2 * k.near[n]]
            two = t.pair_unit[2 * k.near[n] + 1]
            if one >= 0 and two >= 0 and one != two:
                link(k, one, two)
                link(k, two, one)
        for u in range(t.units):
            start = k.island_group[u]
            for e in range(start + 1, start + k.at[u]):
                other = k.link[e]
                at = int(e)
                while at > start and k.at[k.link[wp.max(at - 1, 0)]] > k.at[other]:
                    k.link[at] = k.link[at - 1]
                    at -= 1
                k.link[at] = other

    @wp.func
    def spread(k: wp.ref[Slot], start: int, begin: int, mark: int):
        """Queue what hangs together with `start`, nearest first; the queue's end."""
        k.queue[begin] = start
        k.island[start] = mark
        head = int(begin)
        end = begin + 1
        while head < end:
            u = k.queue[head]
            head += 1
            for e in range(k.island_group[u], k.island_group[u] + k.at[u]):
                other = k.link[e]
                if k.island[other] != mark:
                    k.island[other] = mark
                    k.queue[end] = other
                    end += 1
        return end

    @wp.func
    def islands(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Queue the units of one island after the other, the farthest first; k.island_block: its borders."""
        found = int(0)
        queued = int(0)
        for s in range(t.units):
            if k.island[s] == wp.static(WAITING):
                k.island_block[found] = queued
                start = int(s)
                end = int(0)
                for look in range(2):
                    end = spread(k, start, queued, wp.where(look == 0, wp.static(SEEN), found))
                    start = k.queue[end - 1]
                for n in range((end - queued) // 2):
                    last = k.queue[end - 1 - n]
                    k.queue[end - 1 - n] = k.queue[queued + n]
                    k.queue[queued + n] = last
                queued = end
                found += 1
        k.island_block[found] = queued
        k.count[wp.static(ISLANDS)] = found

    @wp.func
    def places(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Places of the blocks in the order of the queue; k.island_block becomes one of blocks."""
        place = int(0)
        at = int(0)
        for i in range(k.count[wp.static(ISLANDS)]):
            end = k.island_block[i + 1]
            k.island_block[i] = place
            while at < end:
                u = k.queue[at]
                at += 1
                for b in range(t.unit_start[u], t.unit_start[u + 1]):
                    k.place[b] = place
                    k.block[place] = b
                    place += 1
        k.island_block[k.count[wp.static(ISLANDS)]] = place

    @wp.func
    def static_order(t: wp.ref[Topology], k: wp.ref[Slot]):
        """The queue in the order of the units' numbers, island by island."""
        queued = int(0)
        for i in range(k.count[wp.static(ISLANDS)]):
            k.island_block[i] = queued
            for u in range(t.units):
                if k.island[u] == i:
                    k.queue[queued] = u
                    queued += 1
        k.island_block[k.count[wp.static(ISLANDS)]] = queued

    @wp.func
    def begins(t: wp.ref[Topology], k: wp.ref[Slot], n: int):
        """First row of the n-th limit or, after the limits, near pair."""
        if n < t.limits:
            return t.limit_row[n]
        return t.pair_row[k.near[n - t.limits]]

    @wp.func
    def island_of(t: wp.ref[Topology], k: wp.ref[Slot], n: int):
        """The island of the n-th limit or near pair."""
        if n < t.limits:
            return k.island[t.block_unit[t.row_block[t.row_start[t.limit_row[n]]]]]
        pair = k.near[n - t.limits]
        return k.island[wp.max(t.pair_unit[2 * pair], t.pair_unit[2 * pair + 1])]

    @wp.func
    def sort_rows(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.sorted: what begins a pair or is a limit, by islands; k.island_group: where each begins there."""
        found = k.count[wp.static(ISLANDS)]
        items = t.limits + k.count[wp.static(NEAR)]
        for i in range(found + 1):
            k.island_group[i] = 0
        for n in range(items):
            i = island_of(t, k, n)
            k.island_group[i + 1] = k.island_group[i + 1] + 1
        for i in range(found):
            k.island_group[i + 1] = k.island_group[i + 1] + k.island_group[i]
        for n in range(items):
            i = island_of(t, k, n)
            k.sorted[k.island_group[i]] = begins(t, k, n)
            k.island_group[i] = k.island_group[i] + 1
        for n in range(found):
            i = found - n
            k.island_group[i] = k.island_group[i - 1]
        k.island_group[0] = 0

    @wp.func
    def add_row(t: wp.ref[Topology], k: wp.ref[Slot], r: int, i: int, entry: int):
        """Row r is row i of the scene; where the next one's entries begin."""
        k.row[r] = i
        k.pattern[r] = t.row_start[i]
        k.entry[r] = entry
        k.z[r] = k.warm[i]
        k.warm[i] = UNUSED
        return entry + t.row_start[i + 1] - t.row_start[i]

    @wp.func
    def rows(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Rows in the order of k.sorted, and their groups; k.island_group becomes one of groups."""
        r = int(0)
        groups = int(0)
        entry = int(0)
        at = int(0)
        for i in range(k.count[wp.static(ISLANDS)]):
            end = k.island_group[i + 1]
            k.island_group[i] = groups
            key = int(-1)
            while at < end:
                first = k.sorted[at]
                at += 1
                if t.row_key[first] != key:
                    key = t.row_key[first]
                    k.group[groups] = r
                    groups += 1
                last = first + 1
                if t.row_kind[first] == wp.static(CONTACT):
                    last = t.pair_row[t.row_index[first] + 1]
                for row in range(first, last):
                    entry = add_row(t, k, r, row, entry)
                    r += 1
        k.island_group[k.count[wp.static(ISLANDS)]] = groups
        k.group[groups] = r
        k.entry[r] = entry
        k.count[wp.static(ROWS)] = r
        k.count[wp.static(GROUPS)] = groups

    @wp.func
    def envelope(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.first and k.at of M + J' W J; the blocks in it."""
        blocks = k.island_block[k.count[wp.static(ISLANDS)]]
        for p in range(blocks):
            k.first[p] = k.place[t.mass_first[k.block[p]]]
        for g in range(k.count[wp.static(GROUPS)]):
            i = k.row[k.group[g]]
            start = t.row_start[i]
            end = t.row_start[i + 1]
            first = blocks
            for e in range(start, end):
                first = wp.min(first, k.place[t.row_block[e]])
            for e in range(start, end):
                p = k.place[t.row_block[e]]
                k.first[p] = wp.min(k.first[p], first)
        used = int(0)
        for p in range(blocks):
            k.at[p] = used - k.first[p]
            used += p - k.first[p] + 1
        return used

    @wp.func(inline=False)
    def rearrange(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Islands, the order of elimination, rows and groups anew; rows that stay keep z."""
        k.count[wp.static(ORDERS)] = 1
        keep_warm(t, k)
        graph(t, k)
        islands(t, k)
        sort_rows(t, k)
        rows(t, k)
        more = int(1)
        orders = int(0)
        while more == 1:
            places(t, k)
            orders += 1
            more = int(0)
            if envelope(t, k) > t.room and orders == 1:
                static_order(t, k)
                more = 1

    return SimpleNamespace(rearrange=rearrange)
