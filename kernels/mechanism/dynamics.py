"""Kinematics and dynamics of a planar tree in closed form: M(q), r(q, v) of the equations of motion (1a).

`kinematics.py` has the frames and the Jacobians of points, `springs.py` the forces between points.
"""

from types import SimpleNamespace
from typing import Any

import warp as wp

from ..factories import cached
from ..structure import Structure, layout
from .kinematics import make_kinematics, make_types
from .springs import make_spring
from .tendons import make_drive, make_tendon

# of a diagonal entry of M that may be left of it by elimination: below, M^-1 has too few digits for the
# equation of motion to hold to a per cent
LOST = {wp.float64: 2e-14, wp.float32: 1e-5}


@cached
def make_mechanism(s: Structure, dtype: type) -> SimpleNamespace:
    """Warp functions of one mechanism, those of its kinematics among them."""
    kin = make_kinematics(s, dtype)
    t = kin.types
    lay = layout(s)
    NB, NV = s.nb, s.nv
    ZERO, TWO = dtype(0.0), dtype(2.0)
    VQ, MQ, FRAMES, JB = t.VQ, t.MQ, t.FRAMES, t.JB
    MASS, INERTIA, COM, GRAVITY, DAMPING, GEAR = (
        lay.offset(n) for n in ("mass", "inertia", "com", "gravity", "damping", "gear")
    )
    STIFFNESS, REST = (lay.offset(n) if s.sprung else 0 for n in ("stiffness", "rest"))
    ARMATURE = lay.offset("armature") if s.armature else 0
    springs = tuple(make_spring(s, i, dtype) for i in range(len(s.springs)))
    tendons = tuple(make_tendon(s, i, dtype) for i in range(len(s.tendons)))
    drives = tuple(make_drive(s, i, dtype) for i in range(s.nu))
    jacobian_of = tuple(kin.point_jacobian(b) for b in range(NB))

    @wp.func
    def com_jacobians(world: t.World, fr: FRAMES):
        """Jacobians of all centres of mass, rows (2b, 2b + 1)."""
        out = JB()
        for b in range(wp.static(NB)):
            cx = world.params[wp.static(COM + 2 * b)]
            cy = world.params[wp.static(COM + 2 * b + 1)]
            x = fr[b, 2] + fr[b, 0] * cx - fr[b, 1] * cy
            y = fr[b, 3] + fr[b, 1] * cx + fr[b, 0] * cy
            jac = wp.static(jacobian_of[b])(world, fr, x, y)
            for j in range(wp.static(NV)):
                if wp.static(s.in_chain(b, j)):
                    out[wp.static(2 * b), j] = jac[0, j]
                    out[wp.static(2 * b + 1), j] = jac[1, j]
        return out

    @wp.func
    def pose(world: t.World, q: VQ):
        """Frames and Jacobians of the bodies at q."""
        out = t.Pose()
        out.q = q
        out.frames = wp.static(kin.frames)(world, q)
        out.jacobians = com_jacobians(world, out.frames)
        return out

    @wp.func
    def mass_matrix(world: t.World, jac: JB):
        """M(q), symmetric positive definite."""
        m = MQ()
        for b in range(wp.static(NB)):
            mass = world.params[wp.static(MASS + b)]
            for i in range(wp.static(NV)):
                for j in range(wp.static(i + 1)):
                    if wp.static(s.in_chain(b, i) and s.in_chain(b, j)):
                        value = mass * (
                            jac[wp.static(2 * b), i] * jac[wp.static(2 * b), j]
                            + jac[wp.static(2 * b + 1), i] * jac[wp.static(2 * b + 1), j]
                        )
                        if wp.static(s.turns(b, i) and s.turns(b, j)):
                            value += world.params[wp.static(INERTIA + b)]
                        m[i, j] = m[i, j] + value
        for i in range(wp.static(NV)):
            for j in range(wp.static(i)):
                m[j, i] = m[i, j]
            if wp.static(i in s.armature):
                m[i, i] = m[i, i] + world.params[wp.static(ARMATURE + i)]
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
    def force(world: t.World, pose: t.Pose, v: VQ):
        """r(q, v): gravity, centripetal and Coriolis terms, joint damping and stiffness, springs, tendons."""
        out = VQ()
        jac = pose.jacobians
        gx = world.params[wp.static(GRAVITY)]
        gy = world.params[wp.static(GRAVITY + 1)]
        for j in range(wp.static(NV)):
            out[j] = -world.params[wp.static(DAMPING + j)] * v[j]
            if wp.static(j in s.sprung):
                out[j] = out[j] - world.params[wp.static(STIFFNESS + j)] * (
                    pose.q[j] - world.params[wp.static(REST + j)]
                )
        for b in range(wp.static(NB)):
            mass = world.params[wp.static(MASS + b)]
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
        for i in range(wp.static(len(springs))):
            out = wp.static(springs[i].force)(world, pose.frames, v, out)
        for i in range(wp.static(len(tendons))):
            out = wp.static(tendons[i].force)(world, pose.q, v, out)
        return out

    @wp.func
    def control_force(world: t.World, u: t.VU):
        """Generalised force of the actuators."""
        out = VQ()
        for i in range(wp.static(s.nu)):
            out = wp.static(drives[i].push)(world, world.params[wp.static(GEAR + i)] * u[i], out)
        return out

    @wp.func
    def body_force(world: t.World, jac: JB):
        """Generalised force of (fx, fy, torque) at every centre of mass."""
        out = VQ()
        for b in range(wp.static(NB)):
            for j in range(wp.static(NV)):
                if wp.static(s.in_chain(b, j)):
                    out[j] = out[j] + jac[wp.static(2 * b), j] * world.external[wp.static(3 * b)]
                    out[j] = out[j] + jac[wp.static(2 * b + 1), j] * world.external[wp.static(3 * b + 1)]
                if wp.static(s.turns(b, j)):
                    out[j] = out[j] + world.external[wp.static(3 * b + 2)]
        return out

    return SimpleNamespace(
        types=t,
        frames=kin.frames,
        point_jacobian=kin.point_jacobian,
        pose=pose,
        mass_matrix=mass_matrix,
        force=force,
        control_force=control_force,
        body_force=body_force,
        bias_weights=bias_weights_of,
        inverse=make_inverse(s, dtype),
    )


