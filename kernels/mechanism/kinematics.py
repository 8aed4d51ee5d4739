"""Kinematics of a planar tree: frames of the bodies, Jacobians of points, and their derivatives.

In the plane every derivative of a point p on a body is a rotated column of its Jacobian: with degrees of
freedom numbered along the chain, d^n p / dq_i..dq_m = perp^(n-1) J_max when all but the deepest index are
revolute, and zero otherwise (perp turns by +90 degrees).
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..structure import PRISMATIC, WORLD, Structure, check_capacity, layout
from .world import make_world


@cached
def make_types(s: Structure, dtype: type) -> SimpleNamespace:
    """Warp vector and matrix types of a structure: VQ (nv), VX (2 nv), VU (nu), VR (nr), V2, MQ (nv, nv),
    ... and the structs `World` and `Pose`. Every specialised kernel has them, so this is where a scene with
    too many rows for one ends.
    """
    check_capacity(s)
    nv, nu, nr = s.nv, max(s.nu, 1), max(s.nr, 1)
    vector, matrix = wp.types.vector, wp.types.matrix
    world = make_world(dtype)
    VQ, FRAMES, JB = vector(nv, dtype), matrix((s.nb, 4), dtype), matrix((2 * s.nb, nv), dtype)

    @wp.struct
    class Pose:
        q: VQ
        frames: FRAMES  # of the bodies, see `make_kinematics`
        jacobians: JB  # of their centres of mass, rows (2b, 2b + 1)

    return SimpleNamespace(
        Pose=Pose,
        World=world.World,
        world_at=world.at,
        unpushed=world.unpushed,
        V2=vector(2, dtype),
        VQ=VQ,
        VX=vector(2 * nv, dtype),
        VU=vector(nu, dtype),
        VR=vector(nr, dtype),
        MQ=matrix((nv, nv), dtype),
        FRAMES=FRAMES,
        JB=JB,
        JR=matrix((nr, nv), dtype),
        J2=matrix((2, nv), dtype),
    )


@cached
def make_kinematics(s: Structure, dtype: type) -> SimpleNamespace:
    """Warp functions `frames` and `point_jacobian(body)`; FRAMES holds a row (cos, sin, x, y) per body:
    orientation and joint position.
    """
    t = make_types(s, dtype)
    lay = layout(s)
    NB, NV = s.nb, s.nv
    ZERO, ONE = dtype(0.0), dtype(1.0)
    VQ, FRAMES = t.VQ, t.FRAMES
    PHI = wp.types.vector(NB, dtype)
    parent = tuple(b.parent for b in s.bodies)
    joint = tuple(b.joint for b in s.bodies)
    dofs = tuple(b.dofs for b in s.bodies)
    ANCHOR, ANGLE, AXIS = (lay.offset(n) for n in ("anchor", "angle", "axis"))

    @wp.func
    def frames(world: t.World, q: VQ):
        """Orientation and joint position of every body."""
        out = FRAMES()
        phi = PHI()
        for b in range(wp.static(NB)):
            c = ONE
            sn = ZERO
            x = world.params[wp.static(ANCHOR + 2 * b)]
            y = world.params[wp.static(ANCHOR + 2 * b + 1)]
            angle = world.params[wp.static(ANGLE + b)]
            if wp.static(joint[b] == "prismatic"):
                x += world.params[wp.static(AXIS + 2 * b)] * q[wp.static(dofs[b][0])]
                y += world.params[wp.static(AXIS + 2 * b + 1)] * q[wp.static(dofs[b][0])]
            if wp.static(joint[b] == "free"):
                x += q[wp.static(dofs[b][0])]
                y += q[wp.static(dofs[b][0] + 1)]
            if wp.static(joint[b] != "prismatic"):
                angle += q[wp.static(dofs[b][-1])]
            if wp.static(parent[b] != WORLD):
                c = out[wp.static(parent[b]), 0]
                sn = out[wp.static(parent[b]), 1]
                angle += phi[wp.static(parent[b])]
                out[b, 2] = out[wp.static(parent[b]), 2] + c * x - sn * y
                out[b, 3] = out[wp.static(parent[b]), 3] + sn * x + c * y
            else:
                out[b, 2] = x
                out[b, 3] = y
            phi[b] = angle
            out[b, 0] = wp.cos(angle)
            out[b, 1] = wp.sin(angle)
        return out

    @cached
    def make_point_jacobian(body: int) -> wp.Function:
        """Jacobian (2, nv) of a point given in world coordinates, fixed to `body` (zero for WORLD)."""
        J2 = t.J2

        @wp.func
        def point_jacobian(world: t.World, fr: FRAMES, x: dtype, y: dtype):
            out = J2()
            for j in range(wp.static(NV)):
                if wp.static(s.turns(body, j)):
                    out[0, j] = fr[wp.static(s.dof_body[j]), 3] - y
                    out[1, j] = x - fr[wp.static(s.dof_body[j]), 2]
                if wp.static(s.in_chain(body, j) and s.dof_kind[j] == PRISMATIC):
                    ax = ONE
                    ay = ZERO
                    if wp.static(joint[s.dof_body[j]] == "prismatic"):
                        ax = world.params[wp.static(AXIS + 2 * s.dof_body[j])]
                        ay = world.params[wp.static(AXIS + 2 * s.dof_body[j] + 1)]
                    if wp.static(joint[s.dof_body[j]] == "free" and dofs[s.dof_body[j]][1] == j):
                        ax = ZERO
                        ay = ONE
                    if wp.static(parent[s.dof_body[j]] == WORLD):
                        out[0, j] = ax
                        out[1, j] = ay
                    else:
                        c = fr[wp.static(parent[s.dof_body[j]]), 0]
                        sn = fr[wp.static(parent[s.dof_body[j]]), 1]
                        out[0, j] = c * ax - sn * ay
                        out[1, j] = sn * ax + c * ay
            return out

        return point_jacobian

    return SimpleNamespace(types=t, frames=frames, point_jacobian=make_point_jacobian)


@cached
def make_second(s: Structure, body: int, dtype: type) -> wp.Function:
    """(J, w) -> P2(w, .): columns sum_i w_i d2p/dq_i dq_k of a point on `body` with Jacobian J, (2, nv)."""
    t = make_types(s, dtype)
    ZERO = dtype(0.0)

    @wp.func
    def second(jac: t.J2, w: t.VQ):
        out = t.J2()
        for k in range(wp.static(s.nv)):
            if wp.static(s.in_chain(body, k)):
                rate = ZERO
                x = ZERO
                y = ZERO
                for i in range(wp.static(s.nv)):
                    if wp.static(i <= k and s.turns(body, i)):
                        rate += w[i]
                    if wp.static(i > k and s.in_chain(body, i) and s.turns(body, k)):
                        x += w[i] * jac[0, i]
                        y += w[i] * jac[1, i]
                out[0, k] = -(rate * jac[1, k] + y)
                out[1, k] = rate * jac[0, k] + x
        return out

    return second
