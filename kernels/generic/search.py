"""What solves an island: Newton's method on (v', z), and where it fails an interior-point method.

Newton's method starts from the last step's impulses; of hard rows it is an active-set method, whose matrix
changes only with the set. The interior-point method tries Newton's from its points as soon as they are near
a solution, and goes on where that fails. Every solution has to be earned (`judge/earned.py`).
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..status import INFEASIBLE, NONFINITE, NOT_CONVERGED, SOLVED
from .active_set import make_active_set
from .interior import MAX_ITERATIONS, make_interior
from .judge.digits import make_digits
from .judge.earned import make_earned
from .judge.least import HELD, KEPT, make_least
from .judge.scales import make_scales
from .linear.held import make_held
from .linear.pivots import SOFTENED, make_pivots
from .newton import ACCEPTED, PROXIMAL, REFINED, TOLERANCE, make_newton
from .rows.kept import make_kept
from .topology import Topology
from .work import WORK, Island, Slot

# Attempts after Newton's method alone: FIRM with less of the proximal term, ROUNDS where rows yield for the
# least impulses there are, EXACT from single exchanges (not Coulomb's friction), of smoothed rows held.
WARM, COLD, FIRM, YIELDING = 1, 2, 3, 4
ROUNDS = 3
EXACT = YIELDING + ROUNDS
FIRMER = 1e-15  # the proximal term, of diag(A), for rows that repeat others but for a rounding of their gaps
ALL_ATTEMPTS, QUICK_ATTEMPTS = EXACT + 1, COLD  # all, or only those from what is known
WARM_ITERATIONS, POLISHING = {True: 16, False: 12}, 12  # of Newton's method before and after
HOLDING = 60  # of smoothed rows that are held: z of such a row rises by a sigma an iteration
PIVOTS = 50  # of hard rows, before: the interior-point method costs about as many
NEARLY = {True: 0, False: 12}  # more before, where it has nearly ended (hard or not)
RESTS = 1e-12  # residual at which the last solution is one of this step: gaps round, at some height
PATIENCE = 6  # iterations of it without a gain, where it has nearly ended
SETS = {True: 6, False: 4}  # and before (hard or not)
GAIN = {True: 0.5, False: 0.8}  # what counts as one, before: smoothed rows may take shortened steps
# end: sqrt(mu) (hard: what a row that only just touches is off by) and residuals, of the problem's size
END = {False: (1e-10, 1e-13), True: (1e-14, 1e-13)}
TRIED = 1e-5  # sqrt(mu), relative to the size of the problem, at which Newton's method is tried first
YIELDS = {wp.float64: 2e-12, wp.float32: 1e-7}  # of rows whose impulses must be the least there are


@wp.struct
class Search:
    """Where the search for a solution of one island stands."""

    attempt: int
    inside: int  # 1: in the interior-point method
    trying: int  # 1: in Newton's method from an interior point that may be gone on from
    it: int  # iterations of the present method
    walked: int  # of the interior-point method, when it was left
    misses: int  # iterations without a gain
    best: WORK  # residual, of Newton's method; of the last point, of the other
    bound: WORK  # a that counts as diverged
    yielding: WORK
    rest: WORK  # residual at which Newton's method is not even begun
    tried: WORK  # sqrt(mu) at which Newton's method is tried next
    bent: int  # 1: excess and weights of the interior point are those at hand
    mean: WORK  # |excess| there; outside, of hard rows, how many changed sets in the last step
    pivots: int  # of hard rows, made in all
    missing: WORK  # what the equations of smoothed rows missed at the last one
    last: int  # 1: the best point of Newton's method is the one at hand
    attempts: int  # that may be made
    eased: int  # 1: smoothed rows were eased in this attempt
    exact: int  # 1: EXACT was made, 2: and is behind


@cached
def make_solver(given: type, residual: str) -> SimpleNamespace:
    """solve(t, k, o) -> status: k.v, k.z, k.lam of the acting rows of an island."""
    dtype = WORK
    nt = make_newton(given, residual)
    inner = make_interior(given, residual)
    earned, least = make_earned(given, residual), make_least(given, residual)
    scales, digits = make_scales(given, residual), make_digits(given, residual)
    hard = residual == "hard"
    exact, kept = make_active_set(given), make_kept(given, residual)
    follow = make_pivots(given) if hard else None
    held = None if hard else make_held(given, residual)
    LIMIT, RESIDUAL = (dtype(x) for x in END[hard])
    ZERO, HALF, LESS = dtype(0.0), dtype(0.5), dtype(GAIN[hard])
    GOOD, MORE = nt.GOOD, least.MORE
    AIM, FINE, NEAR = dtype(TOLERANCE), dtype(min(ACCEPTED[given], REFINED)), dtype(1e-4)
    SHORTER, SHORTEST = dtype(0.3), dtype(0.02)  # of a step of Newton's method
    TINY, HUGE, REST = dtype(1e-30), dtype(1e300), dtype(RESTS)
    SOFTER, LESS_TAU = dtype(SOFTENED), dtype(FIRMER - PROXIMAL)
    LEAST, SLOW = dtype(YIELDS[given]), dtype(0.99)
    SHRINK = dtype(1e-3)  # of the yielding from round to round, of sqrt(mu) from trial to trial

    @wp.func
    def lean(attempt: int):
        """What a factor has more than the proximal term: of later attempts less, but where a set is given."""
        return wp.where(attempt >= wp.static(FIRM) and attempt < wp.static(EXACT), LESS_TAU, ZERO)

    @wp.func
    def keep_least(k: wp.ref[Slot], o: Island, attempt: int):
        """k.least: the impulses that rows asked for when they yielded first, and what they ask for since,
        while that is of the same order: what grows with every round has no least.
        """
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                asked = k.a[r] / k.scale[r]
                if attempt > wp.static(YIELDING):
                    asked = wp.min(asked, MORE * (k.least[r] + k.alone[r]))
                k.least[r] = asked

    @wp.func
    def from_nothing(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Before rows yield first: no impulse is expected, and no rounding forgiven."""
        least.see_all(t, k, o)
        for r in range(o.row, o.last_row):
            k.least[r] = ZERO

    @wp.func
    def end_newton(k: wp.ref[Slot], o: Island, s: wp.ref[Search], worst: dtype):
        """Keep the best point of Newton's method; 1 if its iterations end here: at the aim, where there is no
        gain, or at once where the last step's solution is one of this.
        """
        if worst > wp.where(s.attempt == 0, LESS, HALF) * s.best and (s.attempt > 0 or s.mean == ZERO):
            s.misses = s.misses + 1
        if worst <= FINE and s.best > FINE:
            s.misses = 0  # what went before is no reason to end short of rounding
        s.last = wp.where(worst < s.best, 1, 0)
        if s.last == 1:
            s.best = worst
        patience, most = int(2), int(wp.static(POLISHING))
        if s.attempt == wp.static(EXACT) and wp.static(not hard):
            most = wp.static(HOLDING)
        aim = wp.where(s.attempt == 0 and s.it == 1, s.rest, AIM)
        if s.attempt == 0:
            if wp.static(hard) or s.best > FINE:
                patience = wp.static(SETS[hard])
            most = wp.static(WARM_ITERATIONS[hard])
            if s.best < NEAR:
                most += wp.static(NEARLY[hard])
        if s.best > FINE and s.best < NEAR:  # nearly solved
            patience = wp.static(PATIENCE)
        if s.trying == 1:
            patience = 1
        if most == wp.static(HOLDING):  # residuals rise where the set changes
            patience = wp.where(s.best > GOOD, wp.static(HOLDING), wp.static(PATIENCE))
        ends = s.misses >= patience or s.it >= most or s.pivots >= wp.static(PIVOTS)
        if ends or not (worst < HUGE) or s.best <= aim:
            return 1
        if s.last == 1:
            kept.keep_best(k, o)
        return 0

    @wp.func
    def end_inside(s: wp.ref[Search], worst: dtype, mean: dtype, largest: dtype, size: dtype):
        """1 if the interior point is a solution, 2 if it may be near one, 3 if there is none to find."""
        last = s.best + ZERO
        s.best = worst
        if mean <= LIMIT * LIMIT * size * size:
            gain = HALF
            if s.attempt >= wp.static(YIELDING):
                gain = SLOW  # opposed impulses come down to the least there are in small steps
            if worst <= RESIDUAL or (worst > gain * last and worst <= GOOD):
                return 1
        if s.it > wp.static(MAX_ITERATIONS) or not (largest < s.bound and mean < HUGE):
            return 3
        if s.attempt == wp.static(WARM) and mean <= s.tried * s.tried * size * size:
            return 2
        return 0

    @wp.func
    def missing(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """What the equations miss, in energy: |r1|^2 in M^-1 and |r2|^2 in D^-1."""
        total = dtype(0.0)
        for place in range(o.start, o.end):
            i = k.block[place]
            part = k.mass_factor[t.mass_at[i] + i] * k.balance[i]
            total += wp.dot(part, part)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                total += k.res[r] * k.res[r] * k.inverse[r]
        return total

    @wp.func
    def keep_way(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, s: wp.ref[Search]):
        """Before a step of Newton's method: dv, which the next residuals need the room of."""
        for place in range(o.start, o.end):
            k.inner_v[k.block[place]] = k.move[k.block[place]]
        if s.it == 1:
            s.missing = missing(t, k, o)

    @wp.func
    def proceed(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, s: wp.ref[Search], n: dtype, step: dtype):
        """Make the step; of hard rows, from the last solution, with their changes of sets on the way."""
        if wp.static(hard):
            if s.attempt == 0:
                made = follow(t, k, o, wp.static(PIVOTS) - s.pivots)
                s.pivots = s.pivots + made
                s.mean = dtype(made)
                return
        s.mean = inner.advance(k, o, n, s.inside, step)

    @wp.func
    def shorten(k: wp.ref[Slot], o: Island, less: dtype):
        """Take a share of the last step back."""
        for place in range(o.start, o.end):
            i = k.block[place]
            k.v[i] = k.v[i] - less * k.inner_v[i]
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.z[r] = k.z[r] - less * k.dz[r]

    @wp.func
    def look(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, s: wp.ref[Search], yields: dtype):
        """Residuals of the point at hand. Of smoothed rows a step of Newton's method from the last solution
        is shortened until the equations miss less than before it.
        """
        worst, changed, largest = nt.residuals(t, k, o, s.inside, yields)
        if wp.static(not hard):
            if s.attempt == 0 and s.it > 0 and not (worst <= GOOD):
                step = dtype(1.0)
                now = missing(t, k, o)
                while step > SHORTEST and not (now < s.missing):
                    shorten(k, o, step - SHORTER * step)
                    step = SHORTER * step
                    worst, changed, largest = nt.residuals(t, k, o, s.inside, yields)
                    now = missing(t, k, o)
                s.missing = now
        return worst, changed, largest

    @wp.func
    def begin(s: wp.ref[Search], inside: int):
        s.inside = inside
        s.bent = 0
        s.it = 0
        s.misses = 0
        s.pivots = 0
        s.best = HUGE

    @wp.func
    def to_newton(
        t: wp.ref[Topology], k: wp.ref[Slot], o: Island, s: wp.ref[Search], ended: int, size: dtype
    ):
        """From an interior point to Newton's method; INFEASIBLE where it proves that."""
        status = int(wp.static(NOT_CONVERGED))
        s.trying = 0
        if ended == 2:
            s.trying = 1
            s.walked = s.it
            s.tried = SHRINK * s.tried
            kept.leave(k, o)
        else:
            keep_least(k, o, s.attempt)
            if s.attempt == wp.static(COLD) and ended == 3:
                if inner.proves_infeasible(t, k, o, size):
                    status = wp.static(INFEASIBLE)
        s.yielding = SHRINK * s.yielding
        begin(s, 0)
        return status

    @wp.func
    def one_by_one(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Whether the active-set method of single exchanges has a solution of hard rows, from which Newton's
        goes on: it moves the bodies by the least that opens all rows, and its rows do not depend on each
        other, so that no impulses are less.
        """
        if t.coulomb == 1 or exact.find(t, k, o) == 0:
            return False
        for r in range(o.row, o.last_row):
            k.least[r] = k.lam[r]
        return True

    @wp.func
    def leave_out(s: wp.ref[Search]):
        """Single exchanges once, of hard rows before what is less exact; of smoothed ones, dear, at last."""
        if wp.static(hard):
            if s.attempt == wp.static(FIRM) and s.best > GOOD and s.exact == 0:
                s.attempt = wp.static(EXACT)
            elif s.attempt > wp.static(EXACT) and s.exact == 1:
                s.attempt = wp.static(FIRM)
                s.exact = 2
            elif s.attempt == wp.static(EXACT) and s.exact > 0:
                s.attempt = s.attempts + 0

    @wp.func
    def judge(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, s: wp.ref[Search], size: dtype):
        """SOLVED if what Newton's method ended at is a solution; else what is next: impulses that do not add
        up are looked for as the least that there are.
        """
        if s.last == 0:
            kept.take_best(k, o)
        next = s.attempt + 1
        if s.best <= GOOD:
            good = int(0)
            if s.last == 1 and t.coulomb == 0:
                good = earned.plainly_adds_up(t, k, o)
            if good == 0:
                good = earned.adds_up(t, k, o)
            if wp.static(hard):
                if good == 0 and s.attempt < wp.static(YIELDING):
                    earned.take_impulses(t, k, o)
                    worst, _changed, _largest = nt.residuals(t, k, o, 0, ZERO)
                    if worst <= GOOD:
                        good = earned.adds_up(t, k, o)
            if good == 0 and s.attempt >= wp.static(YIELDING):
                good = least.is_earned(t, k, o, wp.where(s.attempt == EXACT, HELD, KEPT), t.coulomb)
            elif good == 0:
                next = wp.static(YIELDING)
            if good == 1:
                return wp.static(SOLVED)
            if wp.static(not hard):
                if s.eased == 0:
                    least.ease(k, o)
                    begin(s, 0)
                    s.trying = 0
                    s.eased = 1
                    return wp.static(NOT_CONVERGED)
        elif s.trying == 1:
            begin(s, 1)
            s.it = s.walked
            kept.go_back(k, o)
            return wp.static(NOT_CONVERGED)
        s.attempt = next
        s.eased = 0
        leave_out(s)
        if s.attempt == wp.static(EXACT):
            s.exact = 1
            begin(s, 0)
            if one_by_one(t, k, o):
                return wp.static(NOT_CONVERGED)
            s.attempt = s.attempt + 1
            leave_out(s)
        if s.attempt >= s.attempts:
            return wp.static(NOT_CONVERGED)
        begin(s, 1)
        if s.attempt == wp.static(YIELDING):
            from_nothing(t, k, o)
            s.yielding = LEAST
        cold = wp.where(s.attempt > wp.static(WARM), 1, 0)
        s.bound = inner.enter(t, k, o, size, s.yielding, cold)
        return wp.static(NOT_CONVERGED)

    @wp.func(inline=False)
    def solve(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, attempts: int):
        """Newton from k.v, k.z; where it fails, the interior-point method, warm, then cold, and Newton from
        its points. Impulses that do not add up on the scale of the data are looked for once more, the least
        that there are: rows yield by `yielding` of what they press more than k.least; `attempts`: how many
        of these may be made.
        """
        size, n = scales(t, k, o)
        if not wp.isfinite(size):
            return wp.static(NONFINITE)
        size = wp.max(size, TINY)
        s = Search()
        s.attempts = attempts
        s.best = HUGE
        s.missing = HUGE
        s.tried = dtype(wp.static(TRIED))
        s.rest = wp.where(t.coulomb == 0, REST, AIM)  # a fixed point would stop where it moves little
        status = int(wp.static(NOT_CONVERGED))
        while status == wp.static(NOT_CONVERGED) and s.attempt < attempts:
            yields = wp.where(s.inside == 1, s.yielding, ZERO)
            worst, changed, largest = look(t, k, o, s, yields)
            ended = int(0)
            s.it = s.it + 1
            if s.inside == 1:
                if s.bent == 0:
                    s.mean = inner.curve(k, o, n)
                ended = end_inside(s, worst, s.mean, largest, size)
            else:
                ended = end_newton(k, o, s, worst)
            holds = wp.where(wp.static(not hard) and s.attempt == wp.static(EXACT), 1, 0)
            if wp.static(not hard):
                if ended == 0 and holds == 1:
                    ended = 1 - held.direction(t, k, o)
            if ended == 0:
                if wp.static(hard):
                    yields = wp.where(s.attempt == 0, SOFTER, yields)
                step = dtype(1.0)
                if holds == 0:
                    if changed == 1 or s.inside == 1 or s.it == 1:
                        nt.factor(t, k, o, yields + lean(s.attempt))
                    cold = wp.where(s.attempt > wp.static(WARM), 1, 0)
                    step = inner.aim(t, k, o, s.inside, n, size, yields, s.mean, cold)
                if wp.static(not hard):
                    if s.attempt == 0:
                        keep_way(t, k, o, s)
                proceed(t, k, o, s, n, step)
                s.bent = int(s.inside)
            elif s.inside == 1:
                status = to_newton(t, k, o, s, ended, size)
            else:
                status = judge(t, k, o, s, size)
        if wp.static(not hard):
            if status == wp.static(SOLVED):
                if digits.loses(t, k, o):
                    return wp.static(NOT_CONVERGED)
        return status

    return SimpleNamespace(solve=solve, rounding=nt.rounding)
