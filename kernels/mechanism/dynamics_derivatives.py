"""Derivatives of M(q) w and r(q, v) of a planar tree, by the rule of `kinematics.py`.

With P2(w, k) = sum_i w_i d2p/dq_i dq_k for a body's centre of mass p, one more (shallower or equal) index k
below l gives P3(w, k, l) = rev_k perp P2(w, l), and the bias acceleration is perp sum_k J_k s_k with the
weights s of the mechanism.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..structure import REVOLUTE, Structure, layout
from .dynamics import make_mechanism
from .kinematics import make_second
from .springs import make_spring
from .tendons import make_tendon


@cached
def make_mechanism_derivatives(s: Structure, dtype: type, trapezoidal: bool) -> SimpleNamespace:
    """Warp functions: derivatives of the equations of motion, and their contraction for second ones.

    With implicit damping those by q at constant w are of M w - h r for dampers at v + w, where the
    trapezoidal integrator's w is an acceleration at v + h w; its other derivatives are without dampers.
    """
    mech = make_mechanism(s, dtype)
    t = mech.types
    lay = layout(s)
    NB, NV = s.nb, s.nv
    VQ, MQ, JB, J2 = t.VQ, t.MQ, t.JB, t.J2
    ZERO, TWO = dtype(0.0), dtype(2.0)
    MASS, GRAVITY, DAMPING = lay.offset("mass"), lay.offset("gravity"), lay.offset("damping")
    STIFFNESS = lay.offset("stiffness") if s.sprung else 0
    springs = tuple(make_spring(s, i, dtype) for i in range(len(s.springs)))
    tendons = tuple(make_tendon(s, i, dtype) for i in range(len(s.tendons)))
    rev = tuple(kind == REVOLUTE for kind in s.dof_kind)
    second = tuple(make_second(s, b, dtype) for b in range(NB))
    met_late = s.implicit_damping
    undamped = s.implicit_damping and trapezoidal
    H = lay.offset("step_size")
    both = tuple(
        tuple(tuple(s.in_chain(b, i) and s.in_chain(b, j) for j in range(NV)) for i in range(NV))
        for b in range(NB)
    )

    @wp.func
    def damped_velocity(world: t.World, v: VQ, w: VQ, h: dtype):
        """h times the velocity that dampers act with."""
        if wp.static(undamped):
            return h * (v + world.params[wp.static(H)] * w)
        if wp.static(met_late):
            return h * (v + w)
        return h * v

    def make_body(b: int) -> wp.Function:
        @wp.func
        def body_jacobian(jb: JB):
            out = J2()
            for j in range(wp.static(NV)):
                out[0, j] = jb[wp.static(2 * b), j]
                out[1, j] = jb[wp.static(2 * b + 1), j]
            return out

        return body_jacobian

    body_jacobians = tuple(make_body(b) for b in range(NB))

    def make_given(b: int) -> wp.Function:
        @wp.func
        def given(world: t.World, h: dtype):
            """-h (g + F/m), what gravity and forces on the body take from its centre's change of velocity."""
            x = -h * world.params[wp.static(GRAVITY)]
            y = -h * world.params[wp.static(GRAVITY + 1)]
            if world.pushed == 1:
                share = h / world.params[wp.static(MASS + b)]
                x -= share * world.external[wp.static(3 * b)]
                y -= share * world.external[wp.static(3 * b + 1)]
            return t.V2(x, y)

        return given

    givens = tuple(make_given(b) for b in range(NB))

    def make_acceleration(b: int) -> wp.Function:
        @wp.func
        def acceleration(world: t.World, jac: J2, w: VQ, weights: VQ, h: dtype):
            """J w + h (perp J s - g - F/m): the centre's change of velocity less what forces on it give."""
            out = wp.static(givens[b])(world, h)
            for k in range(wp.static(NV)):
                if wp.static(s.in_chain(b, k)):
                    out[0] = out[0] + jac[0, k] * w[k] - h * jac[1, k] * weights[k]
                    out[1] = out[1] + jac[1, k] * w[k] + h * jac[0, k] * weights[k]
            return out

        return acceleration

    accelerations = tuple(make_acceleration(b) for b in range(NB))

    @wp.func
    def motion_by_q(world: t.World, pose: t.Pose, w: VQ, v: VQ, h: dtype):
        """d/dq_k of (M w - h r)_j at constant w and v; with h = 0: of (M w)_j.

        Where k moves j's body with all that is deeper, it turns force and direction alike: what is above k is
        left, and what would cancel is not computed.
        """
        out = MQ()
        for b in range(wp.static(NB)):
            mass = world.params[wp.static(MASS + b)]
            jac = wp.static(body_jacobians[b])(pose.jacobians)
            weights = wp.static(mech.bias_weights[b])(v)
            acc = wp.static(accelerations[b])(world, jac, w, weights, h)
            above = wp.static(givens[b])(world, h)
            gravity_free = h == ZERO
            if gravity_free:
                acc = jac * w
                above = t.V2()
            pw = wp.static(second[b])(jac, w)
            ps = wp.static(second[b])(jac, weights)
            turned_w = ZERO
            turned_s = ZERO
            for k in range(wp.static(NV)):
                if wp.static(both[b][k][k]):
                    cx = jac[0, k]
                    cy = jac[1, k]
                    for j in range(wp.static(NV)):
                        if wp.static(both[b][j][k] and j >= k):
                            value = ZERO
                            if wp.static(any(both[b][i][k] and rev[i] for i in range(k))):
                                value += turned_w * (jac[1, j] * cx - jac[0, j] * cy)
                                value -= h * turned_s * (jac[0, j] * cx + jac[1, j] * cy)
                            if wp.static(rev[k]):
                                value += jac[0, j] * above[1] - jac[1, j] * above[0]
                            out[j, k] = out[j, k] + mass * value
                        if wp.static(both[b][j][k] and j < k):
                            value = jac[0, j] * (pw[0, k] - h * ps[1, k]) + jac[1, j] * (
                                pw[1, k] + h * ps[0, k]
                            )
                            if wp.static(rev[j]):
                                value += cx * acc[1] - cy * acc[0]
                            out[j, k] = out[j, k] + mass * value
                    above[0] = above[0] + cx * w[k] - h * cy * weights[k]
                    above[1] = above[1] + cy * w[k] + h * cx * weights[k]
                    if wp.static(rev[k]):
                        turned_w += w[k]
                        turned_s += weights[k]
        for j in range(wp.static(NV)):
            if wp.static(j in s.sprung):
                out[j, j] = out[j, j] + h * world.params[wp.static(STIFFNESS + j)]
        for i in range(wp.static(len(tendons))):
            out = wp.static(tendons[i].stiffness)(world, h, out)
        if wp.static(len(springs) > 0):
            if h != ZERO:
                y = damped_velocity(world, v, w, h)
                for i in range(wp.static(len(springs))):
                    out = wp.static(springs[i].by_q)(world, pose.frames, y, h, out)
        return out

    @wp.func
    def motion_by_v(world: t.World, pose: t.Pose, v: VQ, h: dtype):
        """d/dv_k of (-h r)_j."""
        out = MQ()
        if wp.static(not undamped):
            for j in range(wp.static(NV)):
                out[j, j] = h * world.params[wp.static(DAMPING + j)]
        for b in range(wp.static(NB)):
            factor = TWO * h * world.params[wp.static(MASS + b)]
            jac = wp.static(body_jacobians[b])(pose.jacobians)
            pv = wp.static(second[b])(jac, v)
            for k in range(wp.static(NV)):
                for j in range(wp.static(NV)):
                    if wp.static(both[b][j][k]):
                        out[j, k] = out[j, k] + factor * (jac[0, j] * pv[0, k] + jac[1, j] * pv[1, k])
        if wp.static(not undamped):
            for i in range(wp.static(len(springs))):
                out = wp.static(springs[i].by_v)(world, pose.frames, h, out)
            for i in range(wp.static(len(tendons))):
                out = wp.static(tendons[i].damping)(world, h, out)
        return out

    @wp.func
    def hessian_qq(world: t.World, pose: t.Pose, p: VQ, w: VQ, v: VQ, h: dtype):
        """d2/dq_k dq_l of p.(M w - h r); with h = 0: of p.M w."""
        out = MQ()
        for b in range(wp.static(NB)):
            mass = world.params[wp.static(MASS + b)]
            jac = wp.static(body_jacobians[b])(pose.jacobians)
            weights = wp.static(mech.bias_weights[b])(v)
            acc = wp.static(accelerations[b])(world, jac, w, weights, h)
            if h == ZERO:
                acc = jac * w
            jp = jac * p
            pp = wp.static(second[b])(jac, p)
            pw = wp.static(second[b])(jac, w)
            ps = wp.static(second[b])(jac, weights)
            for k in range(wp.static(NV)):
                for i in range(wp.static(NV - k)):
                    if wp.static(both[b][k][k + i]):
                        l = wp.static(k + i)
                        bkx = pw[0, k] - h * ps[1, k]
                        bky = pw[1, k] + h * ps[0, k]
                        blx = pw[0, l] - h * ps[1, l]
                        bly = pw[1, l] + h * ps[0, l]
                        value = pp[0, k] * blx + pp[1, k] * bly + pp[0, l] * bkx + pp[1, l] * bky
                        if wp.static(rev[k]):  # one more shallow index: perp of what is at l
                            value += pp[0, l] * acc[1] - pp[1, l] * acc[0] + blx * jp[1] - bly * jp[0]
                        out[k, l] = out[k, l] + mass * value
        for k in range(wp.static(NV)):
            for l in range(wp.static(k)):
                out[k, l] = out[l, k]
        if wp.static(len(springs) > 0):
            if h != ZERO:
                y = damped_velocity(world, v, w, h)
                for i in range(wp.static(len(springs))):
                    out = wp.static(springs[i].hessian_qq)(world, pose.frames, p, y, h, out)
        return out

    @wp.func
    def hessian_qv(world: t.World, pose: t.Pose, p: VQ, v: VQ, h: dtype):
        """d2/dq_k dv_m of p.(-h r), (nv, nv)."""
        out = MQ()
        for b in range(wp.static(NB)):
            factor = TWO * h * world.params[wp.static(MASS + b)]
            jac = wp.static(body_jacobians[b])(pose.jacobians)
            jp = jac * p
            pp = wp.static(second[b])(jac, p)
            pv = wp.static(second[b])(jac, v)
            for k in range(wp.static(NV)):
                for m in range(wp.static(NV)):
                    if wp.static(both[b][k][m]):
                        value = pp[0, k] * pv[0, m] + pp[1, k] * pv[1, m]
                        if wp.static(rev[min(k, m)]):
                            value += pv[0, wp.static(max(k, m))] * jp[1] - pv[1, wp.static(max(k, m))] * jp[0]
                        out[k, m] = out[k, m] + factor * value
        if wp.static(not undamped):
            for i in range(wp.static(len(springs))):
                out = wp.static(springs[i].hessian_qv)(world, pose.frames, p, h, out)
        return out

    @wp.func
    def hessian_vv(world: t.World, jb: JB, p: VQ, h: dtype):
        """d2/dv_k dv_m of p.(-h r), (nv, nv)."""
        out = MQ()
        for b in range(wp.static(NB)):
            factor = TWO * h * world.params[wp.static(MASS + b)]
            jac = wp.static(body_jacobians[b])(jb)
            jp = jac * p
            for k in range(wp.static(NV)):
                for m in range(wp.static(NV)):
                    if wp.static(both[b][k][m] and rev[min(k, m)]):
                        out[k, m] = out[k, m] + factor * (
                            jac[0, wp.static(max(k, m))] * jp[1] - jac[1, wp.static(max(k, m))] * jp[0]
                        )
        return out

    return SimpleNamespace(
        body_jacobians=body_jacobians,
        accelerations=accelerations,
        motion_by_q=motion_by_q,
        motion_by_v=motion_by_v,
        hessian_qq=hessian_qq,
        hessian_qv=hessian_qv,
        hessian_vv=hessian_vv,
    )
