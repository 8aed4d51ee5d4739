"""The choice of a step size among rollouts with all of them, or with the first alone where it suffices."""

import warp as wp

from ..device.compile import named_by_code
from ..factories import cached
from .backward.box_qp import EPSILON
from .rollouts import make_candidate_arrays
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


@cached
def make_choice_kernels(nx, nu, dtype):
    """Kernels over problems: ``start`` adopts the first rollout, ``screen`` asks whether the first step size
    suffices, ``accept`` chooses a step size.
    """
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
    def start(first: int, policy: Policy, out: Candidates, state: SolverState, again: int):
        b = first + wp.tid()
        if again == 1 and state.searching[b] == 0:
            return
        adopt(policy, out, b, 0)
        good = wp.where(out.status[b, 0] == 0, 1, 0)
        if good == 0:
            drop_policy(policy, b)
        state.status[b] = wp.where(good == 1, RUNNING, DYNAMICS_FAILED)
        state.active[b] = good
        state.fresh[b] = good
        state.valued[b] = 0
        state.cost[b] = out.cost[b, 0]
        state.size[b] = out.size[b, 0]
        state.flat[b] = 0
        state.relative[b] = wp.float64(wp.INF)
        state.expected[b, 0] = wp.float64(0.0)
        state.expected[b, 1] = wp.float64(0.0)
        state.gap_price[b] = wp.float64(0.0)
        state.gradient[b] = wp.float64(wp.INF)
        state.pivot[b] = wp.float64(wp.NAN)
        if again == 1:
            return
        state.passes[b] = 0
        state.mu[b] = state.schedule[schedule_row(state, b), SCHEDULE_INITIAL]
        state.delta[b] = wp.float64(1.0)
        for p in range(state.trace.shape[1]):
            for c in range(state.trace.shape[2]):
                state.trace[b, p, c] = wp.float64(wp.NAN)

    @wp.func
    def close_gaps(policy: Policy, state: SolverState, b: int, alpha: wp.float64):
        """What a step leaves of the gaps; a full one leaves nothing."""
        if state.gap[b] > wp.float64(0.0):
            left = wp.float64(1.0) - alpha
            state.gap[b] = left * state.gap[b]
            for k in range(policy.us.shape[1]):
                for i in range(nx):
                    policy.gaps[b, k, i] = dtype(left) * policy.gaps[b, k, i]

    @wp.func
    def expected_reduction(state: SolverState, b: int, alpha: wp.float64):
        """Of the merit by a step: of a convex model with gaps at least the share alpha of the full one's."""
        if state.gap[b] > wp.float64(0.0):
            full = state.expected[b, 0] + state.expected[b, 1]
            return alpha * (state.gap_price[b] * state.gap[b] - full)
        return -alpha * (state.expected[b, 0] + alpha * state.expected[b, 1])

    @wp.func
    def merit(out: Candidates, state: SolverState, b: int, a: int):
        """A candidate's cost, and the price of the gaps that it leaves open."""
        if state.gap[b] > wp.float64(0.0):
            return out.cost[b, a] + state.gap_price[b] * (wp.float64(1.0) - out.step_sizes[a]) * state.gap[b]
        return out.cost[b, a]

    @wp.func
    def first_suffices(out: Candidates, state: SolverState, b: int, full_ratio: wp.float64):
        """Whether the first step size brings so much of what it promised that no other is asked."""
        expected = expected_reduction(state, b, out.step_sizes[0])
        now = state.cost[b] + state.gap_price[b] * state.gap[b]
        return expected > wp.float64(0.0) and now - merit(out, state, b, 0) >= full_ratio * expected

    @wp.func
    def record(
        state: SolverState,
        b: int,
        cost: wp.float64,
        reduction: wp.float64,
        ratio: wp.float64,
        most: wp.float64,
    ):
        """The line search's row of the trace; no step size yet."""
        p = state.passes[b]
        state.trace[b, p, TRACE_COST] = cost
        state.trace[b, p, TRACE_REDUCTION] = reduction
        state.trace[b, p, TRACE_RATIO] = ratio
        state.trace[b, p, TRACE_STEP_SIZE] = wp.float64(0.0)
        state.trace[b, p, TRACE_EXPECTED] = most

    @named_by_code(max_unroll=1)
    def screen(first: int, out: Candidates, state: SolverState, full_ratio: wp.float64):
        b = first + wp.tid()
        state.searching[b] = state.active[b]
        if state.active[b] == 1 and first_suffices(out, state, b, full_ratio):
            state.searching[b] = 0

    @wp.func
    def end(state: SolverState, b: int, status: int):
        """Let a problem end, FLAT where it feels nothing."""
        state.status[b] = wp.where(state.flat[b] == 1, FLAT, status)
        state.active[b] = 0

    @named_by_code(max_unroll=1)
    def accept(
        first: int,
        policy: Policy,
        out: Candidates,
        state: SolverState,
        full_ratio: wp.float64,
        min_ratio: wp.float64,
        min_improvement: wp.float64,
        tolerance: wp.float64,  # of the relative gradient
    ):
        b = first + wp.tid()
        if state.active[b] == 0:
            return
        cost = state.cost[b] + state.gap_price[b] * state.gap[b]
        tried = out.step_sizes.shape[0]
        if first_suffices(out, state, b, full_ratio):
            tried = 1
        best = int(-1)
        best_merit = cost
        best_ratio = wp.float64(wp.NAN)
        largest = wp.float64(0.0)
        for a in range(out.step_sizes.shape[0]):
            expected = expected_reduction(state, b, out.step_sizes[a])
            largest = wp.max(largest, expected)
            if a < tried and expected > wp.float64(0.0):
                value = merit(out, state, b, a)
                ratio = (cost - value) / expected
                if value < best_merit and ratio > min_ratio:
                    best = a
                    best_merit = value
                    best_ratio = ratio
        best_cost = state.cost[b]
        if best >= 0:
            best_cost = out.cost[b, best]
        reduction = state.cost[b] - best_cost
        record(state, b, best_cost, reduction, best_ratio, largest)
        if best >= 0:
            state.trace[b, state.passes[b], TRACE_STEP_SIZE] = out.step_sizes[best]
        state.passes[b] += 1
        drowned = largest <= ROUNDING * state.size[b]  # what is left to gain is rounding
        if best >= 0:
            adopt(policy, out, b, best)
            close_gaps(policy, state, b, out.step_sizes[best])
            state.cost[b] = best_cost
            state.size[b] = out.size[b, best]
            state.fresh[b] = 1
            lower_regularization(state, b)
            if reduction <= min_improvement and state.gap[b] == wp.float64(0.0):
                state.status[b] = SMALL_IMPROVEMENT  # one more backward pass makes its policy
        elif drowned:
            near = state.relative[b] <= NEARLY * tolerance or state.size[b] == wp.float64(0.0)
            end(state, b, wp.where(near, CONVERGED, SMALL_IMPROVEMENT))
        elif state.relative[b] <= tolerance:  # nothing is left of what the pass promised
            end(state, b, CONVERGED)
        elif raise_regularization(state, b) == 0:
            state.status[b] = LINE_SEARCH_FAILED
            state.active[b] = 0

    return start, screen, accept
