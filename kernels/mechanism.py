"""Kinematics and dynamics of a planar tree in closed form: M(q), r(q, v) of the equations of motion (1a).

In the plane every derivative of a point p on a body is a rotated column of its Jacobian: with degrees of
freedom numbered along the chain, d^n p / dq_i..dq_m = perp^(n-1) J_max when all but the deepest index are
revolute, and zero otherwise (perp turns by +90 degrees). Sensitivities use the same rule (see
`sensitivity.py`, `curvature.py`).
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from .structure import PRISMATIC, WORLD, Structure, layout


@functools.cache
def make_types(s: Structure, dtype: type) -> SimpleNamespace:
    """Warp vector and matrix types of a structure: VQ (nv), VX (2 nv), VU (nu), VR (nr), V2, MQ (nv, nv),
    ...
    """
    nv, nu, nr = s.nv, max(s.nu, 1), max(s.nr, 1)
    vector, matrix = wp.types.vector, wp.types.matrix
    return SimpleNamespace(
        V2=vector(2, dtype),
        VQ=vector(nv, dtype),
        VX=vector(2 * nv, dtype),
        VU=vector(nu, dtype),
        VR=vector(nr, dtype),
        MQ=matrix((nv, nv), dtype),
        FRAMES=matrix((s.nb, 4), dtype),
        JB=matrix((2 * s.nb, nv), dtype),
        JR=matrix((nr, nv), dtype),
        J2=matrix((2, nv), dtype),
    )


@functools.cache
def make_mechanism(s: Structure, dtype: type) -> SimpleNamespace:
    """Warp functions of one mechanism; FRAMES holds a row (cos, sin, x, y) per body: orientation and joint
    position.
    """
    t = make_types(s, dtype)
    lay = layout(s)
    NB, NV = s.nb, s.nv
    ZERO, ONE, TWO = dtype(0.0), dtype(1.0), dtype(2.0)
    VQ, MQ, FRAMES, JB = t.VQ, t.MQ, t.FRAMES, t.JB
    PHI = wp.types.vector(NB, dtype)
    parent = tuple(b.parent for b in s.bodies)
    joint = tuple(b.joint for b in s.bodies)
    dofs = tuple(b.dofs for b in s.bodies)
    ANCHOR, ANGLE, AXIS, COM = (lay.offset(n) for n in ("anchor", "angle", "axis", "com"))
    MASS, INERTIA, GRAVITY, DAMPING, GEAR = (
        lay.offset(n) for n in ("mass", "inertia", "gravity", "damping", "gear")
    )

    @wp.func
    def frames(params: wp.array2d(dtype=dtype), row: int, q: VQ):
        """Orientation and joint position of every body."""
        out = FRAMES()
        phi = PHI()
        for b in range(wp.static(NB)):
            c = ONE
            sn = ZERO
            x = params[row, wp.static(ANCHOR + 2 * b)]
            y = params[row, wp.static(ANCHOR + 2 * b + 1)]
            angle = params[row, wp.static(ANGLE + b)]
            if wp.static(joint[b] == "prismatic"):
                x += params[row, wp.static(AXIS + 2 * b)] * q[wp.static(dofs[b][0])]
                y += params[row, wp.static(AXIS + 2 * b + 1)] * q[wp.static(dofs[b][0])]
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

    def make_point_jacobian(body: int) -> wp.Function:
        """Jacobian (2, nv) of a point given in world coordinates, fixed to `body` (zero for WORLD)."""
        J2 = t.J2

        @wp.func
        def point_jacobian(params: wp.array2d(dtype=dtype), row: int, fr: FRAMES, x: dtype, y: dtype):
            out = J2()
            for j in range(wp.static(NV)):
                if wp.static(s.turns(body, j)):
                    out[0, j] = fr[wp.static(s.dof_body[j]), 3] - y
                    out[1, j] = x - fr[wp.static(s.dof_body[j]), 2]
                if wp.static(s.in_chain(body, j) and s.dof_kind[j] == PRISMATIC):
                    ax = ONE
                    ay = ZERO
                    if wp.static(joint[s.dof_body[j]] == "prismatic"):
                        ax = params[row, wp.static(AXIS + 2 * s.dof_body[j])]
                        ay = params[row, wp.static(AXIS + 2 * s.dof_body[j] + 1)]
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

    jacobian_of = tuple(make_point_jacobian(b) for b in range(NB))

    @wp.func
    def com_jacobians(params: wp.array2d(dtype=dtype), row: int, fr: FRAMES):
        """Jacobians of all centres of mass, rows (2b, 2b + 1)."""
        out = JB()
        for b in range(wp.static(NB)):
            cx = params[row, wp.static(COM + 2 * b)]
            cy = params[row, wp.static(COM + 2 * b + 1)]
            x = fr[b, 2] + fr[b, 0] * cx - fr[b, 1] * cy
            y = fr[b, 3] + fr[b, 1] * cx + fr[b, 0] * cy
            jac = wp.static(jacobian_of[b])(params, row, fr, x, y)
            for j in range(wp.static(NV)):
                if wp.static(s.in_chain(b, j)):
                    out[wp.static(2 * b), j] = jac[0, j]
                    out[wp.static(2 * b + 1), j] = jac[1, j]
        return out

    @wp.func
    def mass_matrix(params: wp.array2d(dtype=dtype), row: int, jac: JB):
        """M(q), symmetric positive definite."""
        m = MQ()
        for b in range(wp.static(NB)):
            mass = params[row, wp.static(MASS + b)]
            for i in range(wp.static(NV)):
                for j in range(wp.static(i + 1)):
                    if wp.static(s.in_chain(b, i) and s.in_chain(b, j)):
                        value = mass * (
                            jac[wp.static(2 * b), i] * jac[wp.static(2 * b), j]
                            + jac[wp.static(2 * b + 1), i] * jac[wp.static(2 * b + 1), j]
                        )
                        if wp.static(s.turns(b, i) and s.turns(b, j)):
                            value += params[row, wp.static(INERTIA + b)]
                        m[i, j] = m[i, j] + value
        for i in range(wp.static(NV)):
            for j in range(wp.static(i)):
                m[j, i] = m[i, j]
        return m

    def make_bias_weights(body: int) -> wp.Function:
        """s with p'' at zero joint acceleration = sum_k perp(J_k) s_k (centripetal and Coriolis)."""

        @wp.func
        def bias_weights(v: VQ):
            out = VQ()
            for k in range(wp.static(NV)):
                if wp.static(s.in_chain(body, k)):
                    rate = ZERO
                    for j in range(wp.static(k)):
                        if wp.static(s.turns(body, j)):
                            rate += TWO * v[j]
                    if wp.static(s.turns(body, k)):
                        rate += v[k]
                    out[k] = rate * v[k]
            return out

        return bias_weights

    bias_weights_of = tuple(make_bias_weights(b) for b in range(NB))

    @wp.func
    def force(params: wp.array2d(dtype=dtype), row: int, jac: JB, v: VQ):
        """r(q, v): gravity, centripetal and Coriolis terms, joint damping."""
        out = VQ()
        gx = params[row, wp.static(GRAVITY)]
        gy = params[row, wp.static(GRAVITY + 1)]
        for j in range(wp.static(NV)):
            out[j] = -params[row, wp.static(DAMPING + j)] * v[j]
        for b in range(wp.static(NB)):
            mass = params[row, wp.static(MASS + b)]
            weights = wp.static(bias_weights_of[b])(v)
            ax = gx
            ay = gy
            for k in range(wp.static(NV)):
                if wp.static(s.in_chain(b, k)):
                    ax += jac[wp.static(2 * b + 1), k] * weights[k]
                    ay -= jac[wp.static(2 * b), k] * weights[k]
            for j in range(wp.static(NV)):
                if wp.static(s.in_chain(b, j)):
                    out[j] = out[j] + mass * (
                        jac[wp.static(2 * b), j] * ax + jac[wp.static(2 * b + 1), j] * ay
                    )
        return out

    @wp.func
    def control_force(params: wp.array2d(dtype=dtype), row: int, u: t.VU):
        """Generalised force of the actuators."""
        out = VQ()
        for i in range(wp.static(s.nu)):
            out[wp.static(s.actuators[i])] = (
                out[wp.static(s.actuators[i])] + params[row, wp.static(GEAR + i)] * u[i]
            )
        return out

    @wp.func
    def body_force(
        params: wp.array2d(dtype=dtype), row: int, jac: JB, external: wp.array2d(dtype=dtype), world: int
    ):
        """Generalised force of (fx, fy, torque) at every centre of mass."""
        out = VQ()
        for b in range(wp.static(NB)):
            for j in range(wp.static(NV)):
                if wp.static(s.in_chain(b, j)):
                    out[j] = out[j] + jac[wp.static(2 * b), j] * external[world, wp.static(3 * b)]
                    out[j] = out[j] + jac[wp.static(2 * b + 1), j] * external[world, wp.static(3 * b + 1)]
                if wp.static(s.turns(b, j)):
                    out[j] = out[j] + external[world, wp.static(3 * b + 2)]
        return out

    return SimpleNamespace(
        types=t,
        frames=frames,
        point_jacobian=make_point_jacobian,
        com_jacobians=com_jacobians,
        mass_matrix=mass_matrix,
        force=force,
        control_force=control_force,
        body_force=body_force,
        bias_weights=bias_weights_of,
        inverse=make_inverse(s, dtype),
    )


@functools.cache
def make_inverse(s: Structure, dtype: type) -> Any:
    """Inverse of M by Cholesky factors, skipping entries that the tree makes zero."""
    MQ = make_types(s, dtype).MQ
    NV = s.nv
    ZERO, ONE = dtype(0.0), dtype(1.0)
    fill = _fill_pattern(s)

    @wp.func
    def inverse(m: MQ):
        # L^-1 row by row (M = L L'), then M^-1 = L^-T L^-1
        low = MQ()
        inv = MQ()
        for j in range(wp.static(NV)):
            diag = m[j, j]
            for k in range(wp.static(j)):
                if wp.static(fill[j][k]):
                    diag -= low[j, k] * low[j, k]
            root = ONE / wp.sqrt(diag)
            inv[j, j] = root
            for i in range(wp.static(j + 1), wp.static(NV)):
                if wp.static(fill[i][j]):
                    value = m[i, j]
                    for k in range(wp.static(j)):
                        if wp.static(fill[i][k] and fill[j][k]):
                            value -= low[i, k] * low[j, k]
                    low[i, j] = value * root
        for j in range(wp.static(NV)):
            for i in range(wp.static(j + 1), wp.static(NV)):
                value = ZERO
                for k in range(wp.static(j), wp.static(i)):
                    if wp.static(fill[i][k] and fill[k][j]):
                        value += low[i, k] * inv[k, j]
                inv[i, j] = -value * inv[i, i]
        out = MQ()
        for i in range(wp.static(NV)):
            for j in range(wp.static(i + 1)):
                value = ZERO
                for k in range(wp.static(i), wp.static(NV)):
                    if wp.static(fill[k][i] and fill[k][j]):
                        value += inv[k, i] * inv[k, j]
                out[i, j] = value
                out[j, i] = value
        return out

    return inverse


def _fill_pattern(s: Structure) -> tuple[tuple[bool, ...], ...]:
    """Entries of L and of L^-1 that can differ from zero, as the transitive closure of M's pattern."""
    fill = [[s.coupled(i, j) or i == j for j in range(s.nv)] for i in range(s.nv)]
    for k in range(s.nv):
        for i in range(s.nv):
            for j in range(s.nv):
                fill[i][j] = fill[i][j] or (fill[i][k] and fill[k][j])
    return tuple(tuple(row) for row in fill)
