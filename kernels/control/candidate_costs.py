"""Costs of trajectories that were rolled out already, and the gaps of those that shooting starts from."""

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from .rollouts import make_candidate_arrays, make_costs_with_limits
from .solver_state import SolverState, make_policy_arrays
from .state_limits import make_state_limits
from .status import NOT_FINITE


@cached
def make_candidate_cost_kernel(running, final, nx, nu, limits_states, dtype):
    """Kernel ``(first, problems, Candidates, StateLimits, weights, mask)`` over B A items, i as of the
    rollouts: the cost and size of candidate i, +inf where its rollout failed.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    Candidates, StateLimits = make_candidate_arrays(dtype), make_state_limits(dtype)
    stage, end = make_costs_with_limits(running, final, nx, nu, limits_states, dtype)

    @specialised
    def candidate_costs(
        first: int,
        problems: int,
        out: Candidates,
        limits: StateLimits,
        weights: wp.array2d(dtype=dtype),
        active: wp.array(dtype=wp.int32),
    ):
        item = first + wp.tid()
        a = item / problems
        b = item - a * problems
        if active[b] == 0:
            return
        row = wp.where(weights.shape[0] == 1, 0, b)
        horizon = out.us.shape[2]
        cost = wp.float64(0.0)
        size = wp.float64(0.0)
        x, u = VX(), VU()
        for k in range(horizon + 1):
            for i in range(wp.static(nx)):
                x[i] = out.xs[b, a, k, i]
            term = wp.float64(0.0)
            if k < horizon:
                for i in range(wp.static(nu)):
                    u[i] = out.us[b, a, k, i]
                term = stage(limits, weights, row, b, x, u, k)
            else:
                term = end(limits, weights, row, b, x, k)
            cost += term
            size += wp.abs(term)
        if out.status[b, a] == 0 and not wp.isfinite(cost):
            out.status[b, a] = NOT_FINITE
        if out.status[b, a] != 0:
            cost = wp.float64(wp.INF)
        out.cost[b, a] = cost
        out.size[b, a] = size

    return candidate_costs


@cached
def make_gap_kernel(nx, dtype):
    """Kernel ``(first, Policy, Candidates, SolverState)`` over problems: the gaps between the steps that the
    first candidate holds and the policy's states, which it gets instead.
    """
    Policy, Candidates = make_policy_arrays(dtype), make_candidate_arrays(dtype)

    @specialised
    def find_gaps(first: int, policy: Policy, out: Candidates, state: SolverState):
        b = first + wp.tid()
        open_gaps = wp.float64(0.0)
        for k in range(policy.us.shape[1]):
            for i in range(wp.static(nx)):
                gap = out.xs[b, 0, k + 1, i] - policy.xs[b, k + 1, i]
                policy.gaps[b, k, i] = gap
                out.xs[b, 0, k + 1, i] = policy.xs[b, k + 1, i]
                open_gaps += wp.float64(wp.abs(gap))
        if out.status[b, 0] == 0 and not wp.isfinite(open_gaps):
            out.status[b, 0] = NOT_FINITE
        state.gap[b] = open_gaps

    return find_gaps
