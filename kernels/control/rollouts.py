"""Rollouts of DDP: a trajectory for every problem and step size, and what open shooting starts from."""

import warp as wp

from ..device.compile import fitted, specialised
from ..device.relay import Relay, hand_on, taken
from ..factories import cached
from .backward.box_qp import EPSILON
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
def make_limited(dtype):
    """``(value, before, low, high)``: a control within its limits, and at one that `before` and a step to it
    miss by rounding, since only what is at a limit is held by it.
    """
    ROUNDING = dtype(4.0 * EPSILON[dtype])

    @wp.func
    def limited(value: dtype, before: dtype, low: dtype, high: dtype):
        near = ROUNDING * wp.abs(before)
        if value <= low + (near + ROUNDING * wp.abs(low)):  # not where it is infinite
            return low
        if value >= high - (near + ROUNDING * wp.abs(high)):
            return high
        return value

    return limited


@cached
def make_rollout_kernel(
    step, initial_carry, running, final, nx, nu, has_limits, limits_states, dtype, handed=None
):
    """Kernel over B A items, ``(first, slot, last, most, Relay, carries, problems, x0, Policy, Candidates,
    StateLimits, params, weights, mask)``.

    Item i is problem i mod B under step size i div B: u = clamp(us + alpha k + K (x - xs)), x' = step(x, u),
    costs summed in double precision. Of open gaps the share 1 - alpha stays open: x' = step(x, u) -
    (1 - alpha) gap (M43).
    A failed or non-finite world costs +inf and keeps its last valid state.

    With `handed`, of `make_transition`, a launch makes some of the steps, and items carry over what the next
    one needs; a fast step that is not solved is left to the other kernel (`device/relay.py`).
    """
    relayed, fast = handed is not None, handed is not None and handed.fast
    carried, leave = (handed.carried, handed.leave) if relayed else (None, None)
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    Policy, Candidates = make_policy_arrays(dtype), make_candidate_arrays(dtype)
    StateLimits = make_state_limits(dtype)
    stage, at_end = make_costs_with_limits(running, final, nx, nu, limits_states, dtype)
    limited = make_limited(dtype)

    @wp.func
    def control(policy: Policy, b: int, k: int, limits: int, alpha: dtype, x: VX):
        """u within its limits."""
        u = VU()
        for i in range(wp.static(nu)):
            value = policy.us[b, k, i] + alpha * policy.k[b, k, i]
            for j in range(wp.static(nx)):
                value += policy.K[b, k, i, j] * (x[j] - policy.xs[b, k, j])
            if wp.static(has_limits):
                value = limited(value, policy.us[b, k, i], policy.lower[limits, i], policy.upper[limits, i])
            u[i] = value
        return u

    @fitted(fast)
    def rollout(
        first: int,
        slot: int,
        last: int,
        most: int,  # steps
        relay: Relay,
        carries: wp.array2d(dtype=dtype),  # (B A, width)
        problems: int,
        x0: wp.array2d(dtype=dtype),
        policy: Policy,
        out: Candidates,
        state_limits: StateLimits,
        params: wp.array2d(dtype=dtype),
        weights: wp.array2d(dtype=dtype),
        active: wp.array(dtype=wp.int32),
    ):
        # long: an item's run is one loop, and what it stands in is local to the thread
        item = first + wp.tid()
        if wp.static(relayed):
            item = taken(relay, slot, item)
            if item < 0:
                return
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
        carry = initial_carry()
        status = int(0)
        cost = wp.float64(0.0)
        size = wp.float64(0.0)
        begin = int(0)
        end = horizon
        if wp.static(relayed):
            begin = relay.next[item]
            end = wp.min(wp.min(begin + most, last), horizon)
            if begin >= end:
                return
            if begin > 0:
                carry = carried(carries, item)
                status = out.status[b, a]
                cost = out.cost[b, a]
                size = out.size[b, a]
        for i in range(wp.static(nx)):
            if begin == 0:
                out.xs[b, a, 0, i] = x0[b, i]
            x[i] = out.xs[b, a, begin, i]
        for k in range(begin, end):
            u = control(policy, b, k, limits, alpha, x)
            for i in range(wp.static(nu)):
                out.us[b, a, k, i] = u[i]
            if status == 0:
                x_next, carry_next, code = step(params, row, x, u, carry)
                if wp.static(fast):
                    if code != 0:
                        end = k
                        break
                term = stage(state_limits, weights, weight_row, b, x, u, k)
                cost += term
                size += wp.abs(term)
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
        if wp.static(relayed):
            relay.next[item] = end
            if end < horizon:
                leave(carries, item, carry)
                out.cost[b, a] = cost
                out.size[b, a] = size
                out.status[b, a] = status
                if end < last:
                    hand_on(relay, slot, item)
                return
        term = at_end(state_limits, weights, weight_row, b, x, horizon)
        cost += term
        size += wp.abs(term)
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
