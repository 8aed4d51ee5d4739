"""Hard contact with Coulomb's friction (M8), the paper's [8], by active sets, Lemke's method behind.

Rows of a frictional pair are (n, t): 0 <= lambda_n _|_ w_n = J_n v' + d/h >= 0, and lambda_t in
[-mu lambda_n, mu lambda_n] opposes v_t = J_t v'. In velocity units, with A = J M^-1 J' (2a):
z_n = A_nn lambda_n - w_n decides whether a row presses (z_n > 0); z_t = A_tt lambda_t - v_t whether it
sticks (|z_t| <= A_tt mu lambda_n) or slides. Given every row's mode the impulses follow from one linear
system; its solution gives new modes, a semismooth Newton step on the natural map. Redundant contacts are met
by a proximal term about the last impulses, which leaves no trace where the iteration ends. Where the modes
cycle, Lemke's method (lemke.py) finds modes to start from. Several solutions may exist (Painleve); the one
found first is returned, and it is checked, on the scale of J v_free and d/h. Where Lemke's method ends on a
ray every combination of modes is tried: a linear complementarity problem that has a solution has one in which
the rows that hold are independent, so that there is none where no combination fits, and the world is JAMMED.
Of more than MOST_TRIED rows these are the combinations in which at most as many hold as there are velocities;
where they are more than MOST_COMBINATIONS the ray proves nothing, and the world is NOT_CONVERGED. Without
friction the method's ray is a proof that no velocity opens the rows, where it holds: INFEASIBLE. Where there
is no solution gaps that are roundings count as 0: what rests in a jam would else be entering half the time.
"""

import math

import warp as wp

from ..contact.problem import COLD, make_problem
from ..device.seldom import seldom
from ..factories import cached
from ..specialisation import Specialisation
from ..status import INFEASIBLE, JAMMED, NONFINITE, NOT_CONVERGED, SOLVED
from .coulomb_alone import ACCEPT, make_alone, make_cone
from .coulomb_few import make_coulomb_few
from .coulomb_modes import DOUBTFUL, LEFT, OFF, PRESS, RIGHT, STICK, make_active
from .lemke import FOUND, NONE, RAY, make_lemke

ITERATIONS = 12  # of the active set, and as many more for every row
CORRECTIONS = 3  # of the proximal term, where the modes are given
ATTEMPTS = 6  # from several starts, before all modes are tried
TOLERANCE = {wp.float64: 1e-13, wp.float32: 2e-6}  # of the natural map, relative to the problem's size
MOST_TRIED = 8  # rows, of which all combinations of modes are tried: four frictional contacts
MOST_COMBINATIONS = 2048  # of the rows that hold where there are more rows
NEAR = 30.0  # times the accepted error: modes that fit so far are not a proof that none do
# relative to A_ii: at first, and where rows are nearly redundant
PROXIMAL = {wp.float64: (1e-9, 1e-13), wp.float32: (1e-4, 3e-7)}


def most_tried(nv: int) -> int:
    """Most rows of which every combination is tried that velocities of this number may need."""
    rows = MOST_TRIED
    while rows < 30 and sum(math.comb(rows + 1, held) for held in range(nv + 1)) <= MOST_COMBINATIONS:
        rows += 1
    return rows


