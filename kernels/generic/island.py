"""One island of a world: rows are added until none is missing, and solved under the laws of friction."""

import warp as wp

from ..contact.problem import COLD
from ..factories import cached
from ..status import INFEASIBLE, JAMMED, NONFINITE, NOT_CONVERGED, SOLVED
from .contact import ROUNDING, make_contact
from .friction.coulomb import COULOMB_PASSES, RETREATS, make_coulomb
from .friction.direct import LAST, MANY, MOVES, NEARER, ONCE, RELAXED, SOME, STILL, make_direct
from .friction.jam import make_jam
from .friction.modes import ROUNDS
from .friction.normal import make_normal
from .friction.passes import make_passes
from .judge.beside import make_beside
from .motion.mechanism import COLUMN, make_mechanism
from .search import ALL_ATTEMPTS, QUICK_ATTEMPTS, make_solver
from .topology import Topology
from .work import ROUNDED, WORK, Island, Slot

NOWHERE = -1e300
RELAXING = 20  # passes of the fixed point before paths start again, of islands of many blocks
RESTING = 1e-3  # of the fastest approach in an island, with which a row without a last step lies still


@cached
def make_island(given: type, residual: str) -> wp.Function:
    """settle(t, k, o) -> status: k.v, k.z and k.lam of an island's rows."""
    dtype = WORK
    number = make_mechanism(given).number
    contact = make_contact(given, residual)
    step_aside = make_beside(given).step_aside
    solve = make_solver(given, residual).solve
    friction = make_coulomb(given) if residual == "hard" else None
    direct = make_direct(given) if residual == "hard" else None
    approach = make_passes(given) if residual == "hard" else None
    jammed = make_jam(given) if residual == "hard" else None
    keeps_apart = make_normal(given)
    PASSES, H = COULOMB_PASSES, COLUMN["step_size"]
    UNUSED, HALF, ZERO, ONE = dtype(COLD), dtype(0.5), dtype(0.0), dtype(1.0)
    FAR, SLOW, ROUND = dtype(-NOWHERE), dtype(RESTING), dtype(ROUNDING[given])

    @wp.func
    def is_moving(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Whether an island's motion is more than what forces change of it in a step, in energy."""
        own, change = dtype(0.0), dtype(0.0)
        for place in range(o.start, o.end):
            b = k.block[place]
            m = k.mass[t.mass_at[b] + b]
            v = k.before[b]
            dv = k.vfree[b] - v
            own += wp.dot(v, m * v)
            change += wp.dot(dv, m * dv)
        return own > change

    @wp.func(inline=False)
    def count_rows(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, closes: dtype):
        """The number of acting rows; whether most of them are new and lie still, or passes are to be made.

        New ones start from k.v, and press a little where they lie still, less than a share of the fastest
        approach beyond rounding.
        """
        if wp.static(residual == "hard"):
            if t.coulomb == 1:
                direct.join_pairs(t, k, o)
        little = wp.where(closes * number(t, k, H, 0) > ROUND, SLOW * closes, ZERO)
        n, new, touching, rests = int(0), int(0), int(0), int(0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                n += 1
                if k.acting[r] == 1:
                    if not (wp.abs(k.z[r]) < HALF * UNUSED):
                        new += 1
                        w = k.rate[r] + contact.velocity(t, k, r)
                        k.z[r] = -w
                        if w <= little:
                            touching += 1
                            if w >= -little:
                                rests += 1
                                k.z[r] = little
                    k.acting[r] = 2
        state = wp.where(2 * new > n and 2 * rests > touching, STILL, MOVES)
        blocks = o.end - o.start
        if state == MOVES and blocks > wp.static(SOME):
            if blocks > wp.static(MANY) or (2 * new <= n and is_moving(t, k, o)):
                state = wp.static(ONCE)
        return n, state

    @wp.func
    def free(k: wp.ref[Slot], o: Island):
        """k.v = v_free"""
        for place in range(o.start, o.end):
            k.v[k.block[place]] = k.vfree[k.block[place]]

    @wp.func
    def resume(k: wp.ref[Slot], o: Island):
        """k.v = v: what rests stays so."""
        for place in range(o.start, o.end):
            k.v[k.block[place]] = k.before[k.block[place]]

    @wp.func
    def begin(k: wp.ref[Slot], o: Island):
        """v' = v_free, and no row acts."""
        free(k, o)
        for r in range(o.row, o.last_row):
            k.acting[r] = 0
            k.lam[r] = ZERO
            k.miss[r] = ZERO
            k.target[r] = ZERO

    @wp.func(inline=False)
    def relax(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, closes: dtype):
        """A convex solution from nothing, of many blocks some passes of the fixed point further."""
        free(k, o)
        direct.drop_lifts(k, o)
        for r in range(o.row, o.last_row):
            k.z[r] = UNUSED
            k.acting[r] = wp.min(k.acting[r], 1)
        count_rows(t, k, o, closes)
        most = wp.where(o.end - o.start > wp.static(MANY), wp.static(RELAXING), 0)
        passes = int(0)
        going = int(1)
        while going == 1:
            going = int(0)
            if solve(t, k, o, wp.static(QUICK_ATTEMPTS)) == wp.static(SOLVED) and passes < most:
                going = friction.lift(t, k, o, passes)
                passes += 1

    @wp.func
    def come_nearer(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, closes: dtype):
        """Some short passes of the fixed point from the last step's impulses k.excess, kept in k.least; 0 if
        they lead far away.
        """
        resume(k, o)
        direct.drop_lifts(k, o)
        for r in range(o.row, o.last_row):
            k.least[r] = k.excess[r]
            k.z[r] = wp.where(k.excess[r] > ZERO, k.excess[r], UNUSED)
            k.acting[r] = wp.min(k.acting[r], 1)
        count_rows(t, k, o, closes)
        return approach(t, k, o, o.end - o.start > wp.static(MANY))

    @wp.func
    def recall(k: wp.ref[Slot], o: Island):
        """The last step's impulses."""
        for r in range(o.row, o.last_row):
            k.z[r] = k.least[r]

    @wp.func
    def directly(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, known: int, closes: dtype):
        """Coulomb's friction without a fixed point: SOLVED, NONFINITE or NOT_CONVERGED, and 1 if more rows
        are to join before anything else is tried.
        """
        status, rounds = int(wp.static(NOT_CONVERGED)), int(0)
        start = int(known)
        more = int(1)
        while more == 1:
            if start == wp.static(NEARER):
                if come_nearer(t, k, o, closes) == 0:
                    start = int(wp.static(LAST))
            if start == wp.static(RELAXED):
                relax(t, k, o, closes)
            elif start == wp.static(LAST):
                recall(k, o)
            status = direct.stick_and_slide(t, k, o, start)
            if status == wp.static(ROUNDS):
                status, rounds = wp.static(NOT_CONVERGED), 1
            failed = status == wp.static(NOT_CONVERGED)
            more = wp.where(failed and direct.is_another_next(o, start), 1, 0)
            start = direct.after(start)
        ends = int(0)
        if rounds == 1 and status == wp.static(NOT_CONVERGED) and k.count[wp.static(ROUNDED)] == 0:
            k.count[wp.static(ROUNDED)] = 1
            ends = 1
        return status, ends

    @wp.func
    def under_friction(
        t: wp.ref[Topology], k: wp.ref[Slot], o: Island, frees: int, status: int, passes: int, rub: dtype
    ):
        """What follows from a solution, or that there is none, with (rub = 1) or without friction: status,
        passes, rub and whether that changed. Without a solution v' starts from v_free again.
        """
        if rub < ONE:
            if status != wp.static(SOLVED):
                return status, passes, rub, 0
            friction.share(t, k, o)
            return status, 0, ONE, 1
        if status == wp.static(SOLVED):
            return status, passes, rub, 0
        if frees == 1 and status != wp.static(NONFINITE):
            free(k, o)
            return wp.static(SOLVED), passes, ZERO, 1
        if jammed(t, k, o, number(t, k, H, 0)) == 1:
            return wp.static(JAMMED), passes, rub, 0
        if status != wp.static(INFEASIBLE):
            return status, passes, rub, 0
        back = -passes - wp.static(COULOMB_PASSES // RETREATS)
        if back < -PASSES:
            return wp.static(NOT_CONVERGED), back, rub, 0
        free(k, o)
        return wp.static(SOLVED), back, rub, 0

    @wp.func
    def refill(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, rub: dtype, first: int):
        """The rows, with friction (rub = 1) or without, for the first time in a step or again."""
        contact.fill(t, k, o.row, o.last_row, rub)
        if first == 0:
            contact.touch(t, k, o.row, o.last_row)

    @wp.func
    def outlook(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, approach: dtype):
        """Whether rows are to be solved, by v_free, and who joins: under Coulomb's law all, as modes that are
        off cost nothing; but of several solutions the one without impulses is taken, where there is one.
        """
        if wp.static(residual == "hard"):
            if t.coulomb == 1:
                return wp.where(direct.closes_none(t, k, o), 0, 1), ZERO + FAR
        return int(1), approach

    @wp.func(inline=False)
    def settle(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, quick: int):
        """Add rows until none is missing, solve after every addition. The first time also those within reach
        of the largest approach are added: in a heap they act next. Where Coulomb's friction shuts the rows,
        the problem without friction tells whether they can open, and gives a lift to start from; where
        that ends at shut rows again the lift is taken back. `quick`: without the fixed point, which takes
        the longest where there is no solution.
        """
        begin(k, o)
        status = int(wp.static(SOLVED))
        margin = ZERO - FAR
        looking, known = int(1), int(0)  # known: whether J v' + d/h is
        filling, more = int(1), int(1)
        passes = int(0)  # of the fixed point; negative: go back
        rub, closes = dtype(1.0), dtype(0.0)
        hopeless = int(0)  # and when Newton's method on modes failed
        freed = int(0)  # rows in the system when friction was last left out
        n, solves = int(0), int(0)
        while more == 1:  # the first pass only looks how large the approach is
            refilled = int(filling)
            if filling == 1:
                refill(t, k, o, rub, looking)
                filling = 0
            added, approach = contact.grow(t, k, o, margin, known)
            known = int(looking)
            if looking == 1:
                looking = 0
                closes = approach
                more, margin = outlook(t, k, o, approach)
            else:
                n, state = count_rows(t, k, o, closes)
                fresh = wp.where(t.coulomb == 1 and rub == ONE and n > hopeless, 1, 0)
                more = wp.where(added > 0 or rub < ONE or refilled * fresh == 1, 1, 0)
                if wp.static(residual == "hard"):
                    if t.coulomb == 1 and n > 0 and fresh == 0:
                        more = wp.max(more, friction.lift(t, k, o, passes))
                        passes = wp.abs(passes) + 1
                if more == 1:
                    status, ends = int(wp.static(NOT_CONVERGED)), int(0)
                    if wp.static(residual == "hard"):
                        if fresh == 1:
                            status, ends = directly(t, k, o, state, closes)
                            hopeless = wp.where(status == wp.static(NOT_CONVERGED), n, hopeless)
                    if status == wp.static(NOT_CONVERGED):
                        if (quick == 1 and fresh == 1) or ends == 1:
                            return status
                        if solves == 0 and t.coulomb == 0:
                            resume(k, o)
                        solves += 1
                        status = solve(t, k, o, wp.static(ALL_ATTEMPTS))
                    margin = dtype(0.0)
                    if passes > PASSES and status == wp.static(SOLVED):
                        status = int(wp.static(NOT_CONVERGED))
                    if wp.static(residual == "hard"):
                        if t.coulomb == 1:
                            frees = wp.where(n > freed and rub == ONE, 1, 0)
                            turned = under_friction(t, k, o, frees, status, passes, rub)
                            status, passes, rub, filling = turned
                            if filling == 1 and rub < ONE:
                                freed = n
                                margin = ZERO + FAR  # rows that press may free what is jammed without them
                    if status != wp.static(SOLVED):
                        more = 0
        for r in range(o.row, o.last_row):
            if k.acting[r] == 0:
                k.z[r] = UNUSED
        return status

    @wp.func(inline=False)
    def settle_judged(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, quick: int):
        """`settle`, whose solution with friction keeps bodies apart without it, too."""
        status = settle(t, k, o, quick)
        if status == wp.static(SOLVED):
            if keeps_apart(t, k, o) == 0:
                status = int(wp.static(NOT_CONVERGED))
        return status

    @wp.func
    def is_shut(t: wp.ref[Topology], status: int):
        """Whether there is no way; where overlaps may stay, or none was found."""
        none = t.overlaps == 1 and status == wp.static(NOT_CONVERGED)
        return none or status == wp.static(INFEASIBLE) or status == wp.static(JAMMED)

    @wp.func(inline=False)
    def open_parts(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, parts: int):
        """`settle_judged` with overlaps of those parts of an island open that can open while others stay."""
        status = int(wp.static(NOT_CONVERGED))
        for part in range(1, wp.where(parts > 1, parts + 1, 1)):
            contact.overlaps.stay(k, o, part, 0)
            status = settle_judged(t, k, o, 1)
            if status != wp.static(SOLVED):
                contact.overlaps.stay(k, o, part, 1)
        if status != wp.static(SOLVED):
            contact.overlaps.stay(k, o, 0, 1)
            status = settle_judged(t, k, o, 0)
        return status

    @wp.func(inline=False)
    def leave_overlaps(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, shut: int):
        """What follows from rows that found no way: overlaps stay, and bounces are given up only then."""
        status = int(shut)
        parts = contact.overlaps.divide(t, k, o)
        if t.bounces == 1:
            contact.allow_bounces(t, k, o)
        if parts > 0:
            status = open_parts(t, k, o, parts)
        elif status == wp.static(NOT_CONVERGED):
            status = settle_judged(t, k, o, 0)
        if t.bounces == 1 and is_shut(t, status):
            if contact.give_up_bounces(t, k, o) == 1:
                if parts > 0:
                    status = open_parts(t, k, o, parts)
                else:
                    status = settle_judged(t, k, o, 0)
        return status

    @wp.func
    def settle_with_room(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """`settle_judged`; where there is no way, without bouncing, and then with overlaps that stay."""
        status = settle_judged(t, k, o, t.overlaps)
        if t.bounces == 1 and is_shut(t, status):
            if contact.give_up_bounces(t, k, o) == 1:
                status = settle_judged(t, k, o, t.overlaps)
        if t.overlaps == 1 and is_shut(t, status):
            status = leave_overlaps(t, k, o, status)
        if status == wp.static(NOT_CONVERGED):
            step_aside(t, k, o)
        return status

    return settle_with_room
