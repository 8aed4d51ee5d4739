"""Which contacts stick in a derivative with Coulomb's friction where not all that did can: at a kink.

Bodies that lie still may be stuck by more contacts than they can follow (`agreement.py`): of a chain along a
plane that is moved a little some links slide and others stick. A vertex (`vertex.py`) tells which slide
first, but drops normals, too, where contacts are many. So gaps come first: all contacts slide that touched at
rest and hold J_n, those that the vertex gave up as well. Then they stick one after the other, or several at
once, those that do so at the vertex first and then those that carry most, as long as bodies can follow. Where
gaps alone disagree the vertex stays what counts.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..topology import Topology
from ..work import WORK, Island, Slot
from .slips import make_slips
from .tables import Slopes

UNSURE = 1e-6  # of what a row pressed: less at a vertex does not tell which way its contact slides
FIRST = 1e100  # what makes contacts that stick at a vertex carry more than others


@cached
def make_sticking() -> SimpleNamespace:
    """Of the rows of an island, which begin at `start` of the list of acting ones: remember(t, k, d, b, o,
    start) in k.miss what sticks, before a vertex is looked for (what presses is in k.least); loosen(...) all
    and hold gaps; restore(...) the vertex. try_next(..., most): so many contacts more stick, or how many
    there are; decide(..., agrees, count): they keep to that if that agrees, are tried again if several.
    """
    slips = make_slips()
    ZERO, ONE, BEFORE, LITTLE = WORK(0.0), WORK(1.0), WORK(FIRST), WORK(UNSURE)

    @wp.func
    def press(k: wp.ref[Slot], s: int, presses: int):
        k.p[s] = WORK(presses)
        k.slack[s] = ONE - WORK(presses)

    @wp.func
    def carried(t: wp.ref[Topology], k: wp.ref[Slot], s: int):
        """The row of a contact that presses if it slides: as the vertex has it, or where more pressed."""
        first = slips.first_row(t, k, s)
        one = k.lam[first] + LITTLE * k.least[first]
        two = k.lam[first + 1] + LITTLE * k.least[first + 1]
        return wp.where(one >= two, first, first + 1)

    @wp.func(inline=False)
    def remember(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int):
        r = start + 0
        for s in range(o.row, o.last_row):
            k.miss[s] = ZERO
            if k.acting[s] > 0:
                if d.slides[b, r] == 0 and slips.rubs(t, k, s):
                    first = slips.first_row(t, k, s)
                    k.miss[first] = k.lam[first] + k.lam[first + 1]
                r += 1

    @wp.func(inline=False)
    def loosen(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int):
        r = start + 0
        for s in range(o.row, o.last_row):
            if k.acting[s] > 0:
                if not slips.rubs(t, k, s):
                    press(k, s, wp.where(k.least[s] > ZERO, 1, 0))
                else:
                    first = slips.first_row(t, k, s)
                    if d.slides[b, r] == 0 and k.miss[first] > ZERO and k.miss[first] < BEFORE:
                        k.miss[first] = k.miss[first] + BEFORE
                    d.slides[b, r] = 1
                    carries = k.least[first] + k.least[first + 1] > ZERO and carried(t, k, s) == s
                    press(k, s, wp.where(carries, 1, 0))
                r += 1

    @wp.func(inline=False)
    def restore(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        for s in range(o.row, o.last_row):
            k.miss[s] = ZERO
            if k.acting[s] > 0:
                holds = k.lam[s] > ZERO
                if slips.rubs(t, k, s):
                    first = slips.first_row(t, k, s)
                    if k.lam[first] == ZERO or k.lam[first + 1] == ZERO:
                        holds = k.lam[first] + k.lam[first + 1] > ZERO and carried(t, k, s) == s
                press(k, s, wp.where(holds, 1, 0))

    @wp.func
    def set_slides(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int, first: int,
                   slides: int):  # fmt: skip
        r = start + 0
        for s in range(o.row, o.last_row):
            if k.acting[s] > 0:
                if s == first or s == first + 1:
                    d.slides[b, r] = slides
                    if slides == 0:
                        press(k, s, wp.where(k.least[s] > ZERO, 1, 0))
                    else:
                        press(k, s, wp.where(carried(t, k, s) == s, 1, 0))
                r += 1

    @wp.func
    def best(k: wp.ref[Slot], o: Island):
        """The first row of the contact to be tried next, -1: none."""
        found = int(-1)
        most = ZERO + ZERO
        for s in range(o.row, o.last_row):
            if k.miss[s] > most:
                most = k.miss[s]
                found = s + 0
        return found

    @wp.func(inline=False)
    def try_next(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int, most: int):
        count = int(0)
        while count < most:
            s = best(k, o)
            if s < 0:
                return count
            k.miss[s] = -k.miss[s]
            set_slides(t, k, d, b, o, start, s, 0)
            count += 1
        return count

    @wp.func(inline=False)
    def decide(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        d: Slopes,
        b: int,
        o: Island,
        start: int,
        agrees: int,
        count: int,
    ):
        for s in range(o.row, o.last_row):
            if k.miss[s] < ZERO:
                if agrees == 0:
                    set_slides(t, k, d, b, o, start, s, 1)
                k.miss[s] = wp.where(agrees == 0 and count > 1, -k.miss[s], ZERO)

    return SimpleNamespace(
        remember=remember, loosen=loosen, restore=restore, try_next=try_next, decide=decide
    )