@cached
def make_coulomb_solver(spec: Specialisation) -> wp.Function:
    """As `make_solver`; D and noise levels are not read. A fast method has single contacts and few rows."""
    s, dtype, method = spec
    active = make_active(spec)
    lemke = make_lemke(spec, active.Dense)
    single, cone = make_alone(spec), make_cone(dtype)
    few = make_coulomb_few(spec)
    t = active.types
    VR, Problem = t.VR, make_problem(s, dtype)
    Dense, MODES = active.Dense, active.MODES
    ZERO, HALF = dtype(0.0), dtype(0.5)
    TOL, ENOUGH = dtype(TOLERANCE[dtype]), dtype(ACCEPT[dtype])
    TAU, NEARLY_NONE = (dtype(x) for x in PROXIMAL[dtype])
    HUGE, NEARLY = dtype(1e30), dtype(NEAR * ACCEPT[dtype])
    EPSILON = dtype(4e-16 if dtype is wp.float64 else 6e-8)
    # worst is compared with 3e-12 or 1e-5: impulses may cancel up to 5e6 or 166 times the problem's size (a
    # tonne on a gram), which leaves v' and w uncertain by 2e-9 or 1e-5 of it
    PROOF = dtype(0.0015 if dtype is wp.float64 else 1.0)
    # up to 1e8 or 5e4 times it a trial may still be right, where roundings hide all that is wrong with it
    DISPROOF, ROUNDINGS = dtype(0.0015 if dtype is wp.float64 else 0.1), dtype(2.0)
    UNUSED = dtype(0.5 * COLD)
    MOST_HELD, MOST_ROWS = s.nv, most_tried(s.nv)

    @wp.func
    def kept(z: VR, warm: VR, mask: int):
        # z of the rows in the system; others keep what they had, for the time that they join it
        out = warm
        for i in range(wp.static(s.nr)):
            if (mask & wp.static(1 << i)) != 0:
                out[i] = z[i]
        return out

    @wp.func
    def solve_fast(world: t.World, p: Problem, warm: VR):
        v_alone, z_alone, lam_alone, found = single(world, p)
        if found == 1:
            return v_alone, kept(z_alone, warm, p.mask), lam_alone, wp.static(SOLVED), int(0)
        v_few, z_few, lam_few, settled = few(world, p, warm)
        status = wp.where(settled == 1, wp.static(SOLVED), wp.static(NOT_CONVERGED))
        return v_few, z_few, lam_few, status, int(0)

    if method.fast:
        return solve_fast

    @wp.func
    def alone(dense: Dense):
        # z of every contact as if it were the only one
        z = VR()
        for i in range(dense.count):
            if dense.tangent[i] == 0:
                z[i] = -dense.b[i]
                with_friction = int(0)
                if i + 1 < dense.count:
                    with_friction = dense.tangent[i + 1]
                if with_friction == 1 and dense.b[i] < ZERO:
                    ann = dense.a[i, i]
                    att = dense.a[i + 1, i + 1]
                    ant = dense.a[i, i + 1]
                    lam = cone(dense.mu[i + 1], ann, ant, att, dense.b[i], dense.b[i + 1])
                    z[i] = ann * lam[0]
                    z[i + 1] = -(dense.b[i + 1] + ant * lam[0])
        return z

    @wp.struct
    class Trial:
        lam: VR
        z: VR
        worst: dtype  # of the natural map, relative to the rows' sizes
        least: dtype  # of all trials so far, where no row that is open at v_free lends others its size

    @wp.func
    def judge(dense: Dense, lam: VR):
        # z and the natural map at these impulses
        out = Trial()
        out.lam = lam
        a = dense.a
        b = dense.b
        mu = dense.mu
        size = dense.size
        near = dense.near
        tangent = dense.tangent
        z = VR()
        for i in range(dense.count):
            w = b[i]
            rounding = ZERO
            for j in range(dense.count):
                w += a[i, j] * lam[j]
                rounding += wp.abs(a[i, j] * lam[j])
            z[i] = a[i, i] * lam[i] - w
            error = ZERO
            if tangent[i] == 0:
                error = wp.abs(wp.min(a[i, i] * lam[i], w))
            else:
                bound = a[i, i] * mu[i] * wp.max(lam[i - 1], ZERO)
                error = wp.abs(a[i, i] * lam[i] - wp.clamp(z[i], -bound, bound))
            # impulses that cancel may hide what is wrong, and may be all that is wrong
            cancels = PROOF * EPSILON * rounding / size[i]
            hidden = (error - ROUNDINGS * EPSILON * rounding) / near[i]
            out.least = wp.max(out.least, wp.max(hidden, DISPROOF * EPSILON * rounding / size[i]))
            error = error - EPSILON * rounding
            error = wp.max(error / size[i], cancels)
            if not (error <= out.worst):  # a NaN stays
                out.worst = error
        out.z = z
        return out

    @wp.func
    def decode(dense: Dense, code: int):
        # the modes of a combination: rows are on or off, a contact that is on sticks or slides either way
        out = MODES()
        left = int(code)
        for i in range(dense.count):
            digit = left % 2
            left = left // 2
            if dense.tangent[i] == 0:
                out[i] = wp.where(digit == 1, wp.static(PRESS), wp.static(OFF))
            elif out[i - 1] == wp.static(PRESS):
                out[i] = wp.where(digit == 1, wp.static(STICK), wp.static(LEFT))
            elif digit == 1:
                out[i - 1] = wp.static(PRESS)
                out[i] = wp.static(RIGHT)
        return out

    @wp.func
    def next_code(dense: Dense, code: int):
        # the combination after this one; of many rows without those in which more hold than can
        out = code + int(1)
        if dense.count > wp.static(MOST_TRIED):
            held = int(MOST_HELD + 1)
            while held > MOST_HELD:
                held = int(0)
                left = int(out)
                while left > 0:
                    left = left & (left - 1)
                    held += 1
                if held > MOST_HELD:
                    out += out & (-out)
        return out

    @wp.func
    def settle(dense: Dense, z: VR, tau: dtype, before: Trial, code: int):
        # active sets from z, or the modes of a code >= 0; the best trial, or the one before
        best = before
        here = Trial()
        here.z = z
        for i in range(dense.count):
            if dense.tangent[i] == 0:
                here.lam[i] = wp.max(z[i], ZERO) / dense.a[i, i]
            else:
                bound = dense.mu[i] * here.lam[i - 1]
                here.lam[i] = wp.clamp(z[i] / dense.a[i, i], -bound, bound)
        it = int(0)
        last = wp.where(code >= 0, wp.static(CORRECTIONS), wp.static(ITERATIONS) + dense.count)
        while it < last:
            it += 1
            mode = active.modes(dense, here.z, dtype(1.0))
            if code >= 0:
                mode = decode(dense, code)
            lu = active.factor(dense, mode, tau)
            lam = active.impulses(dense, mode, lu, dense.b, here.lam, tau)
            here = judge(dense, lam)
            stalls = here.worst <= ENOUGH and here.worst > HALF * best.worst
            here.least = wp.min(here.least, best.least)
            best.least = here.least
            if here.worst < best.worst:
                best = here
            if stalls or not (here.worst > TOL):
                it = last
        return best

    @wp.func
    def at_first(dense: Dense):
        # the status before anything is tried
        status = int(wp.static(NOT_CONVERGED))
        if dense.lost == 1:
            status = wp.static(NONFINITE)
        elif dense.shut == 1:
            status = wp.static(INFEASIBLE)
        for i in range(dense.count):
            if not wp.isfinite(dense.b[i]):
                status = wp.static(NONFINITE)
        return status

    @wp.func
    def earned(p: Problem, dense: Dense, lam: VR, known: int):
        """Whether impulses are to be given back; what double precision says of there being any, NONE if it
        was not asked.
        """
        good = active.is_earned(dense, lam)
        exists = int(known)
        if good == wp.static(DOUBTFUL):
            if exists == wp.static(NONE):
                _lam, exists = lemke(p, dense, int(1), ZERO)
            good = wp.where(exists == wp.static(FOUND), 1, 0)
        return good, exists

    @wp.func
    def search(world: t.World, p: Problem, warm: VR):
        """Impulses by active sets, from Lemke's method, of all combinations: the best trial, the problem that
        it is of, the status and how many attempts were made.
        """
        dense = active.gather(world, p)
        z = alone(dense)
        for i in range(dense.count):
            before = warm[dense.row[i]]
            if wp.static(len(s.pairs) > 1) and wp.abs(before) < UNUSED:
                z[i] = before
        status = at_first(dense)
        best = Trial()
        best.worst = HUGE
        best.least = HUGE
        codes = wp.where(dense.count <= MOST_ROWS, int(1) << dense.count, int(0))
        code = int(-1)  # of a combination, once all else was tried
        ray = int(0)
        exists = int(wp.static(NONE))
        attempt = int(0)
        while status == wp.static(NOT_CONVERGED) and (attempt < wp.static(ATTEMPTS) or code < codes):
            if attempt == 2:
                lam, found = lemke(p, dense, int(1), ZERO)
                z = judge(dense, lam).z
                if found == wp.static(RAY):
                    ray = 1
                    attempt, code = int(wp.static(ATTEMPTS)), int(0)
                    lam, opens = lemke(p, dense, int(0), ZERO)
                    if opens == wp.static(RAY):
                        status = wp.static(INFEASIBLE)
            elif attempt == 4:
                z = alone(dense)  # where the warm start misled
            elif attempt > 0:
                z = best.z
            if status == wp.static(NOT_CONVERGED):
                tau = wp.where(attempt % 2 == 0 and attempt < wp.static(ATTEMPTS), TAU, NEARLY_NONE)
                best = settle(dense, z, tau, best, code)
                if best.worst <= ENOUGH:
                    good, exists = earned(p, dense, best.lam, exists)
                    if good == 1:
                        status = wp.static(SOLVED)
                    else:  # better than nothing, and worse than any solution
                        best.worst = NEARLY
            attempt += 1
            if attempt >= wp.static(ATTEMPTS):
                code = next_code(dense, code)
        if status == wp.static(NOT_CONVERGED) and ray == 1 and best.least > NEARLY:
            if codes > 0:
                status = wp.static(JAMMED)
        return best, dense, status, attempt

    @wp.func
    def solve(world: t.World, p: Problem, warm: VR):
        v_alone, z_alone, lam_alone, found = single(world, p)
        if found == 1:
            return v_alone, kept(z_alone, warm, p.mask), lam_alone, wp.static(SOLVED), int(0)
        v_few, z_few, lam_few, settled = few(world, p, warm)
        if not seldom(settled != 1):
            return v_few, z_few, lam_few, wp.static(SOLVED), int(0)
        problem = p
        best, dense = Trial(), Dense()
        status, attempts, turn = int(wp.static(NOT_CONVERGED)), int(0), int(0)
        while turn < 2:
            best, dense, status, attempts = search(world, problem, warm)
            turn += 1
            if status != wp.static(SOLVED) and turn == 1:
                problem, rounded = active.touch(world, problem)
                turn = wp.where(rounded > 0, 1, 2)
            else:
                turn = 2
        v = p.vfree
        lam_out = VR()
        z_out = VR()
        for i in range(dense.count):
            k = dense.row[i]
            lam_out[k] = best.lam[i]
            z_out[k] = best.z[i]
            v += best.lam[i] * dense.response[i]
        return v, kept(z_out, warm, p.mask), lam_out, status, attempts

    return solve
