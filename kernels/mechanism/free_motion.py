"""The motion of one step without contact: v_free, and what its derivatives put into the contact problem.

N stands for M, as `effective_mass.py` has it. `euler`, eq. (1): v_free = v + h N^-1 (r + u). `trapezoidal`,
the linearly implicit method of footnote 1 (the paper's [6]) on a = M^-1 (r + u): (I - h/2 a_v - h^2/4 a_q)
v_free = v + h (a - a_v v/2 + h a_q v/4), and q' = q + h (v + v_free)/2 in free flight. With K_q = d(M a -
r)/dq at constant a, K_v = -dr/dv, D = v_free - v (M23):

    E D = h (r + u) - h^2/2 K_q v,  E = N + h/2 K_v + h^2/4 K_q.

With implicit damping K_v is that of a motion without dampers, which N has. K_q, needed to O(h) only, has them
at v + h a with a = N^-1 (r + u), or stiff ones would make it as large as they are.
Contact impulses act through N^-1, not through E^-1, which is not symmetric. What that would cost is avoided
by a predicted J' lambda among the forces (see `step/trapezoidal.py`): only its error acts through the wrong
matrix.
External forces are constant in the world over the step; their generalised force follows q. E is solved by
elimination without pivoting, which needs h small against the fastest instability of the free motion (an
inverted pendulum's 1/omega). Beyond that E may be next to singular: where a rounding of its entries changes D
by more than a per cent, |E^-1| |E| |D| (Skeel's bound) measured by energy, the result is no number. K_q has a
in it, which has lost max N_ii (N^-1)_ii roundings, the condition of N. Where entries grow in the elimination
the solution is refined: a stiff spring's accelerations, up to 1e12 rad/s^2, stand in K_q beside diagonal
entries that they are not in, and 10 of 16 digits were lost.
"""

from types import SimpleNamespace

import warp as wp

from ..device.seldom import seldom
from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout
from .dynamics import make_mechanism
from .dynamics_derivatives import make_mechanism_derivatives
from .effective_mass import make_effective_mass
from .tendons import make_drive

UNIT = {wp.float64: 1.1e-16, wp.float32: 6e-8}  # a rounding
ROUNDS = 10.0  # roundings of an entry of E, which is a sum of products, beside those of a
MOST_LOST = 1e-2  # of D
SOLVES = 2  # of a system where its elimination loses digits, the second one for what the first has left
GROWN = 30.0  # of a diagonal entry: what elimination may add up to there


@cached
def make_elimination(n: int, dtype: type) -> SimpleNamespace:
    """Warp functions `factor(a)` -> LU in one matrix, without pivoting, `solve(lu, b)` -> a^-1 b,
    `solves(a, lu)`, how often that takes, and `refined(a, lu, b, solves)`, again for what a solution leaves.
    """
    V, M = wp.types.vector(n, dtype), wp.types.matrix((n, n), dtype)

    @wp.func
    def factor(a: M):
        lu = a
        for k in range(wp.static(n)):
            for i in range(wp.static(k + 1), wp.static(n)):
                lu[i, k] = lu[i, k] / lu[k, k]
                for j in range(wp.static(k + 1), wp.static(n)):
                    lu[i, j] = lu[i, j] - lu[i, k] * lu[k, j]
        return lu

    @wp.func
    def solve(lu: M, b: V):
        x = b
        for i in range(wp.static(n)):
            for j in range(wp.static(i)):
                x[i] = x[i] - lu[i, j] * x[j]
        for r in range(wp.static(n)):
            for j in range(wp.static(n - r), wp.static(n)):
                x[wp.static(n - 1 - r)] = x[wp.static(n - 1 - r)] - lu[wp.static(n - 1 - r), j] * x[j]
            x[wp.static(n - 1 - r)] = x[wp.static(n - 1 - r)] / lu[wp.static(n - 1 - r), wp.static(n - 1 - r)]
        return x

    @wp.func
    def solves(a: M, lu: M):
        out = int(1)
        for i in range(wp.static(n)):
            terms = wp.static(dtype(0.0))
            for k in range(wp.static(i)):
                terms += wp.abs(lu[i, k] * lu[k, i])
            if not (terms <= wp.static(dtype(GROWN)) * wp.abs(a[i, i])):
                out = wp.static(SOLVES)
        return out

    @wp.func
    def refined(a: M, lu: M, b: V, rounds: int):
        x = V()
        done = int(0)
        while done < rounds:
            x += solve(lu, b - a * x)
            done += 1
        return x

    return SimpleNamespace(factor=factor, solve=solve, solves=solves, refined=refined)


