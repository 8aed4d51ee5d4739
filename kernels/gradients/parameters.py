"""Gradient of one solved step by the physical parameters, exact and in closed form.

The weights of `solvers/dual.py` make the change of weight.v' one of P.F1 and of the rows at the solution.
Every length and angle of the mechanism moves a part of it without changing the joints' motion: shifting
what hangs on a frame by e changes the velocity V(y) of its points under joint rates y by perp(e) times the
frame's rate of turning; turning it about a point o changes V(y) by perp(V(y) - V_o(y)). So each column
needs only velocities of points under the few joint rates in the scalar: P, w, the bias weights, those of
every pair's rows, and M^-1 J_i' where D = diag(A).
"""

import warp as wp

from ..derivatives.sensitivity import make_linearization
from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout
from .damping import make_damped_gradient
from .rows import make_row_gradient
from .trapezoidal import make_trapezoidal_gradient


@cached
def make_parameter_gradient(spec: Specialisation) -> wp.Function:
    """gradient(world, x, u, sol, lin, weight, grad): adds to `grad` the derivative of weight.x' by every
    column of the parameter table.
    """
    s, dtype, method = spec
    if method.trapezoidal:
        return make_trapezoidal_gradient(spec)
    linear = make_linearization(spec)
    response = linear.response
    step = linear.step
    rows, t = step.rows, step.types
    part = make_damped_gradient(spec)
    constraints = make_row_gradient(spec)
    H = layout(s).offset("step_size")
    VQ, VX, VU, VR = t.VQ, t.VX, t.VU, t.VR
    ZERO = dtype(0.0)
    PARTS = 1 if response.complete is None else 2  # forms in M

    @wp.func
    def gradient(
        world: t.World,
        x: VX,
        u: VU,
        sol: step.Solution,
        lin: linear.Linear,
        weight: VX,
        grad: wp.array(dtype=dtype),
    ):
        h = world.params[wp.static(H)]
        q = VQ()
        target = VQ()  # q' = q + h v'
        motion = part.Motion()
        for j in range(wp.static(s.nv)):
            q[j] = x[j]
            motion.v[j] = x[wp.static(s.nv + j)]
            target[j] = weight[wp.static(s.nv + j)] + h * weight[j]
            grad[wp.static(H)] = grad[wp.static(H)] + weight[j] * sol.v[j]
        dual = response.dual(lin.factor, step.posed(sol), sol.lam, sol.z, target)
        motion.p = dual.p
        motion.w = lin.w
        motion.h = h
        motion.kappa = dual.kappa
        force = wp.static(step.mass.matrix)(world, lin.pose) * lin.w / h  # r + u
        for i in range(wp.static(s.nr)):
            if (sol.mask & wp.static(1 << i)) != 0:
                force = wp.static(rows.adds[i])(force, sol.jac, -sol.lam[i] / h)
        grad[wp.static(H)] = grad[wp.static(H)] - wp.dot(dual.p, force)
        term = int(0)
        while term < wp.static(PARTS):
            part.moving(world, lin.pose, u, motion, lin.rows.m, grad)
            if wp.static(PARTS > 1):
                motion.p = dual.left
                motion.w = dual.right
                motion.h = ZERO
                motion.kappa = VR()
            term += 1
        wp.static(constraints)(world, lin.pose, sol, lin, dual, h, grad)

    return gradient
