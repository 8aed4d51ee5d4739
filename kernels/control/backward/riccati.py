"""The backward pass of DDP, one problem per thread (Tassa & Todorov 2010, section III-C).

Notation: z = (x, u), primes are transposes, V is the value function of the next step. Backwards in time,
(M33) to (M35):

    Q_x  = l_x + f_x' V_x                      Q_u  = l_u + f_u' V_x
    Q_xx = l_xx + f_x' V_xx f_x + V_x.f_xx     (11); Q_ux and Q_uu alike
    k = -R^-1 Q_u,  K = -R^-1 S                (12), with R, S the regularised Q_uu, Q_ux
    V_x  = Q_x + K' Q_uu k + K' Q_u + Q_ux' k
    V_xx = Q_xx + K' Q_uu K + K' Q_ux + Q_ux' K

R = Q_uu + mu (w_x f_u' f_u + w_u I), S = Q_ux + mu w_x f_u' f_x: the weights w_x, w_u choose regularisation
of the state or of the control (Tassa, Erez & Todorov 2012, section II-F). Where R is not positive definite,
mu is raised and the pass starts again in the same kernel. The value update holds for any K, k, so it needs no
regularisation.

The first-order method (9)-(10) is the same pass with R = l_uu + mu (w_x + w_u) I, K = 0 and no V_xx: for a
quadratic running cost k = u* - u exactly; for others it is one Newton step towards u*, continued by the next
pass.
"""

import warp as wp

from ...device.compile import named_by_code
from ...factories import cached
from ..solver_state import (
    SolverState,
    make_derivative_arrays,
    make_policy_arrays,
    raise_regularization,
    schedule_row,
)
from ..status import SCHEDULE_CONTROL, SCHEDULE_STATE
from .riccati_parts import WEIGHED, make_pass_parts


