"""Hard contact with Coulomb's friction in the plane (the paper's [8]), by active sets, Lemke's behind.

Rows of a frictional pair are (n, t): 0 <= lambda_n _|_ w_n = J_n v' + d/h >= 0, and lambda_t in
[-mu lambda_n, mu lambda_n] opposes v_t = J_t v'. In velocity units, with A = J M^-1 J' (2a):
z_n = A_nn lambda_n - w_n decides whether a row presses (z_n > 0); z_t = A_tt lambda_t - v_t whether it
sticks (|z_t| <= A_tt mu lambda_n) or slides. Given every row's mode the impulses follow from one linear
system; its solution gives new modes, a semismooth Newton step on the natural map. Redundant contacts are met
by a proximal term about the last impulses, which leaves no trace where the iteration ends. Where the modes
cycle, Lemke's method (lemke.py) finds modes to start from: a solution exists [8] unless no velocity opens
the rows. Several solutions may exist (Painleve); the one found first is returned, and it is checked.
"""

import warp as wp

from .coulomb_alone import make_alone, make_cone
from .coulomb_few import make_coulomb_few
from .coulomb_modes import make_active
from .factories import cached
from .lemke import RAY, make_lemke
from .method import Method
from .problem import make_problem
from .solve import COLD, INFEASIBLE, JAMMED, NONFINITE, NOT_CONVERGED, SOLVED
from .structure import Structure

ITERATIONS = 12  # of the active set, and as many more for every row
TOLERANCE = {wp.float64: 1e-13, wp.float32: 2e-6}  # of the natural map, relative to the problem's size
ACCEPT = {wp.float64: 3e-12, wp.float32: 1e-5}  # the same where rounding may be all that is left
# relative to A_ii: at first, and where rows are nearly redundant
PROXIMAL = {wp.float64: (1e-9, 1e-13), wp.float32: (1e-4, 3e-7)}


@cached
def make_coulomb_solver(s: Structure, dtype: type, method: Method) -> wp.Function:
    """As `make_solver`; D and noise levels are not read."""
    active = make_active(s, dtype, method)
    lemke = make_lemke(s, dtype, active.Dense)
    single, cone = make_alone(s, dtype, method), make_cone(dtype)
    few = make_coulomb_few(s, dtype, method)
    t = active.types
    VR, Problem = t.VR, make_problem(s, dtype)
    Dense = active.Dense
    ZERO = dtype(0.0)
    TOL, ENOUGH = dtype(TOLERANCE[dtype]), dtype(ACCEPT[dtype])
    TAU, NEARLY_NONE = (dtype(x) for x in PROXIMAL[dtype])
    HUGE, SMALLEST = dtype(1e30), dtype(1e-30)
    EPSILON = dtype(4e-16 if dtype is wp.float64 else 6e-8)
    PROOF = dtype(0.0015 if dtype is wp.float64 else 1.0)  # worst is compared with 3e-12 or 1e-5
    UNUSED = dtype(0.5 * COLD)

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
        worst: dtype  # of the natural map

    @wp.func
    def judge(dense: Dense, lam: VR):
        # z and the natural map at these impulses
        out = Trial()
        out.lam = lam
        for i in range(dense.count):
            w = dense.b[i]
            rounding = ZERO
            for j in range(dense.count):
                w += dense.a[i, j] * lam[j]
                rounding += wp.abs(dense.a[i, j] * lam[j])
            out.z[i] = dense.a[i, i] * lam[i] - w
            error = ZERO
            if dense.tangent[i] == 0:
                error = wp.abs(wp.min(dense.a[i, i] * lam[i], w))
            else:
                bound = dense.a[i, i] * dense.mu[i] * wp.max(lam[i - 1], ZERO)
                error = wp.abs(dense.a[i, i] * lam[i] - wp.clamp(out.z[i], -bound, bound))
            # impulses that cancel may hide what is wrong, and may be all that is wrong
            error = wp.max(error - EPSILON * rounding, PROOF * EPSILON * rounding)
            if not (error <= out.worst):  # a NaN stays
                out.worst = error
        return out

    @wp.func
    def settle(dense: Dense, z: VR, size: dtype, tau: dtype, before: Trial):
        # active sets from z; the best trial, or the one before
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
        while it < wp.static(ITERATIONS) + dense.count:
            it += 1
            mode = active.modes(dense, here.z)
            lu = active.factor(dense, mode, tau)
            lam = active.impulses(dense, mode, lu, dense.b, here.lam, tau)
            here = judge(dense, lam)
            if here.worst < best.worst:
                best = here
            if not (here.worst > TOL * size):
                it = wp.static(ITERATIONS) + dense.count
        return best

    @wp.func
    def kept(z: VR, warm: VR, mask: int):
        # z of the rows in the system; others keep what they had, for the time that they join it
        out = warm
        for i in range(wp.static(s.nr)):
            if (mask & wp.static(1 << i)) != 0:
                out[i] = z[i]
        return out

    @wp.func
    def solve(params: wp.array2d(dtype=dtype), row: int, p: Problem, warm: VR):
        v_alone, z_alone, lam_alone, found = single(params, row, p)
        if found == 1:
            return v_alone, kept(z_alone, warm, p.mask), lam_alone, wp.static(SOLVED), int(0)
        v_few, z_few, lam_few, settled = few(params, row, p, warm)
        if settled == 1:
            return v_few, z_few, lam_few, wp.static(SOLVED), int(0)
        dense = active.gather(params, row, p)
        finite = int(1)
        for i in range(dense.count):
            if not wp.isfinite(dense.b[i]):
                finite = 0
        size = wp.max(dense.size, SMALLEST)
        z = alone(dense)
        for i in range(dense.count):
            before = warm[dense.row[i]]
            if wp.static(len(s.pairs) > 1) and wp.abs(before) < UNUSED:
                z[i] = before
        status = int(wp.static(NOT_CONVERGED))
        best = Trial()
        best.worst = HUGE
        if dense.shut == 1:
            status = wp.static(INFEASIBLE)
        if finite == 0:
            status = wp.static(NONFINITE)
        attempt = int(0)
        while status == wp.static(NOT_CONVERGED) and attempt < 6:
            if attempt == 2:
                lam, found = lemke(dense, int(1))
                z = judge(dense, lam).z
                if found == wp.static(RAY):
                    status = wp.static(JAMMED)
                    lam, opens = lemke(dense, int(0))
                    if opens == wp.static(RAY):
                        status = wp.static(INFEASIBLE)
            elif attempt == 4:
                z = alone(dense)  # where the warm start misled
            elif attempt > 0:
                z = best.z
            if status == wp.static(NOT_CONVERGED):
                tau = wp.where(attempt % 2 == 0, TAU, NEARLY_NONE)
                best = settle(dense, z, size, tau, best)
                if best.worst <= ENOUGH * size:
                    status = wp.static(SOLVED)
            attempt += 1
        v = p.vfree
        lam_out = VR()
        z_out = VR()
        for i in range(dense.count):
            k = dense.row[i]
            lam_out[k] = best.lam[i]
            z_out[k] = best.z[i]
            v += best.lam[i] * dense.response[i]
        return v, kept(z_out, warm, p.mask), lam_out, status, attempt

    return solve
