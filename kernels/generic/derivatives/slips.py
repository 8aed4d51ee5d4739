"""Which contacts slide at a solved step with Coulomb's friction: the rows of C that their derivatives hold.

A contact slides unless both of its rows press. Contacts of two bodies whose J_t are the same, as of a corner
that several shapes share or of a line that lies on another, slide together or not at all, and what they press
is shared among them in any way: one may press its one row and another one the opposite one. Together they
stick then, and each holds the row that presses. Beside one that sticks by itself the others hold their gaps
alone: its tangent is held once.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..topology import CONTACT, Topology
from ..work import WORK, Slot
from .tables import Slopes

SAME = 1e-9  # of parts of J_t, relative to its largest


@cached
def make_slips() -> SimpleNamespace:
    """mark(t, k, d, b, start, end): d.slides of these acting rows, all of some islands, where Coulomb's
    friction is the law. held_entry(t, k, s, e, slides): entry e of row s of C. first_row(t, k, s): the first
    row of a contact's two; rubs(t, k, s): whether s is one of two.
    """
    ZERO, HALF = WORK(0.0), WORK(0.5)

    @wp.func
    def first_row(t: wp.ref[Topology], k: wp.ref[Slot], s: int):
        """The first row of a contact's two."""
        return wp.where(t.row_sign[k.row[s]] < 0, s - 1, s)

    @wp.func
    def held_entry(t: wp.ref[Topology], k: wp.ref[Slot], s: int, e: int, slides: int):
        if slides == 0:
            return k.jac[k.entry[s] + e]
        first = first_row(t, k, s)
        return HALF * (k.jac[k.entry[first] + e] + k.jac[k.entry[first + 1] + e])

    @wp.func
    def rubs(t: wp.ref[Topology], k: wp.ref[Slot], s: int):
        return t.row_kind[k.row[s]] == CONTACT and t.row_sign[k.row[s]] != 0

    @wp.func
    def tangent(k: wp.ref[Slot], first: int, e: int):
        """Entry e of 2 mu J_t."""
        return k.jac[k.entry[first] + e] - k.jac[k.entry[first + 1] + e]

    @wp.func
    def largest(k: wp.ref[Slot], first: int):
        size = ZERO + ZERO
        for e in range(k.entry[first + 1] - k.entry[first]):
            x = wp.abs(tangent(k, first, e))
            size = wp.max(size, wp.max(x[0], wp.max(x[1], x[2])))
        return size

    @wp.func
    def place(t: wp.ref[Topology], k: wp.ref[Slot], first: int, block: int):
        """The entry of a contact's rows that acts on a block; -1: none."""
        for e in range(k.entry[first + 1] - k.entry[first]):
            if t.row_block[k.pattern[first] + e] == block:
                return e
        return int(-1)

    @wp.func
    def together(t: wp.ref[Topology], k: wp.ref[Slot], one: int, two: int, sign: WORK):
        """Whether J_t of two contacts is the same, or the opposite if `sign` is -1."""
        entries = k.entry[one + 1] - k.entry[one]
        if k.entry[two + 1] - k.entry[two] != entries:
            return int(0)
        size_one = largest(k, one)
        size_two = largest(k, two)
        least = WORK(wp.static(SAME)) * size_one * size_two
        for e in range(entries):
            f = place(t, k, two, t.row_block[k.pattern[one] + e])
            if f < 0:
                return int(0)
            x = wp.abs(size_two * tangent(k, one, e) - sign * size_one * tangent(k, two, f))
            if wp.max(x[0], wp.max(x[1], x[2])) > least:
                return int(0)
        return int(1)

    @wp.func(inline=False)
    def held(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, start: int, end: int, first: int):
        """Whether another contact, one that does not stick by itself, presses against what this one slides
        along.
        """
        plus = k.lam[first] > ZERO
        for r in range(start, end):
            s = d.row[b, r]
            if rubs(t, k, s) and k.lam[s] > ZERO:
                other = first_row(t, k, s)
                sticks = k.lam[other] > ZERO and k.lam[other + 1] > ZERO
                if other != first and not sticks and place(t, k, other, t.row_block[k.pattern[first]]) >= 0:
                    opposite = (s == other) != plus
                    if together(t, k, first, other, wp.where(opposite, WORK(1.0), WORK(-1.0))) == 1:
                        return int(1)
        return int(0)

    @wp.func(inline=False)
    def mark(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, start: int, end: int):
        for r in range(start, end):
            s = d.row[b, r]
            d.slides[b, r] = 0
            if t.coulomb == 1 and rubs(t, k, s):
                first = first_row(t, k, s)
                pressing = int(k.lam[first] > ZERO) + int(k.lam[first + 1] > ZERO)
                if pressing < 2:
                    d.slides[b, r] = 1
                if pressing == 1:
                    d.slides[b, r] = 1 - held(t, k, d, b, start, end, first)

    return SimpleNamespace(first_row=first_row, rubs=rubs, held_entry=held_entry, mark=mark)
