"""Search by sampled controls: rollouts of random splines on top of controls, and what is drawn next.

u_k = clamp(base_k + sum_j w_kj knot_{f_k + j}), j = 0 .. 3: a spline through knots (B, M, nu), its weights w
and first knots f for every step made on the host. Sample 0 has the mean's knots, sample 1 the best ones so
far, the others mean + deviation * noise (M48). Costs are as in a line search's rollouts.
"""

import warp as wp

from ..device.compile import named_by_code, specialised
from ..device.random import make_normal
from ..factories import cached
from .rollouts import make_candidate_arrays, make_costs_with_limits
from .state_limits import make_state_limits
from .status import NOT_FINITE

METHODS = ("predictive", "cem", "mppi")
PREDICTIVE, CEM, MPPI = range(3)
SUPPORT = 4  # knots that a step's control depends on


@cached
def make_sample_arrays(dtype):
    """Struct of what is drawn from, what was drawn, and the best of it."""

    @wp.struct
    class Samples:
        base: wp.array(ndim=3, dtype=dtype)  # (B, N, nu)
        first: wp.array(dtype=wp.int32)  # (N,) first knot of every step
        spline: wp.array(ndim=2, dtype=dtype)  # (N, SUPPORT)
        lower: wp.array(ndim=2, dtype=dtype)  # (1 or B, nu) control limits
        upper: wp.array(ndim=2, dtype=dtype)  # (1 or B, nu)
        mean: wp.array(ndim=3, dtype=dtype)  # (B, M, nu)
        deviation: wp.array(ndim=3, dtype=dtype)  # (B, M, nu)
        least: wp.array(ndim=2, dtype=dtype)  # (B, nu) that deviations do not fall below
        knots: wp.array(ndim=4, dtype=dtype)  # (B, S, M, nu)
        cost: wp.array(ndim=2, dtype=wp.float64)  # (B, S), +inf where the rollout failed
        best: wp.array(ndim=3, dtype=dtype)  # (B, M, nu)
        best_cost: wp.array(dtype=wp.float64)  # (B,)
        us: wp.array(ndim=3, dtype=dtype)  # (B, N, nu) of the best
        xs: wp.array(ndim=3, dtype=dtype)  # (B, N+1, nx) of the best

    return Samples


@cached
def make_splines(nu, dtype):
    """draw(samples, b, s, seed, iteration): the knots of a sample; control(samples, b, s, k, row, best) ->
    u_k of it.
    """
    VU, Samples = wp.types.vector(nu, dtype), make_sample_arrays(dtype)
    normals = make_normal(dtype).normals

    @wp.func
    def draw(samples: Samples, b: int, s: int, seed: int, iteration: int):
        for m in range(samples.mean.shape[1]):
            for i in range(nu):
                value = samples.mean[b, m, i]
                if s == 1:
                    value = samples.best[b, m, i]
                if s > 1:
                    noise = normals(seed, s, iteration, m * nu + i)  # alike for every problem
                    value += samples.deviation[b, m, i] * noise[0]
                samples.knots[b, s, m, i] = value

    @wp.func
    def control(samples: Samples, b: int, s: int, k: int, row: int, best: bool):
        u = VU()
        for i in range(wp.static(nu)):
            value = samples.base[b, k, i]
            for j in range(wp.static(SUPPORT)):
                m = samples.first[k] + j
                if best:
                    value += samples.spline[k, j] * samples.best[b, m, i]
                else:
                    value += samples.spline[k, j] * samples.knots[b, s, m, i]
            if value < samples.lower[row, i]:
                value = samples.lower[row, i]
            if value > samples.upper[row, i]:
                value = samples.upper[row, i]
            u[i] = value
        return u

    return draw, control


