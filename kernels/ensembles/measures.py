"""Measures of a world while it runs: reductions of signals over the steps, all of them data.

Signals, conditions and measures are tables (`Measures`), so that one kernel serves every task; functions of
users are compiled in where there are some. A world keeps WIDTH numbers a measure between two steps.
"""

from types import SimpleNamespace
from typing import Any, NamedTuple

import warp as wp

from ..control.cost_points import make_reach
from ..factories import cached
from .contacts import FAR, TOUCH
from .disturbances import ROUNDING, SINGLE
from .users import chained, make_price

SIGNALS = (  # from "slip" on those whose code is where a measure asks for them, all but the last of contacts
    *("state", "cosine", "control", "time", "contact", "gap", "impulse", "function", "cost"),
    *("point", "distance", "slip", "tangential_impulse", "normal_force", "tangential_force"),
    "tendon_force",
    "sum",
)
(STATE, COSINE, CONTROL, TIME, CONTACT, GAP, IMPULSE, FUNCTION, COST, POINT, DISTANCE, SLIP, RUB, FORCE,
 RUBBING, PULL, SUM) = range(len(SIGNALS))  # fmt: skip
REDUCTIONS = (
    *("initial", "final", "rate", "mean", "integral", "total", "largest", "smallest", "accumulated"),
    *("share_of_time", "first_time", "settled", "count", "rms"),
)
(INITIAL, FINAL, RATE, MEAN, INTEGRAL, TOTAL, LARGEST, SMALLEST, ACCUMULATED,
 SHARE, FIRST, SETTLED, COUNT, RMS) = range(len(REDUCTIONS))  # fmt: skip
WIDTH = 5  # value, number of values, a second value and two times
ABSOLUTE, SINCE, BOTH = 1, 2, 3  # how a signal is taken: absolute, less its value at the start
NONE = -1  # no state to take off


class Users(NamedTuple):
    """What measures need that others do without: functions of signals, by their place; the task's cost."""

    functions: tuple[wp.Function, ...] = ()
    cost: Any = None  # CostFunctions, where a measure is of the cost
    relative: bool = False  # whether a signal is absolute, or less its value at the start
    gaps: bool = False  # whether a signal is a gap, which is then known of all pairs in every step
    points: bool = False  # whether a signal is of a point of a body
    slips: bool = False  # whether a signal is how fast a pair slides, which is then known of those that push
    forces: bool = False  # whether a signal is a force, impulse over step size
    rubs: bool = False  # whether a signal is tangential, impulse or force
    scattered: bool = False  # whether a signal is of pairs that are not one after the other
    pulls: bool = False  # whether a signal is how hard a tendon pulls
    where: bool = False  # whether a measure counts the steps of a condition alone
    sums: bool = False  # whether a signal is a sum of products of others


NO_USERS = Users()


@cached
def make_tables(dtype: type) -> type:
    """Struct of what is looked at: S signals; C clauses in all conditions, A comparisons; M measures."""

    @wp.struct
    class Measures:
        # (S, 5): kind, place or first pair, state to take off or end of the pairs, how, measure to take off;
        # of a sum: kind, its terms from, to in `ranges`, how, where in `bounds` that of row 0 has its weight
        signal: wp.array2d(dtype=wp.int32)
        since: int  # of the last measures, which come first in a step: what relative signals began with
        bounds: wp.array2d(dtype=wp.float64)  # (A, 2): low, high; before them weights of sums' terms
        compared: wp.array(dtype=wp.int32)  # (A,): its signal
        clause: wp.array2d(dtype=wp.int32)  # (C, 2): first comparison of a clause, and one after the last
        # (M, 7): reduction, signal or NONE, its clauses from, to, 1: always, clauses where it counts from, to
        measure: wp.array2d(dtype=wp.int32)
        window: wp.array2d(dtype=wp.float64)  # (M, 2): start, end [s]
        # (R, 2): first pair and end, where a signal's pairs are ranges of these, with `Users.scattered`; of a
        # term of a sum the signals that it is a product of, NONE: no more
        ranges: wp.array2d(dtype=wp.int32)
        ends: int  # measure, a first time, that ends a world; NONE: none does
        weights: wp.array2d(dtype=dtype)  # (1, P) of the cost
        points: wp.array2d(dtype=dtype)  # (1, P) as in a cost of no terms (control/cost_points.py)

    return Measures


