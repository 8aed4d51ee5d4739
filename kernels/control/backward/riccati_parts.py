"""What the backward passes of DDP share, whatever threads make one: a step's direction, and a pass's end."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..solver_state import SolverState, make_derivative_arrays, make_drop_policy, make_policy_arrays
from ..status import (
    CONVERGED,
    DYNAMICS_FAILED,
    FLAT,
    MAX_ITERATIONS,
    REGULARIZATION_LIMIT,
    RUNNING,
    TRACE_COST,
    TRACE_GRADIENT,
    TRACE_PIVOT,
    TRACE_REGULARIZATION,
    TRACE_RESTARTS,
)
from .box_qp import EPSILON, make_small_solver

WEIGHED = -1  # curved outputs where second derivatives come weighed, as one (`weights.py`)
METHODS = ("second-order", "gauss-newton", "first-order")


@cached
def make_pass_parts(nx, nu, method, has_limits, dtype):
    """Warp functions of a backward pass, see `riccati.py`."""
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    MXX = wp.types.matrix((nx, nx), dtype)
    MUX, MUU = wp.types.matrix((nu, nx), dtype), wp.types.matrix((nu, nu), dtype)
    Derivatives, Policy = make_derivative_arrays(dtype), make_policy_arrays(dtype)
    small = make_small_solver(nx, nu, dtype)
    cholesky, solve_vector, solve_matrix = small.cholesky, small.solve_vector, small.solve_matrix
    box_qp, masked = small.box_qp, small.masked
    drop_policy = make_drop_policy(nx, nu, dtype)
    ZERO = dtype(0.0)
    ROUNDING, PROMISE = wp.float64(8.0 * EPSILON[dtype]), wp.float64(64.0)
    SQUARE = wp.float64(EPSILON[dtype])  # of the least tolerance that tells something of J
    quadratic = method != "first-order"

    @wp.func
    def price_gaps(state: SolverState, b: int, change: wp.float64):
        """Raise the price of open gaps until the full step promises to lower the merit."""
        if state.gap[b] > wp.float64(0.0):
            need = wp.float64(2.0) * change / state.gap[b]
            state.gap_price[b] = wp.max(state.gap_price[b], need)

    @wp.func
    def steepest(policy: Policy, b: int, k: int, row: int, qu: VU):
        """|Q_u| of the controls that their limits do not hold, 0 of those that they do."""
        out = VU()
        for i in range(nu):
            size = wp.abs(qu[i])
            if wp.static(has_limits):
                u = policy.us[b, k, i]
                if (u <= policy.lower[row, i] and qu[i] > ZERO) or (
                    u >= policy.upper[row, i] and qu[i] < ZERO
                ):
                    size = ZERO
            out[i] = size
        return out

    @wp.func
    def direction(
        policy: Policy, b: int, k: int, limits: int, ruu: MUU, rux: MUX, qu: VU, quu: MUU, before: VU
    ):
        """k, K, Q_uu of the controls that no limit holds, the smallest pivot of R; from `before` on."""
        gain = MUX()
        free_quu = quu
        rows = rux
        if wp.static(has_limits):
            low, high = VU(), VU()
            for i in range(nu):
                low[i] = policy.lower[limits, i] - policy.us[b, k, i]
                high[i] = policy.upper[limits, i] - policy.us[b, k, i]
            step, free, factor, pivot = box_qp(ruu, qu, low, high, before)
            free_quu = masked(quu, free)
            if wp.static(quadratic):
                for i in range(nu):
                    for j in range(nx):
                        rows[i, j] = rows[i, j] * free[i]
        else:
            factor, pivot = cholesky(ruu)
            step = -solve_vector(factor, qu)
        if wp.static(quadratic):
            gain = -solve_matrix(factor, rows)
        return step, gain, free_quu, pivot

    @wp.func
    def final_value(d: Derivatives, policy: Policy, b: int, horizon: int):
        """V_x and V_xx of the final cost, which are stored."""
        vx, vxx = VX(), MXX()
        for i in range(nx):
            vx[i] = d.lx[b, horizon, i]
            policy.Vx[b, horizon, i] = vx[i]
            for j in range(nx):
                vxx[i, j] = d.lxx[b, horizon, i, j]
                policy.Vxx[b, horizon, i, j] = vxx[i, j]
        return vx, vxx

    @wp.func
    def trace(state: SolverState, b: int, good: bool, restarts: int, gradient: wp.float64, pivot: wp.float64):
        row = state.passes[b]
        if row < state.trace.shape[1]:
            state.trace[b, row, TRACE_COST] = state.cost[b]
            state.trace[b, row, TRACE_REGULARIZATION] = state.mu[b]
            state.trace[b, row, TRACE_RESTARTS] = wp.float64(restarts)
            if good:
                state.trace[b, row, TRACE_GRADIENT] = gradient
                state.trace[b, row, TRACE_PIVOT] = pivot

    @wp.func
    def judge(state: SolverState, b: int, felt: dtype, wanted: dtype, tolerance: wp.float64, last: int):
        """Whether the problem ends with this pass."""
        # all that Q_u consists of, were it free, would not be seen in J; yet the state is worth changing, or
        # the point is no minimum. Where passes brought every term of J to 0 there is nothing left to gain
        if state.gap[b] > wp.float64(0.0):  # no trajectory yet
            state.flat[b] = 0
            return
        left = state.size[b] > wp.float64(0.0) or state.passes[b] == 0
        unseen = left and wp.float64(felt) <= ROUNDING * state.size[b]
        worth = wanted > ZERO or not (state.pivot[b] > wp.float64(0.0))
        state.flat[b] = wp.where(unseen and worth, 1, 0)
        # a gradient may be small beside the largest terms of all steps, and yet promise what J can feel: then
        # a line search has to say, or has said, that there is nothing to be had (M53)
        promised = -(state.expected[b, 0] + state.expected[b, 1])
        enough = wp.max(tolerance * tolerance, SQUARE) * state.size[b]
        unheard = state.status[b] == RUNNING and promised > PROMISE * enough
        if state.relative[b] <= tolerance and not unheard:
            state.status[b] = wp.where(state.flat[b] == 1, FLAT, CONVERGED)
        elif state.status[b] == RUNNING and last == 1:
            state.status[b] = MAX_ITERATIONS
        if state.status[b] != RUNNING:
            state.active[b] = 0

    @wp.func
    def linearised(d: Derivatives, policy: Policy, state: SolverState, b: int):
        """Whether all steps have derivatives; where not, the problem has ended."""
        for k in range(policy.us.shape[1]):
            if d.status[b, k] != 0:
                state.status[b] = DYNAMICS_FAILED
        if state.status[b] == DYNAMICS_FAILED:
            drop_policy(policy, b)
            state.active[b] = 0
            state.fresh[b] = 0
            return False
        return True

    @wp.func
    def end(
        policy: Policy,
        state: SolverState,
        b: int,
        unsolved: int,
        restarts: int,
        broken: int,
        lowest: wp.float64,
        change_1: wp.float64,
        change_2: wp.float64,
        highest: VU,
        widest: VU,
        felt: dtype,
        wanted: dtype,
        tolerance: wp.float64,
        last: int,
    ):
        """What a pass leaves in the state."""
        state.fresh[b] = 0
        state.valued[b] = wp.where(unsolved == 0, 1, 0)
        trace(state, b, unsolved == 0, restarts, wp.float64(wp.max(highest)), lowest)
        if unsolved == 2:
            drop_policy(policy, b)
            state.status[b] = wp.where(broken == 1, DYNAMICS_FAILED, REGULARIZATION_LIMIT)
            state.active[b] = 0
            return
        state.expected[b, 0] = change_1
        state.expected[b, 1] = change_2
        price_gaps(state, b, change_1 + change_2)
        state.gradient[b] = wp.float64(wp.max(highest))
        state.pivot[b] = lowest
        relative = ZERO
        for i in range(nu):
            if highest[i] > ZERO:
                relative = wp.max(relative, highest[i] / widest[i])
        state.relative[b] = wp.float64(relative)
        judge(state, b, felt, wanted, tolerance, last)

    return SimpleNamespace(
        cholesky=cholesky,
        steepest=steepest,
        direction=direction,
        final_value=final_value,
        linearised=linearised,
        end=end,
    )
