"""Forward pass of DDP: all step sizes of all problems rolled out in one launch, and the choice among them."""

import warp as wp

from ..device.compile import named_by_code, specialised
from ..factories import cached
from .box_qp import EPSILON
from .solver_state import (
    SolverState,
    lower_regularization,
    make_drop_policy,
    make_policy_arrays,
    raise_regularization,
    schedule_row,
)
from .status import (
    CONVERGED,
    DYNAMICS_FAILED,
    FLAT,
    LINE_SEARCH_FAILED,
    RUNNING,
    SCHEDULE_INITIAL,
    SMALL_IMPROVEMENT,
    TRACE_COST,
    TRACE_EXPECTED,
    TRACE_RATIO,
    TRACE_REDUCTION,
    TRACE_STEP_SIZE,
)

NOT_FINITE = 1000  # candidate status of a rollout that left the numbers


@cached
def make_candidate_arrays(dtype):
    """Struct of the trajectories tried, one per problem and step size."""

    @wp.struct
    class Candidates:
        step_sizes: wp.array(dtype=wp.float64)  # (A,)
        xs: wp.array(ndim=4, dtype=dtype)  # (B, A, N+1, nx)
        us: wp.array(ndim=4, dtype=dtype)  # (B, A, N, nu)
        cost: wp.array(ndim=2, dtype=wp.float64)  # (B, A), +inf where the rollout failed
        size: wp.array(ndim=2, dtype=wp.float64)  # (B, A) sum of the sizes of the cost's terms
        status: wp.array(ndim=2, dtype=wp.int32)  # (B, A), 0 or the step's status, NOT_FINITE

    return Candidates