@cached
def make_backward_kernel(nx, nu, nw, method, has_limits, dtype):
    """Kernel ``(first, Derivatives, Policy, SolverState, gradient_tolerance, last)`` over problems.

    Of nw = WEIGHED curved outputs second derivatives are one.

    Writes K, k, Vx, Vxx and, in the state, the expected change, largest |Q_u|, smallest pivot, mu and status.
    With ``last`` = 1 a problem still running ends at its iteration limit. Problems with ``active`` = 0 are
    skipped.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    MXX, MXU = wp.types.matrix((nx, nx), dtype), wp.types.matrix((nx, nu), dtype)
    MUX, MUU = wp.types.matrix((nu, nx), dtype), wp.types.matrix((nu, nu), dtype)
    Derivatives, Policy = make_derivative_arrays(dtype), make_policy_arrays(dtype)
    parts = make_pass_parts(nx, nu, method, has_limits, dtype)
    cholesky, direction, steepest = parts.cholesky, parts.direction, parts.steepest
    final_value, linearised, end = parts.final_value, parts.linearised, parts.end
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    outputs = 1 if nw == WEIGHED else nw
    curved = method == "second-order"
    quadratic = method != "first-order"

    @wp.func
    def model(d: Derivatives, b: int, k: int, vx: VX, vxx: MXX, fx: MXX, fu: MXU):
        """Unminimised value (11): Q_x, Q_u, Q_xx, Q_ux, Q_uu of step k."""
        qx, qu = VX(), VU()
        qxx, qux, quu = MXX(), MUX(), MUU()
        for i in range(nx):
            qx[i] = d.lx[b, k, i]
            for j in range(nx):
                qxx[i, j] = d.lxx[b, k, i, j]
        for i in range(nu):
            qu[i] = d.lu[b, k, i]
            for j in range(nx):
                qux[i, j] = d.lux[b, k, i, j]
            for j in range(nu):
                quu[i, j] = d.luu[b, k, i, j]
        qx = qx + wp.transpose(fx) * vx
        qu = qu + wp.transpose(fu) * vx
        if wp.static(quadratic):
            product = vxx * fx
            qxx = qxx + wp.transpose(fx) * product
            qux = qux + wp.transpose(fu) * product
            quu = quu + wp.transpose(fu) * (vxx * fu)
        if wp.static(curved):
            cell = b * d.fx.shape[1] + k
            for i in range(outputs):
                y = ONE
                if wp.static(nw != WEIGHED):
                    y = ZERO
                    for j in range(nx):
                        y += d.lift[b, i, j] * vx[j]
                for r in range(nx):
                    for c in range(r + 1):
                        value = y * d.second[cell, i, r, c]
                        qxx[r, c] += value
                        if c < r:
                            qxx[c, r] += value
                for r in range(nu):
                    for c in range(nx):
                        qux[r, c] += y * d.second[cell, i, nx + r, c]
                    for c in range(nu):
                        quu[r, c] += y * d.second[cell, i, nx + r, nx + c]
        return qx, qu, qxx, qux, quu

    @wp.func
    def shifted(policy: Policy, b: int, k: int, vx: VX, vxx: MXX):
        """V_x at f(x_k, u_k), beyond the gap to x_{k+1}, and the change of V on the way (M43), (M44)."""
        gap = VX()
        for i in range(nx):
            gap[i] = policy.gaps[b, k, i]
        bent = vxx * gap
        return vx + bent, wp.float64(wp.dot(vx, gap)) + wp.float64(HALF * wp.dot(gap, bent))

    @wp.func
    def terms(d: Derivatives, b: int, k: int, vx: VX, fu: MXU):
        """Sizes of the terms of Q_u = l_u + f_u' V_x."""
        out = VU()
        for i in range(nu):
            out[i] = wp.abs(d.lu[b, k, i])
            for j in range(nx):
                out[i] += wp.abs(fu[j, i] * vx[j])
        return out

    @wp.func
    def jacobians(d: Derivatives, b: int, k: int):
        """f_x and f_u of step k."""
        fx, fu = MXX(), MXU()
        for i in range(nx):
            for j in range(nx):
                fx[i, j] = d.fx[b, k, i, j]
            for j in range(nu):
                fu[i, j] = d.fu[b, k, i, j]
        return fx, fu

    @wp.func
    def regularised(quu: MUU, qux: MUX, fx: MXX, fu: MXU, mu_x: dtype, mu_u: dtype):
        """R and S."""
        ruu, rux = quu, qux
        if wp.static(quadratic):
            if mu_x != ZERO:
                ruu = ruu + mu_x * (wp.transpose(fu) * fu)
                rux = rux + mu_x * (wp.transpose(fu) * fx)
        for i in range(nu):
            ruu[i, i] += mu_u
        return ruu, rux

    @wp.func
    def value(qx: VX, qu: VU, qxx: MXX, qux: MUX, quu: MUU, bent: VU, step: VU, gain: MUX, vxx: MXX):
        """V_x and V_xx under the policy; of the first-order method V_xx stays."""
        if wp.static(quadratic):
            vx = qx + wp.transpose(gain) * (bent + qu) + wp.transpose(qux) * step
            cross = wp.transpose(gain) * qux
            out = qxx + wp.transpose(gain) * (quu * gain) + cross + wp.transpose(cross)
            out = HALF * (out + wp.transpose(out))
        else:
            vx = qx
            out = vxx
        return vx, out

    @wp.func
    def store(policy: Policy, b: int, k: int, vx: VX, vxx: MXX, step: VU, gain: MUX):
        for i in range(nx):
            policy.Vx[b, k, i] = vx[i]
            for j in range(nx):
                policy.Vxx[b, k, i, j] = vxx[i, j]
        for i in range(nu):
            policy.k[b, k, i] = step[i]
            for j in range(nx):
                policy.K[b, k, i, j] = gain[i, j]

    @named_by_code(max_unroll=1)
    def backward(
        first: int, d: Derivatives, policy: Policy, state: SolverState, tolerance: wp.float64, last: int
    ):
        # long: what a thread keeps over the whole pass is in registers, all 255 of sm_90; as a struct that
        # functions hand on it takes 72 bytes of local memory
        b = first + wp.tid()
        if state.active[b] == 0:
            return
        if not linearised(d, policy, state, b):
            return
        horizon = policy.us.shape[1]
        row = schedule_row(state, b)
        limits = wp.where(policy.lower.shape[0] == 1, 0, b)
        unsolved = int(1)
        restarts = int(0)
        broken = int(0)
        lowest = wp.float64(0.0)  # pivot of Q_uu
        change_1 = wp.float64(0.0)  # expected, of first and of second order in the step size
        change_2 = wp.float64(0.0)
        felt = ZERO  # what the terms of Q_u by themselves would gain
        wanted = ZERO  # largest |V_x|
        highest, widest = VU(), VU()  # largest |Q_u| of each control, and of the sum of its terms' sizes
        while unsolved == 1:
            mu_x = dtype(state.mu[b] * state.schedule[row, SCHEDULE_STATE])
            mu_u = dtype(state.mu[b] * state.schedule[row, SCHEDULE_CONTROL])
            if wp.static(not quadratic):  # no V_xx to regularise
                mu_u += mu_x
            change_1 = wp.float64(0.0)
            change_2 = wp.float64(0.0)
            felt = ZERO
            wanted = ZERO
            highest, widest = VU(), VU()
            broken = int(0)
            step = VU()
            vx, vxx = final_value(d, policy, b, horizon)
            k = horizon - 1
            good = int(1)
            while good == 1 and k >= 0:
                fx, fu = jacobians(d, b, k)
                if policy.gaps.shape[0] > 0:
                    beyond, change = shifted(policy, b, k, vx, vxx)
                    vx = beyond
                    change_1 += change
                qx, qu, qxx, qux, quu = model(d, b, k, vx, vxx, fx, fu)
                for j in range(nx):
                    wanted = wp.max(wanted, wp.abs(vx[j]))
                ruu, rux = regularised(quu, qux, fx, fu, mu_x, mu_u)
                new_step, gain, free_quu, pivot = direction(policy, b, k, limits, ruu, rux, qu, quu, step)
                step = new_step
                if not (pivot > ZERO) or not wp.isfinite(step) or not wp.isfinite(qx):
                    good = 0
                    if not wp.isfinite(pivot) or not wp.isfinite(qx) or not wp.isfinite(qu):
                        broken = 1
                else:
                    bare = pivot
                    if mu_x != ZERO or mu_u != ZERO:
                        ignored, bare = cholesky(free_quu)
                    if k == horizon - 1 or wp.float64(bare) < lowest:
                        lowest = wp.float64(bare)
                    sizes = terms(d, b, k, vx, fu)
                    slopes = steepest(policy, b, k, limits, qu)
                    for i in range(nu):
                        highest[i] = wp.max(highest[i], slopes[i])
                        widest[i] = wp.max(widest[i], sizes[i])
                        felt += sizes[i] * sizes[i] / wp.max(ruu[i, i], ZERO)  # a held one may bend down
                    bent = quu * step
                    change_1 += wp.float64(wp.dot(step, qu))
                    change_2 += wp.float64(HALF * wp.dot(step, bent))
                    vx, vxx = value(qx, qu, qxx, qux, quu, bent, step, gain, vxx)
                    store(policy, b, k, vx, vxx, step, gain)
                    k -= 1
            if good == 1:
                unsolved = 0
            elif raise_regularization(state, b) == 0:
                unsolved = 2
            else:
                restarts += 1
        end(
            policy, state, b, unsolved, restarts, broken, lowest, change_1, change_2, highest, widest, felt,
            wanted, tolerance, last,
        )  # fmt: skip

    return backward