@cached
def make_sample_kernel(step, initial_carry, running, final, nx, nu, limits_states, dtype):
    """Kernel ``(first, problems, seed, iteration, x0, Samples, StateLimits, params, weights)``, B S items.

    Item i is sample i div B of problem i mod B. With ``iteration`` -1, over B items, the best knots are
    played, and their controls and states stored.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    Samples, StateLimits = make_sample_arrays(dtype), make_state_limits(dtype)
    stage, end = make_costs_with_limits(running, final, nx, nu, limits_states, dtype)
    draw, control = make_splines(nu, dtype)

    @wp.func
    def store(samples: Samples, b: int, k: int, x: VX, u: VU):
        for i in range(wp.static(nx)):
            samples.xs[b, k, i] = x[i]
        if k < samples.us.shape[1]:
            for i in range(wp.static(nu)):
                samples.us[b, k, i] = u[i]

    @specialised
    def sample(
        first: int,
        problems: int,
        seed: int,
        iteration: int,
        x0: wp.array2d(dtype=dtype),
        samples: Samples,
        state_limits: StateLimits,
        params: wp.array2d(dtype=dtype),
        weights: wp.array2d(dtype=dtype),
    ):
        item = first + wp.tid()
        s = item / problems
        b = item - s * problems
        best = iteration < 0
        row = wp.where(params.shape[0] == 1, 0, b)
        weight_row = wp.where(weights.shape[0] == 1, 0, b)
        limits = wp.where(samples.lower.shape[0] == 1, 0, b)
        horizon = samples.base.shape[1]
        x, u = VX(), VU()
        for i in range(wp.static(nx)):
            x[i] = x0[b, i]
        if not best:
            draw(samples, b, s, seed, iteration)
        carry = initial_carry()
        status = int(0)
        cost = wp.float64(0.0)
        for k in range(horizon):
            u = control(samples, b, s, k, limits, best)
            if best:
                store(samples, b, k, x, u)
            if status == 0:
                cost += stage(state_limits, weights, weight_row, b, x, u, k)
                x_next, carry_next, code = step(params, row, x, u, carry)
                status = code
                if status == 0 and not (wp.isfinite(x_next) and wp.isfinite(cost)):
                    status = NOT_FINITE
                if status == 0:
                    x = x_next
                    carry = carry_next
        cost += end(state_limits, weights, weight_row, b, x, horizon)
        if status != 0 or not wp.isfinite(cost):
            cost = wp.float64(wp.INF)
        if best:
            store(samples, b, horizon, x, u)
            samples.best_cost[b] = cost
        else:
            samples.cost[b, s] = cost

    return sample


@cached
def make_play_kernels(nx, nu, dtype):
    """Of dynamics that roll out themselves: kernels ``(first, problems, seed, iteration, Samples,
    Candidates)`` over B S items, which draws a sample and gives its controls to the candidate, the best one's
    to candidate 0 with ``iteration`` -1; and ``(first, Samples, Candidates)`` over problems, which stores the
    first candidate's.
    """
    Samples, Candidates = make_sample_arrays(dtype), make_candidate_arrays(dtype)
    draw, control = make_splines(nu, dtype)

    @specialised
    def play(first: int, problems: int, seed: int, iteration: int, samples: Samples, out: Candidates):
        item = first + wp.tid()
        s = item / problems
        b = item - s * problems
        row = wp.where(samples.lower.shape[0] == 1, 0, b)
        if iteration >= 0:
            draw(samples, b, s, seed, iteration)
        for k in range(samples.base.shape[1]):
            u = control(samples, b, s, k, row, iteration < 0)
            for i in range(nu):
                out.us[b, s, k, i] = u[i]

    @specialised
    def keep(first: int, samples: Samples, out: Candidates):
        b = first + wp.tid()
        samples.best_cost[b] = out.cost[b, 0]
        for k in range(out.xs.shape[2]):
            for i in range(nx):
                samples.xs[b, k, i] = out.xs[b, 0, k, i]
            if k < out.us.shape[2]:
                for i in range(nu):
                    samples.us[b, k, i] = out.us[b, 0, k, i]

    return play, keep


@cached
def make_update_kernel(nu, dtype):
    """Kernel ``(first, method, elites, temperature, decay, Samples, trace, iteration)`` over problems: the
    best of what was drawn, and the mean and deviation of what is drawn next, (M48) and (M49).
    """
    Samples = make_sample_arrays(dtype)
    INF = wp.float64(wp.INF)
    ZERO, ONE = wp.float64(0.0), wp.float64(1.0)

    @wp.func
    def next_cheapest(cost: wp.array2d(dtype=wp.float64), b: int, after: wp.float64, at: int):
        """The sample of lowest cost that comes after another in the order of (cost, index); -1: none."""
        found = int(-1)
        lowest = INF
        for s in range(cost.shape[1]):
            value = cost[b, s]
            if value < lowest and (value > after or (value == after and s > at)):
                lowest = value
                found = s
        return found

    @wp.func
    def spread(cost: wp.array2d(dtype=wp.float64), b: int):
        """Lowest cost, and by how much the costs exceed it in the mean, of rollouts that did not fail."""
        lowest = INF
        total = wp.float64(0.0)
        count = wp.float64(0.0)
        for s in range(cost.shape[1]):
            if cost[b, s] < INF:
                lowest = wp.min(lowest, cost[b, s])
                total += cost[b, s]
                count += ONE
        return lowest, total / wp.max(count, ONE) - lowest

    @wp.func
    def weighed(samples: Samples, b: int, m: int, i: int, lowest: wp.float64, heat: wp.float64):
        """Mean of a knot under weights e^(-(J - J_min) / heat)."""
        total = wp.float64(0.0)
        sum = wp.float64(0.0)
        for s in range(samples.cost.shape[1]):
            if samples.cost[b, s] < INF:
                weight = wp.exp(-(samples.cost[b, s] - lowest) / heat)
                sum += weight * wp.float64(samples.knots[b, s, m, i])
                total += weight
        return dtype(sum / total)

    @wp.func
    def elite(samples: Samples, b: int, elites: int):
        """Mean and deviation of the elites, one after the other (Welford)."""
        at = int(-1)
        after = -INF
        count = dtype(0.0)
        for e in range(elites):
            at = next_cheapest(samples.cost, b, after, at)
            if at < 0:
                return
            after = samples.cost[b, at]
            count += dtype(1.0)
            for m in range(samples.mean.shape[1]):
                for i in range(nu):
                    value = samples.knots[b, at, m, i]
                    mean = dtype(0.0)
                    square = dtype(0.0)
                    if e > 0:
                        mean = samples.mean[b, m, i]
                        old = samples.deviation[b, m, i]
                        square = old * old * (count - dtype(1.0))
                    off = value - mean
                    mean += off / count
                    square += off * (value - mean)
                    samples.mean[b, m, i] = mean
                    samples.deviation[b, m, i] = wp.sqrt(square / count)

    @named_by_code(max_unroll=1)
    def update(
        first: int,
        method: int,
        elites: int,
        temperature: wp.float64,
        decay: dtype,
        samples: Samples,
        trace: wp.array2d(dtype=wp.float64),
        iteration: int,
    ):
        b = first + wp.tid()
        at = next_cheapest(samples.cost, b, -INF, -1)
        if at >= 0 and samples.cost[b, at] < samples.best_cost[b]:
            samples.best_cost[b] = samples.cost[b, at]
            for m in range(samples.mean.shape[1]):
                for i in range(nu):
                    samples.best[b, m, i] = samples.knots[b, at, m, i]
        if iteration < trace.shape[1]:
            trace[b, iteration] = samples.best_cost[b]
        if at < 0:
            return
        lowest, excess = spread(samples.cost, b)
        heat = temperature * excess
        if method == wp.static(CEM):
            elite(samples, b, elites)
        for m in range(samples.mean.shape[1]):
            for i in range(nu):
                if method == wp.static(PREDICTIVE):
                    samples.mean[b, m, i] = samples.best[b, m, i]
                if method == wp.static(MPPI) and heat > ZERO:
                    samples.mean[b, m, i] = weighed(samples, b, m, i, lowest, heat)
                if method != wp.static(CEM):
                    samples.deviation[b, m, i] = decay * samples.deviation[b, m, i]
                samples.deviation[b, m, i] = wp.max(samples.least[b, i], samples.deviation[b, m, i])

    return update