@cached
def make_inverse(s: Structure, dtype: type) -> Any:
    """Inverse of M by Cholesky factors, skipping entries that the tree makes zero; not a number where all
    but LOST of a diagonal entry cancels, as in a chain whose light bodies carry far heavier ones: in a pivot,
    or in several together (max M_ii (M^-1)_ii, what a relative error of M_ii costs).
    """
    MQ = make_types(s, dtype).MQ
    NV = s.nv
    ZERO, ONE = dtype(0.0), dtype(1.0)
    SHARE = dtype(LOST[dtype])
    fill = fill_pattern(s)
    LARGEST = dtype(1.0 / LOST[dtype])
    coupled = tuple(any(fill[i][j] or fill[j][i] for j in range(NV) if j != i) for i in range(NV))

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
            root = ONE / wp.sqrt(wp.where(diag > SHARE * m[j, j], diag, ZERO - ONE))
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

    @wp.func
    def checked(m: MQ):
        out = inverse(m)
        for i in range(wp.static(NV)):
            if wp.static(coupled[i]):
                if not (m[i, i] * out[i, i] <= LARGEST):
                    out[i, i] = wp.sqrt(ZERO - ONE)
        return out

    return checked if any(coupled) and dtype is wp.float32 else inverse


def fill_pattern(s: Structure) -> tuple[tuple[bool, ...], ...]:
    """Entries of L and of L^-1 that can differ from zero, as the transitive closure of M's pattern."""
    fill = [[s.coupled(i, j) or i == j for j in range(s.nv)] for i in range(s.nv)]
    for k in range(s.nv):
        for i in range(s.nv):
            for j in range(s.nv):
                fill[i][j] = fill[i][j] or (fill[i][k] and fill[k][j])
    return tuple(tuple(row) for row in fill)