def make_measures(
    nx: int, nu: int, dtype: type, contacts: SimpleNamespace, users: Users = NO_USERS
) -> SimpleNamespace:
    """look(m, kept, i, time, h, x, u, contacts, last): takes a step of world i into account.

    `last` is 1 after the last step, with the last state. `kept` (B, M, WIDTH) begins at zero and holds in the
    end what a measure's value is made of. ended(m, kept, i): whether world i has met what ends it.

    Args:
        nx: states.
        nu: controls.
        dtype: of states and controls.
        contacts: struct `Contacts` of a step's contacts and what reads it, in float64, of the pairs first,
            ..., end - 1: `push(c, first, end)`, the largest normal impulse; `impulse(c, first, end)`, their
            sum; `gap(c, first, end)`, the lowest distance, FAR where there is no pair; `slip(c, first, end)`,
            the fastest; `rub(c, first, end)`, tangential impulses together; `pull(c, i)` of tendon i.
        users: their functions are (x, u, time), of signals of kind FUNCTION.
    """
    Measures = make_tables(dtype)
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)
    Contacts = contacts.Contacts
    ZERO, ONE = wp.float64(0.0), wp.float64(1.0)
    EPS, PART = wp.float64(ROUNDING), wp.float64(SINGLE)
    place = make_reach(dtype, VX).value if users.points else None
    user, price = chained(users.functions, VX, VU), make_price(users.cost, VX, VU, dtype)

    @wp.func
    def coordinate(m: Measures, which: int, x: VX):
        """Of a point of a body."""
        if wp.static(users.points):
            return wp.float64(place(m.points, 0, which, x))
        return ZERO

    @wp.func
    def joined(m: Measures, s: int, c: Contacts):
        """A signal of contacts, of several ranges of pairs."""
        kind = m.signal[s, 0]
        out = wp.where(kind == wp.static(GAP), wp.float64(wp.static(FAR)), wp.float64(0.0))
        for n in range(m.signal[s, 1], m.signal[s, 2]):
            first, end = m.ranges[n, 0], m.ranges[n, 1]
            if kind == wp.static(CONTACT):
                out = wp.max(out, contacts.push(c, first, end))
            elif kind == wp.static(GAP):
                out = wp.min(out, contacts.gap(c, first, end))
            elif kind == wp.static(IMPULSE) or kind == wp.static(FORCE):
                out += contacts.impulse(c, first, end)
            elif kind == wp.static(SLIP):
                slip = contacts.slip(c, first, end)
                out = wp.where(wp.abs(slip) > wp.abs(out), slip, out)
            else:
                out += contacts.rub(c, first, end)
        return out

    @wp.func
    def of_contacts(m: Measures, s: int, h: wp.float64, c: Contacts):
        """A signal of contacts, where they are scattered, or it is none of the plain ones."""
        kind, first, end = m.signal[s, 0], m.signal[s, 1], m.signal[s, 2]
        value = wp.float64(0.0)
        if wp.static(users.scattered):
            value = joined(m, s, c)
        elif kind == wp.static(SLIP):
            value = contacts.slip(c, first, end)
        elif kind == wp.static(FORCE):
            value = contacts.impulse(c, first, end)
        else:
            value = contacts.rub(c, first, end)
        if kind == wp.static(CONTACT):
            value = wp.where(value > wp.float64(TOUCH), ONE, ZERO)
        if kind == wp.static(FORCE) or kind == wp.static(RUBBING):
            value = value / h
        return value

    @wp.func
    def plain(m: Measures, s: int, x: VX, u: VU, time: wp.float64, h: wp.float64, last: int, c: Contacts):
        """A signal as it is."""
        kind, place = m.signal[s, 0], m.signal[s, 1]
        if kind == wp.static(STATE):
            value = x[place]
            if m.signal[s, 2] != wp.static(NONE):
                value -= x[m.signal[s, 2]]
            return wp.float64(value)
        if kind == wp.static(COSINE):
            return wp.cos(wp.float64(x[place]))
        if kind == wp.static(CONTROL):
            return wp.float64(u[place])
        if kind == wp.static(TIME):
            return time
        if wp.static(users.scattered):
            if kind == wp.static(CONTACT) or kind == wp.static(GAP) or kind == wp.static(IMPULSE):
                return of_contacts(m, s, h, c)
        if kind == wp.static(CONTACT):
            return wp.where(contacts.push(c, place, m.signal[s, 2]) > wp.float64(TOUCH), ONE, ZERO)
        if kind == wp.static(GAP):
            return contacts.gap(c, place, m.signal[s, 2])
        if kind == wp.static(IMPULSE):
            return contacts.impulse(c, place, m.signal[s, 2])
        if wp.static(users.pulls):
            if kind == wp.static(PULL):
                return contacts.pull(c, place)
        if wp.static(users.slips or users.forces or users.rubs):
            if kind >= wp.static(SLIP):
                return of_contacts(m, s, h, c)
        if wp.static(users.points):
            if kind == wp.static(POINT):
                return coordinate(m, place, x) - wp.where(
                    m.signal[s, 2] == wp.static(NONE), ZERO, coordinate(m, wp.max(m.signal[s, 2], 0), x)
                )
            if kind == wp.static(DISTANCE):
                across = coordinate(m, place, x) - coordinate(m, m.signal[s, 2], x)
                up = coordinate(m, place + 1, x) - coordinate(m, m.signal[s, 2] + 1, x)
                return wp.sqrt(across * across + up * up)
        if wp.static(users.cost is not None):
            if kind == wp.static(COST):
                return price(m.weights, x, u, int(wp.round(time / h)), last)
        return user(place, x, u, time)

    @wp.func
    def single(
        m: Measures,
        kept: wp.array3d(dtype=wp.float64),
        i: int,
        s: int,
        x: VX,
        u: VU,
        time: wp.float64,
        h: wp.float64,
        last: int,
        c: Contacts,
    ):
        """A signal that is no sum."""
        value = plain(m, s, x, u, time, h, last, c)
        if wp.static(users.relative):
            how = m.signal[s, 3]
            if how == wp.static(SINCE) or how == wp.static(BOTH):
                value -= kept[i, m.signal[s, 4], 0]
            if how == wp.static(ABSOLUTE) or how == wp.static(BOTH):
                value = wp.abs(value)
        return value

    @wp.func
    def summed(
        m: Measures,
        kept: wp.array3d(dtype=wp.float64),
        i: int,
        s: int,
        x: VX,
        u: VU,
        time: wp.float64,
        h: wp.float64,
        last: int,
        c: Contacts,
    ):
        if m.signal[s, 0] != wp.static(SUM):
            return single(m, kept, i, s, x, u, time, h, last, c)
        total = wp.float64(0.0)
        first, end = m.signal[s, 1], m.signal[s, 2]
        for n in range(first, end):
            term = m.bounds[n + m.signal[s, 4], 0]
            for j in range(2):
                if m.ranges[n, j] != wp.static(NONE):
                    term *= single(m, kept, i, m.ranges[n, j], x, u, time, h, last, c)
            total += term
        return wp.where(m.signal[s, 3] == wp.static(ABSOLUTE), wp.abs(total), total)

    signal = summed if users.sums else single

    @wp.func
    def holds(
        m: Measures,
        kept: wp.array3d(dtype=wp.float64),
        i: int,
        begin: int,
        end: int,
        x: VX,
        u: VU,
        time: wp.float64,
        h: wp.float64,
        last: int,
        c: Contacts,
    ):
        """1 where one of the clauses begin, ..., end - 1 holds, else 0."""
        for n in range(begin, end):
            every = int(1)
            for a in range(m.clause[n, 0], m.clause[n, 1]):
                value = signal(m, kept, i, m.compared[a], x, u, time, h, last, c)
                if not (value > m.bounds[a, 0] and value < m.bounds[a, 1]):
                    every = int(0)
            if every == 1:
                return ONE
        return ZERO

    @wp.func
    def look(
        m: Measures,
        kept: wp.array3d(dtype=wp.float64),
        i: int,
        time: wp.float64,
        h: wp.float64,
        x: VX,
        u: VU,
        c: Contacts,
        last: int,
    ):
        for n in range(m.measure.shape[0]):
            j = n
            if wp.static(users.relative):
                j = (n + m.measure.shape[0] - m.since) % m.measure.shape[0]
            what = m.measure[j, 0]
            counts = m.measure[j, 4] == 1
            if not counts:
                about = time + EPS * h + PART * time
                counts = about >= m.window[j, 0] and about < m.window[j, 1]
            if wp.static(users.where):
                if counts and m.measure[j, 5] < m.measure[j, 6]:
                    kept_to = holds(m, kept, i, m.measure[j, 5], m.measure[j, 6], x, u, time, h, last, c)
                    counts = kept_to > ZERO
            of_steps = (what >= wp.static(MEAN) and what <= wp.static(TOTAL)) or what == wp.static(RMS)
            step = last == 0 or not of_steps
            if counts and step and not (last == 1 and what == wp.static(SHARE)):
                v = wp.float64(0.0)
                if m.measure[j, 1] == wp.static(NONE):
                    v = holds(m, kept, i, m.measure[j, 2], m.measure[j, 3], x, u, time, h, last, c)
                else:
                    v = signal(m, kept, i, m.measure[j, 1], x, u, time, h, last, c)
                take(kept, i, j, what, v, time, h)

    @wp.func
    def take(
        kept: wp.array3d(dtype=wp.float64),
        i: int,
        j: int,
        what: int,
        v: wp.float64,
        time: wp.float64,
        h: wp.float64,
    ):
        """One more value of measure j."""
        fresh = kept[i, j, 1] == ZERO
        kept[i, j, 1] = kept[i, j, 1] + ONE  # before any branch, where Warp would make a variable of ONE
        if what == wp.static(INITIAL):
            if fresh:
                kept[i, j, 0] = v
        elif what == wp.static(FINAL):
            kept[i, j, 0] = v
        elif what == wp.static(RATE):
            if fresh:
                kept[i, j, 2] = v
                kept[i, j, 3] = time
            kept[i, j, 0] = v
            kept[i, j, 4] = time
        elif what == wp.static(LARGEST):
            if fresh or not (v <= kept[i, j, 0] or wp.isnan(kept[i, j, 0])):  # a NaN comes in, and stays
                kept[i, j, 0] = v
        elif what == wp.static(SMALLEST):
            if fresh or not (v >= kept[i, j, 0] or wp.isnan(kept[i, j, 0])):
                kept[i, j, 0] = v
        elif what == wp.static(FIRST):
            if v > ZERO and kept[i, j, 2] == ZERO:
                kept[i, j, 0] = time
                kept[i, j, 2] = ONE
        elif what == wp.static(SETTLED):
            if v > ZERO and kept[i, j, 2] == ZERO:
                kept[i, j, 0] = time
            kept[i, j, 2] = v
        elif what == wp.static(COUNT):
            if v > ZERO and kept[i, j, 2] == ZERO:
                kept[i, j, 0] = kept[i, j, 0] + ONE
            kept[i, j, 2] = v
        elif what == wp.static(INTEGRAL):
            kept[i, j, 0] = kept[i, j, 0] + v * h
        elif what == wp.static(RMS):
            kept[i, j, 0] = kept[i, j, 0] + v * v
        else:
            kept[i, j, 0] = kept[i, j, 0] + v

    @wp.func
    def ended(m: Measures, kept: wp.array3d(dtype=wp.float64), i: int):
        if m.ends == wp.static(NONE):
            return False
        return kept[i, m.ends, 2] > ZERO

    return SimpleNamespace(look=look, ended=ended)
