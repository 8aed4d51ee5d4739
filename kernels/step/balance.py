"""The equation of motion N (v' - v) = h (r + u) + J' lambda of a solved step, to rounding.

v' = v_free + N^-1 J' lambda misses it by the condition of N, in units of its diagonal, times a rounding: a
light body that carries heavy ones, say, whose coordinates need not be fast. Where more than a few roundings
are missing, v' is refined (Higham, Accuracy and Stability of Numerical Algorithms, chapter 12): each time as
many digits are gained as N^-1 has. Impulses stay, so that what is gained is an error of J v' + d/h, as are
the digits that A = J N^-1 J' has lost: where it is no longer small, or nothing is gained, the step is
NOT_CONVERGED.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.acting import rows_of_pairs
from ..contact.end_gap import make_end_gap
from ..contact.rows import make_rows
from ..factories import cached
from ..mechanism.dynamics import fill_pattern, make_mechanism
from ..mechanism.effective_mass import make_effective_mass
from ..mechanism.forces import make_forces
from ..residual.noise import make_noise
from ..solvers.law import law_of
from ..specialisation import Specialisation
from ..status import NOT_CONVERGED
from ..structure import layout
from .scale_digits import make_scale_digits
from .solution import make_solution

DIGITS = {wp.float64: 1e4, wp.float32: 30.0}  # max N_ii (N^-1)_ii up to which nothing can be missing
MISSING = {wp.float64: 3e-12, wp.float32: 4e-6}  # of the terms of a coordinate's equation of motion
MOVED = {wp.float64: 1e-8, wp.float32: 1e-3}  # of the terms of J v' + d/h, at most
ROUNDED = {wp.float64: 5e-15, wp.float32: 2.4e-6}  # of them, times max N_ii (N^-1)_ii: 20 roundings
SHARED = 0.1  # of that where a row's error is every other row's, too
REFINEMENTS = 4
PASSES = {wp.float64: 2, wp.float32: 0}  # over hard rows, whose impulses have lost what A has


@cached
def make_balance(spec: Specialisation) -> SimpleNamespace:
    """loses: whether N has couplings at all; is_ill(n, minv): whether digits of v' may be missing; refined(
    world, x, u, solution) -> v', lambda and the status of a solved step; shuts: whether lambda may be another
    one. Numbers that are none are left to others.
    """
    s, dtype, method = spec
    law = law_of(method, s.nr)
    mech, mass, forces = make_mechanism(s, dtype), make_effective_mass(spec), make_forces(s, dtype)
    solution, rows, noise, NV = make_solution(s, dtype), make_rows(spec), make_noise(spec), s.nv
    Solution, split, t = solution.Solution, solution.split, solution.types
    MQ, VQ, VX, VU, H = t.MQ, t.VQ, t.VX, t.VU, layout(s).offset("step_size")
    LARGEST, ENOUGH = dtype(DIGITS[dtype]), dtype(MISSING[dtype])
    ZERO = dtype(0.0)
    MOST = dtype((SHARED if law.weighs else 1.0) * MOVED[dtype])
    index = tuple(row.index if row.kind == "limit" else 0 for row in s.rows)
    coupled = tuple(tuple(s.coupled(i, j) or i == j for j in range(NV)) for i in range(NV))
    if method.trapezoidal and s.implicit_damping:  # whose N = K + B K^-1 B has what M^-1 has
        coupled = fill_pattern(s)
    alone = tuple(sum(row) == 1 for row in coupled)
    ends = method.end_gap and len(s.pairs) > 0
    end_gap = make_end_gap(spec) if ends else None
    shuts = tuple(method.hard and (limit or not (law.by_diagonal or ends)) for limit in rows.limit)
    smoothed = not (method.hard or law.by_diagonal or law.weighs) and method.inertia_scaling
    scale_loses = make_scale_digits(spec) if smoothed and s.nr else None
    ROUNDS = 2 if any(shuts) and PASSES[dtype] else 1

    rows_of = rows_of_pairs(s)

    @wp.func
    def pushed(push: VQ, sol: Solution):
        """push + J' lambda, and the size of its terms."""
        total = push
        size = wp.abs(push)
        for i in range(wp.static(s.nr)):
            if (sol.mask & wp.static(1 << i)) != 0:
                total = wp.static(rows.adds[i])(total, sol.jac, sol.lam[i])
                if wp.static(rows.limit[i]):
                    size[wp.static(index[i])] = size[wp.static(index[i])] + wp.abs(sol.lam[i])
                else:
                    size += wp.abs(sol.lam[i]) * wp.abs(sol.jac[i])
        return total, size

    @wp.func
    def missing(n: MQ, v: VQ, reached: VQ, total: VQ, size: VQ):
        """What is missing, and whether that is too much."""
        miss = VQ()
        large = bool(False)
        for i in range(wp.static(NV)):
            if wp.static(not alone[i]):
                left = total[i]
                terms = size[i]
                for j in range(wp.static(NV)):
                    if wp.static(coupled[i][j]):
                        left -= n[i, j] * (reached[j] - v[j])
                        terms += wp.abs(n[i, j]) * (wp.abs(reached[j]) + wp.abs(v[j]))
                miss[i] = left
                large = large or wp.abs(left) > ENOUGH * terms
        return miss, large

    @wp.func
    def turned(world: t.World, q: VQ, before: Solution, after: Solution):
        """How d(q + h v')/h moved beside J_n v'."""
        known = int(0)
        for k in range(wp.static(len(s.pairs))):
            if (before.mask & wp.static(1 << rows_of[k][0])) != 0:
                known = known | wp.static(1 << k)
        now = end_gap.bend(world, q, after.v, before.normal, before.jac, before.rate, known)
        return now - end_gap.bend(world, q, before.v, before.normal, before.jac, before.rate, known)

    @wp.func
    def astray(world: t.World, q: VQ, before: Solution, sol: Solution, fast: VQ, most: dtype):
        """The solution, and whether J v' + d/h of a row is not what it was solved for, A_ii lambda - z or D
        lambda - z, by `most` of its terms beside velocities of size `fast`; with the gap at the end whether
        that moved from where it was `before`. Hard rows that press, but for Coulomb's two, are shut again by
        impulses of their own first, one by one.
        """
        out = sol
        bent = t.VR()
        lost = bool(False)
        passes = int(0)
        while passes <= wp.static(PASSES[dtype]):
            if wp.static(ends):
                bent = turned(world, q, before, out)
            for i in range(wp.static(s.nr)):
                if (sol.mask & wp.static(1 << i)) != 0:
                    terms = wp.abs(sol.rate[i])
                    if wp.static(rows.limit[i]):
                        terms += fast[wp.static(index[i])]
                    else:
                        terms += wp.dot(wp.abs(sol.jac[i]), fast)
                    if wp.static(not method.hard):
                        terms += wp.static(noise.level[i])(world, sol.sigma)
                    response = wp.static(rows.applies[i])(sol.minv, sol.jac)
                    speed = wp.static(rows.dots[i])(sol.jac, out.v)
                    w = speed + sol.rate[i]
                    own = wp.static(rows.dots[i])(sol.jac, response)
                    bound = wp.where(passes < wp.static(PASSES[dtype]), MOST, most) * terms
                    if wp.static(ends and not rows.limit[i]):  # whose d/h in the end is not kept
                        w = speed - wp.static(rows.dots[i])(sol.jac, before.v) + bent[i]
                    elif wp.static(shuts[i]):
                        if not (sol.lam[i] > ZERO):
                            w = wp.min(w, ZERO)
                        elif passes < wp.static(PASSES[dtype]) and wp.abs(w) <= bound:
                            out.lam[i] = wp.max(out.lam[i] - w / own, ZERO)
                            out.v = out.v - (w / own) * response
                    elif wp.static(law.by_diagonal):
                        w -= own * sol.lam[i] - sol.z[i]
                    else:
                        w -= sol.scale[i] * sol.lam[i] - sol.z[i]
                    lost = lost or wp.abs(w) > bound
            passes += 1
        return out, lost

    @wp.func
    def illness(n: MQ, minv: MQ):
        worst = ZERO
        for i in range(wp.static(NV)):
            worst = wp.max(worst, n[i, i] * minv[i, i])
        return worst

    @wp.func
    def refined(world: t.World, x: VX, u: VU, sol: Solution):
        q, v = split(x)
        pose = wp.static(mech.pose)(world, q)
        n = wp.static(mass.matrix)(world, pose)
        push = world.params[wp.static(H)] * forces(world, pose, v, u)
        fast = wp.abs(v) + wp.abs(sol.vfree)
        if wp.static(method.trapezoidal):
            v = sol.vfree
            push = VQ()
        out = sol
        lost = bool(False)
        large = bool(False)
        rounds = int(0)
        while rounds < wp.static(ROUNDS):  # shut rows move v' by a response that has lost digits, too
            total, size = pushed(push, out)
            miss, large = missing(n, v, out.v, total, size)
            left = int(wp.static(REFINEMENTS))
            while large and left > 0:
                out.v = out.v + out.minv * miss
                miss, large = missing(n, v, out.v, total, size)
                left -= 1
            if rounds == 0:
                most = wp.min(MOST, wp.static(dtype(ROUNDED[dtype])) * illness(n, out.minv))
                out, lost = astray(world, q, sol, out, fast, most)
                if wp.static(scale_loses is not None):
                    lost = lost or scale_loses(world, n, fast, sol, MOST)
            rounds += 1
        if large or lost:
            out.status = wp.static(NOT_CONVERGED)
        return out.v, out.lam, out.status

    @wp.func
    def is_ill(n: MQ, minv: MQ):
        out = bool(False)
        for i in range(wp.static(NV)):
            if wp.static(not alone[i]):
                out = out or n[i, i] * minv[i, i] > LARGEST
        return out

    return SimpleNamespace(loses=s.couples, shuts=ROUNDS > 1, is_ill=is_ill, refined=refined)