@cached
def make_free_motion(spec: Specialisation) -> SimpleNamespace:
    """Warp functions of the free motion.

    velocity(world, pose, minv, v, force) -> (v_free, a), force = r + u.
    source(world, pose, w, v) -> -d(M w - h (r + u))/d(q, v, u) at w = v' - v (euler), (nv, nz).
    by_state(world, pose, minv, v, reached, a, dforce) -> d reached/d(q, v, u) (trapezoidal),
        (nv, nz), of what `velocity` gives where the force also depends on (q, v, u) by dforce (nv, nz).
    held(world, pose, w, by_state) -> M dv_free - d(M w) at w = v' - v_free, then in place of source.
    """
    s, dtype, method = spec
    mech = make_mechanism(s, dtype)
    motion = make_mechanism_derivatives(s, dtype, method.trapezoidal)
    mass = make_effective_mass(spec)
    drives = tuple(make_drive(s, i, dtype) for i in range(s.nu))
    lu = make_elimination(s.nv, dtype)
    t = mech.types
    lay = layout(s)
    NV, NU = s.nv, s.nu
    VQ, MQ = t.VQ, t.MQ
    DV = wp.types.matrix((NV, 2 * NV + NU), dtype)
    H, GEAR = lay.offset("step_size"), lay.offset("gear")
    ZERO, ONE, HALF, TWO = dtype(0.0), dtype(1.0), dtype(0.5), dtype(2.0)
    SUMMED, ROUND = dtype(ROUNDS), dtype(UNIT[dtype] / MOST_LOST)

    @wp.func
    def may_be_lost(n: MQ, minv: MQ, rest: MQ):
        # not where |x . rest y| <= 1/2 in units of energy: |E^-1_ik| <= 2 (N^-1_ii N^-1_kk)^1/2 then, and
        # |E_ij| <= 3/2 (N_ii N_jj)^1/2, so that doubt <= (3 NV^2 condition)^2 moved in `is_lost`
        condition = ZERO
        bend = ZERO
        for i in range(wp.static(NV)):
            condition = wp.max(condition, n[i, i] * minv[i, i])
            for j in range(wp.static(NV)):
                bend += rest[i, j] * rest[i, j] * minv[i, i] * minv[j, j]
        small = bend <= wp.static(dtype(0.25 / NV**2))
        return not (small and wp.static(dtype(3.0 * NV**2)) * ROUND * (SUMMED + condition) * condition <= ONE)

    @wp.func
    def is_lost(n: MQ, minv: MQ, rest: MQ, factor: MQ, d: VQ, v: VQ):
        # E = n + rest, whose terms may cancel
        size = VQ()
        condition = ZERO
        for i in range(wp.static(NV)):
            condition = wp.max(condition, n[i, i] * minv[i, i])
            for j in range(wp.static(NV)):
                size[i] = size[i] + (wp.abs(n[i, j]) + wp.abs(rest[i, j])) * wp.abs(d[j])
        bound = VQ()
        k = int(0)
        while k < wp.static(NV):
            unit = VQ()
            unit[k] = size[k]
            bound += wp.abs(wp.static(lu.solve)(factor, unit))
            k += 1
        moved = ZERO
        doubt = ZERO
        for i in range(wp.static(NV)):
            moved = wp.max(moved, n[i, i] * (d[i] * d[i] + v[i] * v[i]))
            doubt = wp.max(doubt, n[i, i] * bound[i] * bound[i])
        share = ROUND * (SUMMED + condition)
        return share * share * doubt > moved

    @wp.func
    def velocity(world: t.World, pose: t.Pose, minv: MQ, v: VQ, force: VQ):
        h = world.params[wp.static(H)]
        a = minv * force
        if wp.static(method.trapezoidal):
            kq = wp.static(motion.motion_by_q)(world, pose, a, v, ONE)
            kv = wp.static(motion.motion_by_v)(world, pose, v, ONE)
            n = wp.static(mass.matrix)(world, pose)
            rest = HALF * h * (kv + HALF * h * kq)
            rhs = h * (force - HALF * h * (kq * v))
            e = n + rest
            factor = wp.static(lu.factor)(e)
            d = wp.static(lu.refined)(e, factor, rhs, wp.static(lu.solves)(e, factor))
            if seldom(may_be_lost(n, minv, rest)):
                if is_lost(n, minv, rest, factor, d, v):
                    d[0] = wp.sqrt(ZERO - ONE)
            return v + d, a
        return v + h * a, a

    @wp.func
    def source(world: t.World, pose: t.Pose, w: VQ, v: VQ):
        out = DV()
        h = world.params[wp.static(H)]
        by_q = wp.static(motion.motion_by_q)(world, pose, w, v, h)
        by_q = wp.static(mass.stiff_by_q)(world, pose.frames, w, by_q)
        by_v = wp.static(motion.motion_by_v)(world, pose, v, h)
        effective = wp.static(mass.matrix)(world, pose)
        for k in range(wp.static(NV)):
            for j in range(wp.static(NV)):
                out[j, k] = -by_q[j, k]
                out[j, wp.static(NV + k)] = effective[j, k] - by_v[j, k]
        for k in range(wp.static(NU)):
            push = wp.static(drives[k].push)(world, h * world.params[wp.static(GEAR + k)], VQ())
            for j in range(wp.static(NV)):
                if wp.static(j in s.driven(k)):
                    out[j, wp.static(2 * NV + k)] = push[j]
        return out

    @wp.func
    def slopes_of_stiffness(world: t.World, pose: t.Pose, v: VQ, a: VQ, yq: VQ, yv: VQ):
        # d/dq and d/dv of K_v yv + K_q yq at constant yv, yq and a
        by_q = MQ()
        by_v = MQ()
        for i in range(wp.static(NV)):
            p = VQ()
            p[i] = ONE
            qq = wp.static(motion.hessian_qq)(world, pose, p, a, v, ONE)
            qv = wp.static(motion.hessian_qv)(world, pose, p, v, ONE)
            vv = wp.static(motion.hessian_vv)(world, pose.jacobians, p, ONE)
            for k in range(wp.static(NV)):
                for m in range(wp.static(NV)):
                    by_q[i, k] = by_q[i, k] + qv[k, m] * yv[m] + qq[k, m] * yq[m]
                    by_v[i, k] = by_v[i, k] + vv[k, m] * yv[m] + qv[m, k] * yq[m]
            if wp.static(mass.damped_springs):  # of K_q alone
                drag = wp.static(mass.drag_hessian)(world, pose.frames, p)
                for k in range(wp.static(NV)):
                    for m in range(wp.static(NV)):
                        by_v[i, k] = by_v[i, k] + drag[m, k] * yq[m]
        return by_q, by_v

    @wp.func
    def by_state(world: t.World, pose: t.Pose, minv: MQ, v: VQ, reached: VQ, a: VQ, dforce: DV):
        # G = E D - h f + h^2/2 K_q v = 0 with D = reached - v, a = N^-1 f, f = r + u + contact forces
        h = world.params[wp.static(H)]
        d = reached - v
        kq = wp.static(motion.motion_by_q)(world, pose, a, v, ONE)
        kv = wp.static(motion.motion_by_v)(world, pose, v, ONE)
        e = wp.static(mass.matrix)(world, pose) + HALF * h * (kv + HALF * h * kq)
        factor = wp.static(lu.factor)(e)
        solves = wp.static(lu.solves)(e, factor)
        yv = HALF * h * d
        yq = HALF * HALF * h * h * (d + TWO * v)
        change = MQ()
        for j in range(wp.static(NV)):
            p = VQ()
            p[j] = ONE
            slope = wp.static(motion.motion_by_q)(t.unpushed(world), pose, p, VQ(), ZERO)
            if wp.static(mass.damped_springs):
                slope = wp.static(mass.drag_by_q)(world, pose.frames, h * p, slope)
            column = slope * yq
            for i in range(wp.static(NV)):
                change[i, j] = column[i]
        pull = change * minv  # d(K_q yq)/da da/d(r + u)
        by_q, by_v = slopes_of_stiffness(world, pose, v, a, yq, yv)
        if wp.static(mass.implicit):  # N a = f, whose dampers are at v
            still = wp.static(motion.motion_by_q)(world, pose, VQ(), v, ONE)
            drag = wp.static(mass.drag)(world, pose.frames, ONE, kv)
            by_q += wp.static(mass.by_q)(world, pose, d) + h * still
            by_q -= pull * (wp.static(mass.by_q)(world, pose, a) + still)
            by_v += h * drag - pull * drag + HALF * h * h * kq
        else:
            by_q += wp.static(motion.motion_by_q)(world, pose, d, v, h) - pull * kq
            by_v += h * kv - pull * kv + HALF * h * h * kq
        push = h * dforce - pull * dforce
        out = DV()
        for k in range(wp.static(NV)):
            gq = VQ()
            gv = VQ()
            for j in range(wp.static(NV)):
                gq[j] = push[j, k] - by_q[j, k]
                gv[j] = push[j, wp.static(NV + k)] - by_v[j, k]
            dq = wp.static(lu.refined)(e, factor, gq, solves)
            dv = wp.static(lu.refined)(e, factor, gv, solves)
            for j in range(wp.static(NV)):
                out[j, k] = dq[j]
                out[j, wp.static(NV + k)] = dv[j]
            out[k, wp.static(NV + k)] = out[k, wp.static(NV + k)] + ONE
        for k in range(wp.static(NU)):
            drive = wp.static(drives[k].push)(world, world.params[wp.static(GEAR + k)], VQ())
            g = h * drive - pull * drive
            for j in range(wp.static(NV)):
                g[j] = g[j] + push[j, wp.static(2 * NV + k)]
            du = wp.static(lu.refined)(e, factor, g, solves)
            for j in range(wp.static(NV)):
                out[j, wp.static(2 * NV + k)] = du[j]
        return out

    @wp.func
    def held(world: t.World, pose: t.Pose, w: VQ, free: DV):
        out = wp.static(mass.matrix)(world, pose) * free
        by_q = wp.static(mass.by_q)(world, pose, w)
        for k in range(wp.static(NV)):
            for j in range(wp.static(NV)):
                out[j, k] = out[j, k] - by_q[j, k]
        return out

    return SimpleNamespace(velocity=velocity, source=source, by_state=by_state, held=held, DV=DV)
