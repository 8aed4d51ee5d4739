"""The broad phase: which pairs can act in a step, at a cost that grows with what is near.

Every item (`items.py`) has a bounding disc, centre c and radius R. At a velocity its points move at most at
V = |v_c| + |omega| R, and the rows of a pair, w = J v + d/h with J = J_n +- mu J_t, are at least
(|c_i - c_j| - R_i - R_j)/h - s (V_i + V_j), s = sqrt(1 + mu^2). So pairs with a row at or below cut sigma + a
margin are among those of discs of radius R + h (s V + (cut sigma + margin)/2) that overlap: sorted along the
axis on which the items are spread more, from the order of the last step, and compared while they overlap
there.

A list is made with some more margin than is asked for. After a solve all speeds are compared with those that
it was made for, and only where they use the spare up it is made anew, for the larger of both, so that within
a step it only grows. It depends on states and velocities of the step alone, not on what was before.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...residual.smoothing import make_smoothing
from ...structure import WORLD
from ..motion.mechanism import COLUMN
from ..topology import CONTACT, Topology
from ..work import AXIS_OF_ITEMS, LISTED, V2, V4, WORK, Slot
from .items import AROUND, DIAGONAL, SUM

SPARE = 0.05  # margin beyond what is asked for, in mean radii a step
ROUNDING = 1e-12  # of a disc, relative to its place and size
# what `bound` holds: s, cut sigma, the mean radius, the list's margin, and what speeds have left of it
STEEP, CUT, TYPICAL, MARGIN, LEFT = 0, 1, 2, 3, 4


@cached
def make_sort() -> wp.Function:
    """sort(t, k): k.listed ascending, by two passes of counting over digits."""

    @wp.func
    def count_out(
        k: wp.ref[Slot], source: wp.array(dtype=wp.int32), target: wp.array(dtype=wp.int32), base: int,
        shift: int,
    ):  # fmt: skip
        found = k.count[wp.static(LISTED)]
        for i in range(base + 1):
            k.bucket[i] = 0
        for n in range(found):
            digit = (source[n] >> shift) & (base - 1)
            k.bucket[digit + 1] = k.bucket[digit + 1] + 1
        for i in range(base):
            k.bucket[i + 1] = k.bucket[i + 1] + k.bucket[i]
        for n in range(found):
            digit = (source[n] >> shift) & (base - 1)
            target[k.bucket[digit]] = source[n]
            k.bucket[digit] = k.bucket[digit] + 1

    @wp.func
    def sort(t: wp.ref[Topology], k: wp.ref[Slot]):
        base = 1 << t.pair_bits
        count_out(k, k.listed, k.sorted, base, 0)
        count_out(k, k.sorted, k.listed, base, t.pair_bits)

    return sort


@cached
def make_discs() -> SimpleNamespace:
    """Warp functions of items' discs: `bounding` and `placed`; `moved`, of a body's point."""
    ZERO = WORK(0.0)
    RADIUS = COLUMN["radius"]

    @wp.func
    def bounding(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """A disc around the shapes of item i in its body."""
        start = t.item_shape_start[i]
        end = t.item_shape_start[i + 1]
        x = WORK(0.0)
        y = WORK(0.0)
        for at in range(start, end):
            p = k.shape[t.shapes + t.item_shape[at]]
            x += p[0]
            y += p[1]
        x = x / WORK(end - start)
        y = y / WORK(end - start)
        r = WORK(0.0)
        for at in range(start, end):
            shape = t.item_shape[at]
            p = k.shape[t.shapes + shape]
            one = k.numbers[t.columns[RADIUS] + 2 * shape]
            other = k.numbers[t.columns[RADIUS] + 2 * shape + 1]
            own = wp.max(one, other)
            if t.item_reach[at] == SUM:
                own = one + other
            elif t.item_reach[at] == DIAGONAL:
                own = wp.sqrt(one * one + other * other)
            r = wp.max(r, wp.length(V2(p[0] - x, p[1] - y)) + own)
        return V4(x, y, r, r)

    @wp.func
    def placed(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """The disc of item i in the world."""
        d = k.disc[t.items + i]
        body = t.item_body[i]
        if body == WORLD:
            return d
        f = k.frame[body]
        return V4(f[2] + f[0] * d[0] - f[1] * d[1], f[3] + f[1] * d[0] + f[0] * d[1], d[2], d[2])

    @wp.func
    def moved(k: wp.ref[Slot], body: int, x: WORK, y: WORK):
        """Speed of a point of a body, and its rate of turning, at k.twist."""
        if body == WORLD:
            return V2(ZERO, ZERO)
        f = k.frame[body]
        v = k.twist[body]
        return V2(wp.length(V2(v[0] - v[2] * (y - f[3]), v[1] + v[2] * (x - f[2]))), wp.abs(v[2]))

    return SimpleNamespace(bounding=bounding, placed=placed, moved=moved)


@cached
def make_list() -> wp.Function:
    """list_between(t, k, i, j): the pairs between two items, if any, behind k.listed."""

    @wp.func
    def list_partner(t: wp.ref[Topology], k: wp.ref[Slot], at: int):
        found = k.count[wp.static(LISTED)]
        for e in range(t.item_pair_start[at], t.item_pair_start[at + 1]):
            k.listed[found] = t.item_pair[e]
            found += 1
        k.count[wp.static(LISTED)] = found

    @wp.func
    def list_between(t: wp.ref[Topology], k: wp.ref[Slot], i: int, j: int):
        one = wp.min(i, j)
        other = wp.max(i, j)
        end = t.item_partner_start[one + 1]
        low = t.item_partner_start[one]
        high = int(end)
        at = low + other - one - 1  # where every item has pairs with every other
        if at < end:
            if t.item_partner[at] == other:
                low = int(at)
                high = int(at)
        while low < high:
            at = (low + high) // 2
            if t.item_partner[at] < other:
                low = at + 1
            else:
                high = int(at)
        if low < end:
            if t.item_partner[low] == other:
                list_partner(t, k, low)

    return SimpleNamespace(partner=list_partner, between=list_between)


@cached
def make_broad(residual: str) -> SimpleNamespace:
    """Warp functions: `measure`, for new numbers of a world, `start`, a new state, and `find`, a velocity.

    find(t, k, margin) -> 1 where k.listed, k.count[LISTED] pairs in ascending order, was made anew.
    """
    discs = make_discs()
    put = make_list()
    sort = make_sort()
    ZERO, ONE, HALF, TWO = WORK(0.0), WORK(1.0), WORK(0.5), WORK(2.0)
    NOWHERE, LARGEST = WORK(-1e300), WORK(1e300)
    PART, LOST, FLIP = WORK(SPARE), WORK(ROUNDING), WORK(1.5)
    CUT_OFF = WORK(0.0 if residual == "hard" else make_smoothing(WORK, residual).cut)
    H, SIGMA, FRICTION, RADIUS = (COLUMN[name] for name in ("step_size", "sigma", "friction", "radius"))

    @wp.func
    def measure(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Bounding discs in their bodies, and the largest mu and cut sigma of all pairs."""
        mu = WORK(0.0)
        for pair in range(t.pairs):
            mu = wp.max(mu, k.numbers[t.columns[FRICTION] + pair])
        sigma = WORK(0.0)
        for i in range(t.nr):
            if t.row_kind[i] == wp.static(CONTACT):
                sigma = wp.max(sigma, k.numbers[t.columns[SIGMA] + i])
        k.bound[wp.static(STEEP)] = wp.sqrt(ONE + mu * mu)
        k.bound[wp.static(CUT)] = CUT_OFF * sigma
        total = WORK(0.0)
        for i in range(t.items):
            d = discs.bounding(t, k, i)
            k.disc[t.items + i] = d
            k.item_order[i] = i
            total += d[2]
        k.bound[wp.static(TYPICAL)] = total / WORK(wp.max(t.items, 1))

    @wp.func
    def start(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Discs in the world, and the axis along which they are sorted; no list is made."""
        low = V2(LARGEST, LARGEST)
        high = V2(NOWHERE, NOWHERE)
        for i in range(t.items):
            d = discs.placed(t, k, i)
            k.disc[i] = d
            low = V2(wp.min(low[0], d[0]), wp.min(low[1], d[1]))
            high = V2(wp.max(high[0], d[0]), wp.max(high[1], d[1]))
        wide = high - low
        along = k.count[wp.static(AXIS_OF_ITEMS)]
        if wide[1 - along] > FLIP * wide[along]:
            k.count[wp.static(AXIS_OF_ITEMS)] = 1 - along
        k.bound[wp.static(MARGIN)] = NOWHERE
        k.bound[wp.static(LEFT)] = NOWHERE
        for i in range(t.items + t.planes):
            k.item_speed[i] = V2(ZERO, ZERO)

    @wp.func
    def holds(t: wp.ref[Topology], k: wp.ref[Slot], margin: WORK):
        """1 if the list is good for the speeds at hand; the next one is for at least these."""
        excess = WORK(0.0)
        good = int(1)
        for i in range(t.items + t.planes):
            at = V4()
            if i < t.items:
                at = k.disc[i]
            else:
                foot = k.shape[t.item_shape[t.item_shape_start[i]]]
                at = V4(foot[0], foot[1], ZERO, ZERO)
            now = discs.moved(k, t.item_body[i], at[0], at[1])
            speed = now[0] + now[1] * at[2]
            old = k.item_speed[i]
            excess = wp.max(excess, speed - old[0])
            if not (speed < LARGEST):
                good = 0
            if i >= t.items and not (now[1] <= old[1]):
                good = 0
            k.item_speed[i] = V2(wp.max(speed, old[0]), wp.max(now[1], old[1]))
        left = k.bound[wp.static(LEFT)] - TWO * k.bound[wp.static(STEEP)] * excess
        k.bound[wp.static(LEFT)] = left
        if not (margin <= left):
            good = 0
        return good

    @wp.func
    def arrange(t: wp.ref[Topology], k: wp.ref[Slot], steep: WORK, half: WORK):
        """How far items can act, and the order in which that begins on the axis."""
        along = k.count[wp.static(AXIS_OF_ITEMS)]
        for i in range(t.items):
            d = k.disc[i]
            lost = LOST * (wp.abs(d[0]) + wp.abs(d[1]) + d[2])
            k.disc[i] = V4(d[0], d[1], d[2], d[2] + steep * k.item_speed[i][0] + half + lost)
        for at in range(t.items):
            i = k.item_order[at]
            low = k.disc[i][along] - k.disc[i][3]
            to = int(at)
            while to > 0 and k.item_low[wp.max(to - 1, 0)] > low:
                k.item_low[to] = k.item_low[to - 1]
                k.item_order[to] = k.item_order[to - 1]
                to -= 1
            k.item_low[to] = low
            k.item_order[to] = i

    @wp.func
    def among_items(t: wp.ref[Topology], k: wp.ref[Slot]):
        """List the pairs of items whose discs overlap."""
        along = k.count[wp.static(AXIS_OF_ITEMS)]
        for at in range(t.items):
            i = k.item_order[at]
            d = k.disc[i]
            end = d[along] + d[3]
            to = at + 1
            while to < t.items and not (k.item_low[wp.min(to, t.items - 1)] > end):
                j = k.item_order[to]
                o = k.disc[j]
                both = d[3] + o[3]
                x = o[0] - d[0]
                y = o[1] - d[1]
                if not (x * x + y * y > both * both):
                    put.between(t, k, i, j)
                to += 1

    @wp.func
    def against_planes(t: wp.ref[Topology], k: wp.ref[Slot], steep: WORK, half: WORK):
        """List the pairs of half-planes and rings with the items that come to them."""
        for i in range(t.items, t.items + t.planes):
            at_shape = t.item_shape_start[i]
            shape = t.item_shape[at_shape]
            face = k.shape[shape]
            own = k.item_speed[i]
            lost = LOST * (wp.abs(face[0]) + wp.abs(face[1]))
            for at in range(t.item_partner_start[i], t.item_partner_start[i + 1]):
                j = t.item_partner[at]
                d = k.disc[j]
                x = d[0] - face[0]
                y = d[1] - face[1]
                gap = x * face[2] + y * face[3] - d[3]
                arm = wp.abs(y * face[2] - x * face[3]) + d[2]
                if t.item_reach[at_shape] == AROUND:
                    away = wp.sqrt(x * x + y * y)
                    gap = k.numbers[t.columns[RADIUS] + 2 * shape] - away - d[3]
                    arm = away + d[2]
                if not (gap > steep * (own[0] + own[1] * arm) + half + lost):
                    put.partner(t, k, at)

    @wp.func
    def find(t: wp.ref[Topology], k: wp.ref[Slot], margin: WORK):
        """List the pairs of which a row can come to within `margin` of its cut at k.twist."""
        if holds(t, k, margin) == 1:
            return 0
        h = k.numbers[t.columns[H]]
        wide = wp.max(margin + PART * k.bound[wp.static(TYPICAL)] / h, k.bound[wp.static(MARGIN)])
        k.bound[wp.static(MARGIN)] = wide
        k.bound[wp.static(LEFT)] = wide
        k.count[wp.static(LISTED)] = 0
        steep = h * k.bound[wp.static(STEEP)]
        half = HALF * h * (k.bound[wp.static(CUT)] + wide)
        arrange(t, k, steep, half)
        against_planes(t, k, steep, half)
        among_items(t, k)
        sort(t, k)
        return 1

    @wp.func
    def list_all(t: wp.ref[Topology], k: wp.ref[Slot]):
        """List every pair, whatever the velocity."""
        for pair in range(t.pairs):
            k.listed[pair] = pair
        k.count[wp.static(LISTED)] = t.pairs
        k.bound[wp.static(MARGIN)] = LARGEST
        k.bound[wp.static(LEFT)] = LARGEST

    return SimpleNamespace(measure=measure, start=start, find=find, list_all=list_all)
