"""The motion part of the gradient by parameters with what stands for M, N of `effective_mass.py`.

The scalar is P.(N w - h r) - sum_i kappa_i m_i' N m_i, m_i = N^-1 J_i'. Euler's N = M + h C adds h P.C w
to that of M, with implicit stiffness h^2/2 P.K w as well. The trapezoidal rule's is the sum of two
such scalars: with y_X = K^-1 B X

    L.N R = L.M R + h/2 L.C (R + y_R)  -  y_L.M y_R + h/2 y_L.C (R - y_R)

has the derivative that y_L and y_R at fixed values give. By h itself these are C's terms over h.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout
from .motion import make_motion_gradient
from .stiffness import make_stiff_gradient


@cached
def make_damped_gradient(spec: Specialisation) -> SimpleNamespace:
    """moving(world, pose, u, Motion, normals, grad): adds the scalar's derivative by every column, by h
    only that of N. stiffness(..): of P.(M w - h r) with y for dampers.
    """
    s, dtype, method = spec
    part = make_motion_gradient(spec)
    step = part.linear.step
    mass, t = step.mass, step.types
    Motion, dampers = part.Motion, part.dampers
    stiff = make_stiff_gradient(spec)
    VQ, VR, JR, MQ = t.VQ, t.VR, t.JR, t.MQ
    NR = s.nr
    H = layout(s).offset("step_size")
    ZERO, ONE, HALF, TWO = dtype(0.0), dtype(1.0), dtype(0.5), dtype(2.0)

    @wp.func
    def stiffness(world: t.World, pose: t.Pose, u: t.VU, m: Motion, y: VQ, grad: wp.array(dtype=dtype)):
        part.moving(world, pose, u, m, y, JR(), grad)

    @wp.func
    def row_of(rows: JR, i: int):
        out = VQ()
        for j in range(wp.static(s.nv)):
            out[j] = rows[i, j]
        return out

    @wp.func
    def resist(
        world: t.World, pose: t.Pose, c: MQ, h: dtype, kappa: VR, rows: JR, grad: wp.array(dtype=dtype)
    ):
        # - h sum_i kappa_i m_i' C m_i, by h as well
        i = int(0)
        while i < wp.static(NR):
            if kappa[i] != ZERO:
                m = row_of(rows, i)
                dampers(world, pose, -kappa[i] * m, h * m, ZERO, grad)
                slope = h / world.params[wp.static(H)] * kappa[i] * wp.dot(m, c * m)
                grad[wp.static(H)] = grad[wp.static(H)] - slope
            i += 1

    @wp.func
    def moving(
        world: t.World,
        pose: t.Pose,
        u: t.VU,
        m: Motion,
        normals: JR,
        grad: wp.array(dtype=dtype),
    ):
        if wp.static(stiff is not None):
            stiff(world, pose, m.p, m.w, grad)
            if wp.static(part.linear.response.scaled and NR > 0):
                i = int(0)
                while i < wp.static(NR):
                    if m.kappa[i] != ZERO:
                        row = row_of(normals, i)
                        stiff(world, pose, -m.kappa[i] * row, row, grad)
                    i += 1
        if wp.static(not mass.implicit):
            part.moving(world, pose, u, m, VQ(), normals, grad)
        else:
            h = world.params[wp.static(H)]
            c = wp.static(mass.drag)(world, pose.frames, ONE, MQ())
            share = ONE  # of h that N has C with
            spread = MQ()
            if wp.static(mass.trapezoidal):
                share = HALF
                spread = wp.static(mass.spread)(world, pose)
            form = m
            rows = normals
            y = share * (m.w + spread * m.w)
            term = int(0)
            while term < wp.static(2 if mass.trapezoidal else 1):
                seen = form.h * form.v + h * y
                part.moving(world, pose, u, form, seen, rows, grad)
                grad[wp.static(H)] = grad[wp.static(H)] + wp.dot(form.p, c * y)
                if wp.static(part.linear.response.scaled and NR > 0):
                    seen_rows = rows
                    weight = h * share
                    if wp.static(mass.trapezoidal):
                        if term == 0:
                            seen_rows = rows + rows * wp.transpose(spread)
                        else:
                            weight = TWO * weight
                    resist(world, pose, c, weight, form.kappa, seen_rows, grad)
                if wp.static(mass.trapezoidal):
                    form.p = spread * m.p
                    form.w = -(spread * m.w)
                    form.v = VQ()
                    form.h = ZERO
                    form.kappa = -m.kappa
                    rows = normals * wp.transpose(spread)
                    y = share * (m.w + form.w)
                term += 1

    return SimpleNamespace(Motion=Motion, moving=moving, stiffness=stiffness)
