"""Rollouts of DDP: a trajectory for every problem and step size, and what open shooting starts from."""

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from .solver_state import SolverState, make_policy_arrays
from .state_limits import make_penalty, make_state_limits
from .status import NOT_FINITE


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
def make_costs_with_limits(running, final, nx, nu, limits_states, dtype):
    """Warp functions of the cost of a step and of the end in double precision, state limits' penalties among
    it; no penalty is paid for the first state.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    StateLimits, penalty = make_state_limits(dtype), make_penalty(nx, dtype).penalty

    @wp.func
    def stage(limits: StateLimits, weights: wp.array2d(dtype=dtype), row: int, b: int, x: VX, u: VU, k: int):
        term = wp.float64(running(weights, row, x, u, k))
        if wp.static(limits_states):
            if k > 0:
                term += wp.float64(penalty(limits, b, k, x))
        return term

    @wp.func
    def end(limits: StateLimits, weights: wp.array2d(dtype=dtype), row: int, b: int, x: VX, k: int):
        term = wp.float64(final(weights, row, x))
        if wp.static(limits_states):
            term += wp.float64(penalty(limits, b, k, x))
        return term

    return stage, end


@cached
def make_rollout_kernel(step, initial_carry, running, final, nx, nu, has_limits, limits_states, dtype):
    """Kernel ``(first, problems, x0, Policy, Candidates, StateLimits, params, weights, mask)``, B A items.

    Item i is problem i mod B under step size i div B: u = clamp(us + alpha k + K (x - xs)), x' = step(x, u),
    costs summed in double precision. Of open gaps the share 1 - alpha stays open: x' = step(x, u) -
    (1 - alpha) gap (M43).
    A failed or non-finite world costs +inf and keeps its last valid state.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    Policy, Candidates = make_policy_arrays(dtype), make_candidate_arrays(dtype)
    StateLimits = make_state_limits(dtype)
    stage, end = make_costs_with_limits(running, final, nx, nu, limits_states, dtype)

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
        state_limits: StateLimits,
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
        left = dtype(1.0) - alpha
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
                term = stage(state_limits, weights, weight_row, b, x, u, k)
                cost += term
                size += wp.abs(term)
                x_next, carry_next, code = step(params, row, x, u, carry)
                status = code
                if policy.gaps.shape[0] > 0:
                    for i in range(wp.static(nx)):
                        x_next[i] = x_next[i] - left * policy.gaps[b, k, i]
                if status == 0 and not (wp.isfinite(x_next) and wp.isfinite(cost)):
                    status = NOT_FINITE
                if status == 0:
                    x = x_next
                    carry = carry_next
            for i in range(wp.static(nx)):
                out.xs[b, a, k + 1, i] = x[i]
        last = end(state_limits, weights, weight_row, b, x, horizon)
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
def make_shooting_kernel(step, initial_carry, running, final, nx, nu, limits_states, dtype):
    """Kernel ``(first, x0, Policy, Candidates, StateLimits, params, weights, SolverState)`` over problems: of
    the states and controls that the policy holds the cost, as the first candidate's, and the gaps.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    Policy, Candidates = make_policy_arrays(dtype), make_candidate_arrays(dtype)
    StateLimits = make_state_limits(dtype)
    stage, end = make_costs_with_limits(running, final, nx, nu, limits_states, dtype)

    @specialised
    def shoot(
        first: int,
        x0: wp.array2d(dtype=dtype),
        policy: Policy,
        out: Candidates,
        state_limits: StateLimits,
        params: wp.array2d(dtype=dtype),
        weights: wp.array2d(dtype=dtype),
        state: SolverState,
    ):
        b = first + wp.tid()
        row = wp.where(params.shape[0] == 1, 0, b)
        weight_row = wp.where(weights.shape[0] == 1, 0, b)
        x = VX()
        for i in range(wp.static(nx)):
            x[i] = x0[b, i]
            out.xs[b, 0, 0, i] = x[i]
        status = int(0)
        cost = wp.float64(0.0)
        size = wp.float64(0.0)
        open_gaps = wp.float64(0.0)
        for k in range(policy.us.shape[1]):
            u = VU()
            for i in range(wp.static(nu)):
                u[i] = policy.us[b, k, i]
                out.us[b, 0, k, i] = u[i]
            term = stage(state_limits, weights, weight_row, b, x, u, k)
            cost += term
            size += wp.abs(term)
            x_next, unused, code = step(params, row, x, u, initial_carry())
            if code != 0:
                status = code
            for i in range(wp.static(nx)):
                x[i] = policy.xs[b, k + 1, i]
                out.xs[b, 0, k + 1, i] = x[i]
                gap = x_next[i] - x[i]
                policy.gaps[b, k, i] = gap
                open_gaps += wp.float64(wp.abs(gap))
        last = end(state_limits, weights, weight_row, b, x, policy.us.shape[1])
        cost += last
        if status == 0 and not (wp.isfinite(cost) and wp.isfinite(open_gaps)):
            status = NOT_FINITE
        if status != 0:
            cost = wp.float64(wp.INF)
        out.cost[b, 0] = cost
        out.size[b, 0] = size + wp.abs(last)
        out.status[b, 0] = status
        state.gap[b] = open_gaps

    return shoot
