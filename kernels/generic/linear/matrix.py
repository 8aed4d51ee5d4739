"""M + J' W J of an island, assembled by groups of rows, and J' times impulses.

A group's rows act on the same blocks: what they add to a block is summed up in registers before it is stored.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..topology import Topology
from ..work import M33, V3, WORK, Island, Slot
from .envelope import make_envelope


@cached
def make_matrix() -> SimpleNamespace:
    """Warp functions: assemble(t, k, o), add_pushes(t, k, o), and those of one group of rows."""
    dtype = WORK
    env = make_envelope()

    @wp.func
    def ends(t: wp.ref[Topology], k: wp.ref[Slot], g: int):
        """A group's first row and the one after its last; the first entry of J and how many a row has; its
        first and last blocks. Most groups have one or two, whose sums are kept in registers.
        """
        start = k.group[g]
        entry = k.entry[start]
        entries = k.entry[start + 1] - entry
        pattern = k.pattern[start]
        return start, k.group[g + 1], entry, entries, t.row_block[pattern], t.row_block[pattern + entries - 1]

    @wp.func
    def couple(k: wp.ref[Slot], start: int, end: int, entries: int, e: int, f: int):
        """J' W J of a group's rows for two of its blocks."""
        a, b, c = dtype(0.0), dtype(0.0), dtype(0.0)
        d, g, h = dtype(0.0), dtype(0.0), dtype(0.0)
        p, q, s = dtype(0.0), dtype(0.0), dtype(0.0)
        at = k.entry[start]
        for r in range(start, end):
            left = k.weight[r] * k.jac[at + e]
            right = k.jac[at + f]
            a += left[0] * right[0]
            b += left[0] * right[1]
            c += left[0] * right[2]
            d += left[1] * right[0]
            g += left[1] * right[1]
            h += left[1] * right[2]
            p += left[2] * right[0]
            q += left[2] * right[1]
            s += left[2] * right[2]
            at += entries
        return M33(a, b, c, d, g, h, p, q, s)

    @wp.func
    def stiffen(k: wp.ref[Slot], start: int, end: int, entries: int, e: int):
        """The same for one of its blocks."""
        a, b, c = dtype(0.0), dtype(0.0), dtype(0.0)
        g, h, s = dtype(0.0), dtype(0.0), dtype(0.0)
        at = k.entry[start] + e
        for r in range(start, end):
            right = k.jac[at]
            left = k.weight[r] * right
            a += left[0] * right[0]
            b += left[0] * right[1]
            c += left[0] * right[2]
            g += left[1] * right[1]
            h += left[1] * right[2]
            s += left[2] * right[2]
            at += entries
        return M33(a, b, c, b, g, h, c, h, s)

    @wp.func(inline=False)
    def assemble(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """M + J' W J: what a pair of bodies' rows add is summed up before it is stored."""
        for place in range(o.start, o.end):
            at = k.at[place]
            b = k.block[place]
            own = place - b + t.mass_first[b]
            for j in range(k.first[place], own):
                k.factor[at + j] = M33()
            for j in range(own, place + 1):
                k.factor[at + j] = k.mass[t.mass_at[b] + j + b - place]
        for g in range(o.group, o.last_group):
            start, end, entry, entries, _one, _two = ends(t, k, g)
            pattern = k.pattern[start]
            for e in range(entries):
                one = k.place[t.row_block[pattern + e]]
                k.factor[k.at[one] + one] = k.factor[k.at[one] + one] + stiffen(k, start, end, entries, e)
                for f in range(e):
                    two = k.place[t.row_block[pattern + f]]
                    total = couple(k, start, end, entries, e, f)
                    if one < two:
                        k.factor[k.at[two] + one] = k.factor[k.at[two] + one] + wp.transpose(total)
                    else:
                        k.factor[k.at[one] + two] = k.factor[k.at[one] + two] + total

    @wp.func
    def turn_group(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        g: int,
        x: wp.ref[wp.array(dtype=V3)],
        out: wp.ref[wp.array(dtype=WORK)],
    ):
        """J x of a group's acting rows."""
        start, end, entry, entries, one, two = ends(t, k, g)
        v = x[one]
        u = V3()
        if entries == 2:
            u = x[two]
        at = entry + 0
        for r in range(start, end):
            if k.acting[r] > 0:
                change = wp.dot(k.jac[at], v)
                if entries <= 2:
                    change += wp.dot(k.jac[at + entries - 1], u)
                else:
                    pattern = k.pattern[r]
                    for e in range(1, entries):
                        change += wp.dot(k.jac[at + e], x[t.row_block[pattern + e]])
                out[r] = change
            at += entries

    @wp.func(inline=False)
    def push_group(t: wp.ref[Topology], k: wp.ref[Slot], g: int):
        """k.move += J' k.weight of a group's rows."""
        start, end, entry, entries, _one, _two = ends(t, k, g)
        for e in range(entries):
            x, y, z = dtype(0.0), dtype(0.0), dtype(0.0)
            at = entry + e
            for r in range(start, end):
                push = k.weight[r] * k.jac[at]
                x += push[0]
                y += push[1]
                z += push[2]
                at += entries
            b = t.row_block[k.pattern[start] + e]
            k.move[b] = k.move[b] + V3(x, y, z)

    @wp.func
    def add_pushes(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.move += J' k.weight of all rows."""
        for g in range(o.group, o.last_group):
            push_group(t, k, g)

    return SimpleNamespace(
        env=env,
        ends=ends,
        assemble=assemble,
        turn_group=turn_group,
        push_group=push_group,
        add_pushes=add_pushes,
    )
