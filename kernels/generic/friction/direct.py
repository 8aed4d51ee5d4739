"""Coulomb's hard friction of an island, solved directly.

Newton's method on modes (`modes.py`) starts at those of the last step, for a few iterations. Where it fails a
path is followed from there, and where that leads away others from nothing (`homotopy.py`); Newton's method
takes the last digits from their ends. Where most rows have no last step and lie still all of these stick at
first, and if a short path from there does not end the convex problem (Anitescu's relaxation) has to say what
to start from: a path takes a pivot for every contact that lies otherwise, in a heap many. So an island of
some blocks that moves, and whose rows have a last step, tries Newton's method where short passes of the fixed
point lead (`passes.py`) before it follows a path from that step. In small ones, without a last step and where
bodies may stay at rest passes would find another of several solutions too often, and from neighbouring states
not the same. Paths from nothing take several pivots a row, which cost the more the more there is, and seldom
end in large heaps: one of many blocks follows a path from the passes' end, too, and starts from whole ones
(`coulomb.py`) after the last step's; one of still more is spared paths from nothing at the first look. The
fixed point stays behind all of them: what has no solution at all is told by it. In single precision impulses
that are passed on may round by more than the data allow: what is solved but for that is accepted if they are
the least, and not looked for again before more rows have joined.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...status import NONFINITE, NOT_CONVERGED, SOLVED
from ..judge.earned import make_earned
from ..judge.least import KEPT, OWN, make_least
from ..judge.scales import make_scales
from ..topology import Topology
from ..work import LOOKS, NEAR, ROUNDED, WORK, Island, Slot
from .homotopy import TRIALS, make_homotopy
from .modes import ROUNDS, make_modes

MOVES, STILL, RELAXED = 0, 1, 2  # what is known of an island: a last step; lies still; a convex solution
ONCE, NEARER, LAST = 3, 4, 5  # before: a last step without a path; passes from there; that step with a path
AGAIN, HERE, NOTHING = 0, 1, 2  # attempts: the modes at hand, a path from there, three paths from nothing
ATTEMPTS = NOTHING + TRIALS
SHORT, LONG = 100, 1 << 30  # pivots of a path from what was assumed, from the last step's impulses
SOME = 8  # blocks, beyond which passes are made
MANY, MOST = 45, 90  # blocks, beyond which paths from nothing come after others, or at later looks
MOST_LOOKS = 2  # at what did not converge, after the first
WARM, POLISHING = 4, 12  # iterations on modes, from the last step's and from a path's end


@cached
def make_direct(given: type) -> SimpleNamespace:
    """stick_and_slide(t, k, o) -> status: k.v, k.z, k.lam and k.lift of an island."""
    dtype = WORK
    modes, homotopy = make_modes(given), make_homotopy(given)
    scales, earned, least = make_scales(given, "hard"), make_earned(given, "hard"), make_least(given, "hard")
    ZERO, TINY = dtype(0.0), dtype(1e-30)

    @wp.func
    def resume(k: wp.ref[Slot], o: Island):
        """v' = v: what rests stays so."""
        for place in range(o.start, o.end):
            k.v[k.block[place]] = k.before[k.block[place]]

    @wp.func
    def begin(k: wp.ref[Slot], o: Island, known: int):
        """k.excess and v' of the first attempt."""
        for r in range(o.row, o.last_row):
            k.excess[r] = wp.max(k.z[r], ZERO)
        if known == wp.static(MOVES) or known == wp.static(ONCE):
            resume(k, o)

    @wp.func
    def begin_attempt(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype, known: int, attempt: int):
        """(k.v, k.a) and modes that Newton's method starts from, and its iterations."""
        if attempt < wp.static(NOTHING):
            modes.warm(t, k, o)
        else:
            homotopy.from_nothing(t, k, o, size, attempt - wp.static(NOTHING))
        if attempt == wp.static(HERE):
            short = known == wp.static(STILL) or known == wp.static(NEARER)
            homotopy.from_here(t, k, o, size, wp.where(short, SHORT, LONG))
        last = known == wp.static(MOVES) or known == wp.static(ONCE)
        return wp.where(attempt == wp.static(AGAIN) and last, WARM, POLISHING)

    @wp.func
    def is_another_next(o: Island, known: int):
        """Whether an island that fails starts once more from elsewhere."""
        if known == wp.static(MOVES) or known == wp.static(LAST):
            return o.end - o.start > wp.static(MANY)
        return known != wp.static(RELAXED)

    @wp.func
    def after(known: int):
        """And from where."""
        return wp.where(known == ONCE, NEARER, wp.where(known == NEARER, LAST, RELAXED))

    @wp.func
    def attempts_at(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, known: int):
        """How many there are, with all paths from nothing or with fewer."""
        blocks = o.end - o.start
        if known == wp.static(ONCE) or (known == wp.static(NEARER) and blocks <= wp.static(MANY)):
            return wp.static(HERE)
        if is_another_next(o, known):
            return wp.static(NOTHING)
        looks = k.count[wp.static(LOOKS)]
        if blocks > wp.static(MOST):
            return wp.static(NOTHING) + wp.where(looks == wp.static(MOST_LOOKS), wp.static(TRIALS), looks)
        if blocks <= wp.static(MANY) or looks > 0 or k.count[wp.static(NEAR)] == t.pairs:
            return wp.static(ATTEMPTS)
        return wp.static(NOTHING + 1)

    @wp.func(inline=False)
    def stick_and_slide(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, known: int):
        """SOLVED, NONFINITE or NOT_CONVERGED, or ROUNDS if what an attempt found was refused for that alone;
        without paths from nothing if RELAXED comes next.
        """
        modes.drop_lifts(k, o)
        size, _n = scales(t, k, o)
        if not wp.isfinite(size):
            return wp.static(NONFINITE)
        size = wp.max(size, TINY)
        begin(k, o, known)
        status, failed = int(wp.static(NOT_CONVERGED)), int(wp.static(NOT_CONVERGED))
        attempts = attempts_at(t, k, o, known)
        wary = wp.where(attempts == wp.static(HERE), 1, 0)  # what is tried before a path
        attempt = int(wp.static(AGAIN))
        if known == wp.static(LAST):
            attempt = int(wp.static(HERE))  # ONCE has made the other
        while attempt < attempts and status == wp.static(NOT_CONVERGED):
            iterations = begin_attempt(t, k, o, size, known, attempt)
            found = modes.newton(t, k, o, iterations, wary)
            if found == 1:
                earned.give_back(t, k, o)
                good = earned.plainly_adds_up(t, k, o)
                if good == 0:
                    good = earned.adds_up(t, k, o)
                if good == 0:
                    modes.leave_alone(t, k, o)
                    good = earned.adds_up(t, k, o)
                if good == 0 and attempt >= wp.static(NOTHING):
                    good = least.is_earned(t, k, o, KEPT, 0)
                elif wp.static(given is wp.float32):
                    if good == 0:
                        good = least.is_earned(t, k, o, OWN, 0)
                status = wp.where(good == 1, wp.static(SOLVED), status)
            elif found == wp.static(ROUNDS):
                failed = found + 0
            attempt += 1
            if failed == wp.static(ROUNDS) and attempt == wp.static(NOTHING):
                if k.count[wp.static(ROUNDED)] == 0:
                    attempt = attempts + 0
        return wp.where(status == wp.static(NOT_CONVERGED), failed, status)

    return SimpleNamespace(
        stick_and_slide=stick_and_slide,
        is_another_next=is_another_next,
        after=after,
        join_pairs=modes.join_pairs,
        closes_none=modes.closes_none,
        drop_lifts=modes.drop_lifts,
    )
