"""The matrix that stands in the place of M where a step's velocity is solved, and its derivatives.

With implicit damping the forces -C v of joint dampers (diagonal), of tendons (`tendons.py`) and of dampers
between points (c a a'/s each, notation of `springs.py`, so that C depends on q) are met at the end of the
step, F1 = N (v' - v) - h (r + u) - J' lambda with r(q, v) at its start (M22):

    euler:        N = M + h C, so that v' = v/(1 + x) for one damper, x = h c/m;
    trapezoidal:  N = K + B K^-1 B, B = h/2 C, K = M + B: v' = v/(1 + x + x^2/2), the Pade approximant of
                  e^-x that is of second order and decays for every x without a change of sign.

With implicit stiffness Euler's N has h^2/2 K beside this, K of joint springs (diagonal), of tendons and of
springs between points (`stiff_springs.py`): their forces are met at q + h/2 (v' - v) (M50).

All are symmetric and positive definite; contact impulses act through N^-1, D = diag(J N^-1 J'). Where
all is explicit, as in the paper, N = M. With y_X = K^-1 B X the trapezoidal rule's L.N R = L.K R
+ L.B y_R, and d(L.N R) = L.dK R + L.dB y_R + y_L.dB R - y_L.dK y_R.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout
from .dynamics import make_mechanism
from .dynamics_derivatives import make_mechanism_derivatives
from .springs import make_spring
from .stiff_springs import SHARE, make_stiff_spring
from .tendons import make_tendon


@cached
def make_effective_mass(spec: Specialisation) -> SimpleNamespace:
    """matrix(world, pose) = N; by_q(world, pose, w): d(N w)/dq at constant w; and of Euler's
    hessian(world, pose, p, w): d2/dq dq of p.N w. drag(world, fr, h, total): total + h C;
    stiff(world, fr, share, total): total + share K; stiff_by_q and stiff_hessian: of h^2/2 K.
    drag_by_q(world, fr, y, total): total + d(C y)/dq. spread(world, pose) = K^-1 B.
    """
    s, dtype, method = spec
    mech = make_mechanism(s, dtype)
    motion = make_mechanism_derivatives(s, dtype, method.trapezoidal)
    t = mech.types
    lay = layout(s)
    VQ, MQ = t.VQ, t.MQ
    NV = s.nv
    H, DAMPING = lay.offset("step_size"), lay.offset("damping")
    ZERO, ONE, HALF = dtype(0.0), dtype(1.0), dtype(0.5)
    springs = tuple(make_spring(s, i, dtype) for i in range(len(s.springs)))
    tendons = tuple(make_tendon(s, i, dtype) for i in range(len(s.tendons)))
    implicit, trapezoidal = s.implicit_damping, s.implicit_damping and method.trapezoidal
    damped_springs = implicit and len(springs) > 0
    stiff_joints = s.sprung if s.implicit_stiffness and not method.trapezoidal else ()
    STIFFNESS = lay.offset("stiffness") if stiff_joints else 0
    stiff_tendons = tendons if s.implicit_stiffness and not method.trapezoidal else ()
    stiff_springs = tuple(
        make_stiff_spring(s, i, dtype)
        for i in range(len(springs) if s.implicit_stiffness and not method.trapezoidal else 0)
    )
    stiffened = bool(stiff_joints or stiff_springs or stiff_tendons)
    PART = dtype(SHARE)

    @wp.func
    def drag(world: t.World, fr: t.FRAMES, h: dtype, total: MQ):
        out = total
        for j in range(wp.static(NV)):
            out[j, j] = out[j, j] + h * world.params[wp.static(DAMPING + j)]
        for i in range(wp.static(len(springs))):
            out = wp.static(springs[i].by_v)(world, fr, h, out)
        for i in range(wp.static(len(tendons))):
            out = wp.static(tendons[i].damping)(world, h, out)
        return out

    @wp.func
    def stiff(world: t.World, fr: t.FRAMES, share: dtype, total: MQ):
        out = total
        for j in range(wp.static(NV)):
            if wp.static(j in stiff_joints):
                out[j, j] = out[j, j] + share * wp.max(world.params[wp.static(STIFFNESS + j)], ZERO)
        for i in range(wp.static(len(stiff_springs))):
            out = wp.static(stiff_springs[i].matrix)(world, fr, share, out)
        for i in range(wp.static(len(stiff_tendons))):
            out = wp.static(stiff_tendons[i].stiff)(world, share, out)
        return out

    @wp.func
    def stiff_by_q(world: t.World, fr: t.FRAMES, w: VQ, total: MQ):
        """total + h^2/2 d(K w)/dq at constant w."""
        out = total
        for i in range(wp.static(len(stiff_springs))):
            h = world.params[wp.static(H)]
            out = wp.static(stiff_springs[i].by_q)(world, fr, w, PART * h * h, out)
        return out

    @wp.func
    def stiff_hessian(world: t.World, fr: t.FRAMES, p: VQ, w: VQ, total: MQ):
        """total + h^2/2 d2(p.K w)/dq dq."""
        out = total
        for i in range(wp.static(len(stiff_springs))):
            h = world.params[wp.static(H)]
            out = wp.static(stiff_springs[i].hessian)(world, fr, p, w, PART * h * h, out)
        return out

    @wp.func
    def drag_by_q(world: t.World, fr: t.FRAMES, y: VQ, total: MQ):
        out = total
        for i in range(wp.static(len(springs))):
            out = wp.static(springs[i].by_q)(world, fr, y, ZERO, out)
        return out

    @wp.func
    def part(world: t.World, pose: t.Pose):
        """B and K."""
        b = drag(world, pose.frames, HALF * world.params[wp.static(H)], MQ())
        return b, wp.static(mech.mass_matrix)(world, pose.jacobians) + b

    @wp.func
    def spread(world: t.World, pose: t.Pose):
        b, k = part(world, pose)
        return wp.static(mech.inverse)(k) * b

    @wp.func
    def matrix(world: t.World, pose: t.Pose):
        if wp.static(trapezoidal):
            b, k = part(world, pose)
            if wp.ddot(b, b) == ZERO:
                return k
            return k + b * (wp.static(mech.inverse)(k) * b)
        out = wp.static(mech.mass_matrix)(world, pose.jacobians)
        if wp.static(implicit):
            out = drag(world, pose.frames, world.params[wp.static(H)], out)
        if wp.static(stiffened):
            h = world.params[wp.static(H)]
            out = stiff(world, pose.frames, PART * h * h, out)
        return out

    @wp.func
    def part_by_q(world: t.World, pose: t.Pose, w: VQ, y: VQ):
        """d(M w + C y)/dq at constant w and y."""
        out = wp.static(motion.motion_by_q)(t.unpushed(world), pose, w, VQ(), ZERO)
        if wp.static(damped_springs):
            out = drag_by_q(world, pose.frames, y, out)
        return out

    @wp.func
    def by_q(world: t.World, pose: t.Pose, w: VQ):
        h = world.params[wp.static(H)]
        if wp.static(trapezoidal):
            spreading = spread(world, pose)
            y = spreading * w
            out = part_by_q(world, pose, w, HALF * h * (w + y))
            # B K^-1 (dB w - dK y)
            return out + wp.transpose(spreading) * part_by_q(world, pose, -y, HALF * h * (w - y))
        return stiff_by_q(world, pose.frames, w, part_by_q(world, pose, w, h * w))

    @wp.func
    def drag_hessian(world: t.World, fr: t.FRAMES, p: VQ):
        """d2/dq_k dv_m of p.C v."""
        out = MQ()
        for i in range(wp.static(len(springs))):
            out = wp.static(springs[i].hessian_qv)(world, fr, p, ONE, out)
        return out

    @wp.func
    def hessian(world: t.World, pose: t.Pose, p: VQ, w: VQ):
        out = wp.static(motion.hessian_qq)(t.unpushed(world), pose, p, w, VQ(), ZERO)
        if wp.static(damped_springs):
            y = world.params[wp.static(H)] * w
            for i in range(wp.static(len(springs))):
                out = wp.static(springs[i].hessian_qq)(world, pose.frames, p, y, ZERO, out)
        return stiff_hessian(world, pose.frames, p, w, out)

    return SimpleNamespace(
        matrix=matrix,
        by_q=by_q,
        hessian=hessian,
        drag=drag,
        stiff=stiff,
        stiff_by_q=stiff_by_q,
        stiff_hessian=stiff_hessian,
        stiff_joints=stiff_joints,
        stiff_springs=stiff_springs,
        stiff_tendons=stiff_tendons,
        drag_by_q=drag_by_q,
        drag_hessian=drag_hessian,
        damped_springs=damped_springs,
        spread=spread,
        implicit=implicit,
        trapezoidal=trapezoidal,
    )