@cached
def make_rollout_kernel(step, initial_carry, running, final, nx, nu, has_limits, dtype):
    """Kernel ``(first, problems, x0, Policy, Candidates, params, weights, active)`` over B A items.

    Item i is problem i mod B under step size i div B: u = clamp(us + alpha k + K (x - xs)), x' = step(x, u),
    costs summed in double precision.
    A failed or non-finite world costs +inf and keeps its last valid state.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    Policy, Candidates = make_policy_arrays(dtype), make_candidate_arrays(dtype)

    @wp.func
    def control(policy: Policy, b: int, k: int, limits: int, alpha: dtype, x: VX):
        """u within its limits."""
        u = VU()
        for i in range(wp.static(nu)):
            value = policy.us[b, k, i] + alpha * policy.k[b, k, i]
            for j in range(wp.static(nx)):
                value += policy.K[b, k, i, j] * (x[j] - policy.xs[b, k, j])
            if wp.static(has_limits):
                if value < policy.lower[limits, i]:
                    value = policy.lower[limits, i]
                if value > policy.upper[limits, i]:
                    value = policy.upper[limits, i]
            u[i] = value
        return u

    @specialised
    def rollout(
        first: int,
        problems: int,
        x0: wp.array2d(dtype=dtype),
        policy: Policy,
        out: Candidates,
        params: wp.array2d(dtype=dtype),
        weights: wp.array2d(dtype=dtype),
        active: wp.array(dtype=wp.int32),
    ):
        item = first + wp.tid()
        a = item / problems
        b = item - a * problems
        if active[b] == 0:
            return
        horizon = policy.us.shape[1]
        row = wp.where(params.shape[0] == 1, 0, b)
        weight_row = wp.where(weights.shape[0] == 1, 0, b)
        limits = wp.where(policy.lower.shape[0] == 1, 0, b)
        alpha = dtype(out.step_sizes[a])
        x = VX()
        for i in range(wp.static(nx)):
            x[i] = x0[b, i]
            out.xs[b, a, 0, i] = x[i]
        carry = initial_carry()
        status = int(0)
        cost = wp.float64(0.0)
        size = wp.float64(0.0)
        for k in range(horizon):
            u = control(policy, b, k, limits, alpha, x)
            for i in range(wp.static(nu)):
                out.us[b, a, k, i] = u[i]
            if status == 0:
                term = wp.float64(running(weights, weight_row, x, u, k))
                cost += term
                size += wp.abs(term)
                x_next, carry_next, code = step(params, row, x, u, carry)
                status = code
                if status == 0 and not (wp.isfinite(x_next) and wp.isfinite(cost)):
                    status = NOT_FINITE
                if status == 0:
                    x = x_next
                    carry = carry_next
            for i in range(wp.static(nx)):
                out.xs[b, a, k + 1, i] = x[i]
        last = wp.float64(final(weights, weight_row, x))
        cost += last
        size += wp.abs(last)
        if status == 0 and not wp.isfinite(cost):
            status = NOT_FINITE
        if status != 0:
            cost = wp.float64(wp.INF)
        out.cost[b, a] = cost
        out.size[b, a] = size
        out.status[b, a] = status

    return rollout


@cached
def make_choice_kernels(nx, nu, dtype):
    """Kernels ``start`` and ``accept`` over problems: adopt the first rollout; choose a step size."""
    Policy, Candidates = make_policy_arrays(dtype), make_candidate_arrays(dtype)
    drop_policy = make_drop_policy(nx, nu, dtype)
    ROUNDING = wp.float64(8.0 * EPSILON[dtype])
    NEARLY = wp.float64(8.0)  # times the tolerance: converged where no step can be seen in J any more

    @wp.func
    def adopt(policy: Policy, out: Candidates, b: int, a: int):
        """Make a candidate the nominal trajectory."""
        for k in range(policy.us.shape[1]):
            for i in range(nx):
                policy.xs[b, k, i] = out.xs[b, a, k, i]
            for i in range(nu):
                policy.us[b, k, i] = out.us[b, a, k, i]
        for i in range(nx):
            policy.xs[b, policy.us.shape[1], i] = out.xs[b, a, policy.us.shape[1], i]

    @named_by_code(max_unroll=1)
    def start(first: int, policy: Policy, out: Candidates, state: SolverState):
        b = first + wp.tid()
        adopt(policy, out, b, 0)
        good = wp.where(out.status[b, 0] == 0, 1, 0)
        if good == 0:
            drop_policy(policy, b)
        state.status[b] = wp.where(good == 1, RUNNING, DYNAMICS_FAILED)
        state.active[b] = good
        state.fresh[b] = good
        state.passes[b] = 0
        state.cost[b] = out.cost[b, 0]
        state.size[b] = out.size[b, 0]
        state.flat[b] = 0
        state.relative[b] = wp.float64(wp.INF)
        state.mu[b] = state.schedule[schedule_row(state, b), SCHEDULE_INITIAL]
        state.delta[b] = wp.float64(1.0)
        state.expected[b, 0] = wp.float64(0.0)
        state.expected[b, 1] = wp.float64(0.0)
        state.gradient[b] = wp.float64(wp.INF)
        state.pivot[b] = wp.float64(wp.NAN)
        for p in range(state.trace.shape[1]):
            for c in range(state.trace.shape[2]):
                state.trace[b, p, c] = wp.float64(wp.NAN)

    @named_by_code(max_unroll=1)
    def accept(
        first: int,
        policy: Policy,
        out: Candidates,
        state: SolverState,
        min_ratio: wp.float64,
        min_improvement: wp.float64,
        tolerance: wp.float64,  # of the relative gradient
    ):
        b = first + wp.tid()
        if state.active[b] == 0:
            return
        cost = state.cost[b]
        best = int(-1)
        best_cost = cost
        best_ratio = wp.float64(wp.NAN)
        largest = wp.float64(0.0)
        for a in range(out.step_sizes.shape[0]):
            alpha = out.step_sizes[a]
            expected = -alpha * (state.expected[b, 0] + alpha * state.expected[b, 1])
            largest = wp.max(largest, expected)
            if expected > wp.float64(0.0) and out.cost[b, a] < best_cost:
                ratio = (cost - out.cost[b, a]) / expected
                if ratio > min_ratio:
                    best = a
                    best_cost = out.cost[b, a]
                    best_ratio = ratio
        p = state.passes[b]
        state.passes[b] = p + 1
        reduction = cost - best_cost
        drowned = largest <= ROUNDING * state.size[b]  # what is left to gain is rounding
        if p < state.trace.shape[1]:
            state.trace[b, p, TRACE_COST] = best_cost
            state.trace[b, p, TRACE_REDUCTION] = reduction
            state.trace[b, p, TRACE_RATIO] = best_ratio
            state.trace[b, p, TRACE_STEP_SIZE] = wp.float64(0.0)
            state.trace[b, p, TRACE_EXPECTED] = largest
            if best >= 0:
                state.trace[b, p, TRACE_STEP_SIZE] = out.step_sizes[best]
        if best >= 0:
            adopt(policy, out, b, best)
            state.cost[b] = best_cost
            state.size[b] = out.size[b, best]
            state.fresh[b] = 1
            lower_regularization(state, b)
            if reduction <= min_improvement:
                state.status[b] = SMALL_IMPROVEMENT  # one more backward pass makes its policy
        elif drowned:
            near = state.relative[b] <= NEARLY * tolerance or state.size[b] == wp.float64(0.0)
            state.status[b] = wp.where(near, CONVERGED, SMALL_IMPROVEMENT)
            if state.flat[b] == 1:
                state.status[b] = FLAT
            state.active[b] = 0
        elif raise_regularization(state, b) == 0:
            state.status[b] = LINE_SEARCH_FAILED
            state.active[b] = 0

    return start, accept
