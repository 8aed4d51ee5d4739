"""Arrays that the kernels of one DDP pass share, grouped by who writes them."""

import warp as wp

from ..factories import cached
from .status import SCHEDULE_FACTOR, SCHEDULE_MAX, SCHEDULE_MIN


@wp.struct
class SolverState:
    """Per problem (B): where the solver stands. Double precision whatever the dtype of the trajectories."""

    status: wp.array(dtype=wp.int32)  # see `status.py`
    active: wp.array(dtype=wp.int32)  # 1 while the problem takes part in passes
    searching: wp.array(dtype=wp.int32)  # 1 where the first step size is not enough, and the others are tried
    fresh: wp.array(dtype=wp.int32)  # 1 if the trajectory changed since it was linearised
    passes: wp.array(dtype=wp.int32)  # line searches done
    valued: wp.array(dtype=wp.int32)  # 1: V_x is that of a backward pass since the trajectory was started
    cost: wp.array(dtype=wp.float64)  # J of the nominal trajectory
    size: wp.array(dtype=wp.float64)  # sum of the sizes of its terms: what J's rounding is relative to
    flat: wp.array(dtype=wp.int32)  # 1 where all terms of Q_u are too small to be felt in J
    relative: wp.array(dtype=wp.float64)  # largest |Q_u| of a control over the largest of its terms
    mu: wp.array(dtype=wp.float64)  # regularisation
    delta: wp.array(dtype=wp.float64)  # its present growth factor
    expected: wp.array(ndim=2, dtype=wp.float64)  # (B, 2): dV1, dV2; J changes by alpha dV1 + alpha^2 dV2
    gradient: wp.array(dtype=wp.float64)  # largest |Q_u|
    pivot: wp.array(dtype=wp.float64)  # smallest pivot of Q_uu without regularisation
    schedule: wp.array(ndim=2, dtype=wp.float64)  # (1 or B, SCHEDULE_COLUMNS)
    gap: wp.array(dtype=wp.float64)  # sum of |gaps| that are still open
    gap_price: wp.array(dtype=wp.float64)  # of a unit of it, in the merit of a step
    trace: wp.array(ndim=3, dtype=wp.float64)  # (B, max passes + 1, TRACE_COLUMNS)


@cached
def make_derivative_arrays(dtype):
    """Struct of the derivatives of dynamics and cost along the nominal trajectories, z = (x, u)."""

    @wp.struct
    class Derivatives:
        fx: wp.array(ndim=4, dtype=dtype)  # (B, N, nx, nx)
        fu: wp.array(ndim=4, dtype=dtype)  # (B, N, nx, nu)
        second: wp.array(ndim=4, dtype=dtype)  # (B N, nw, nz, nz), second derivatives of the curved outputs;
        # (B N, 1, nz, nz) where they come weighed: V.f_zz itself
        lift: wp.array(ndim=3, dtype=dtype)  # (B, nw, nx): V.f_zz = sum_i (lift V)_i second[i]
        lx: wp.array(ndim=3, dtype=dtype)  # (B, N+1, nx), the last one of the final cost
        lu: wp.array(ndim=3, dtype=dtype)  # (B, N, nu)
        lxx: wp.array(ndim=4, dtype=dtype)  # (B, N+1, nx, nx)
        lux: wp.array(ndim=4, dtype=dtype)  # (B, N, nu, nx)
        luu: wp.array(ndim=4, dtype=dtype)  # (B, N, nu, nu)
        status: wp.array(ndim=2, dtype=wp.int32)  # (B, N), 0 where the linearisation is good

    return Derivatives


@cached
def make_policy_arrays(dtype):
    """Struct of nominal trajectories, affine policies u = us + alpha k + K (x - xs), and value functions."""

    @wp.struct
    class Policy:
        xs: wp.array(ndim=3, dtype=dtype)  # (B, N+1, nx)
        us: wp.array(ndim=3, dtype=dtype)  # (B, N, nu)
        K: wp.array(ndim=4, dtype=dtype)  # (B, N, nu, nx)
        k: wp.array(ndim=3, dtype=dtype)  # (B, N, nu)
        Vx: wp.array(ndim=3, dtype=dtype)  # (B, N+1, nx)
        Vxx: wp.array(ndim=4, dtype=dtype)  # (B, N+1, nx, nx)
        lower: wp.array(ndim=2, dtype=dtype)  # (1 or B, nu) control limits
        upper: wp.array(ndim=2, dtype=dtype)  # (1 or B, nu)
        gaps: wp.array(ndim=3, dtype=dtype)  # (B, N, nx) of f(x_k, u_k) - x_{k+1}; (0, N, nx): all closed

    return Policy


@cached
def make_drop_policy(nx, nu, dtype):
    """Warp function that sets the gains and steps of a problem without a backward pass to zero."""
    Policy = make_policy_arrays(dtype)
    ZERO = dtype(0.0)

    @wp.func
    def drop_policy(policy: Policy, b: int):
        for k in range(policy.us.shape[1]):
            for i in range(nu):
                policy.k[b, k, i] = ZERO
                for j in range(nx):
                    policy.K[b, k, i, j] = ZERO

    return drop_policy


@wp.func
def schedule_row(state: SolverState, problem: int):
    """Row of the regularisation schedule that a problem follows."""
    return wp.where(state.schedule.shape[0] == 1, 0, problem)


@wp.func
def raise_regularization(state: SolverState, problem: int):
    """Increase mu by Tassa's quadratic schedule (2012, section II-F); 1 unless that passes the limit."""
    row = schedule_row(state, problem)
    factor = state.schedule[row, SCHEDULE_FACTOR]
    delta = wp.max(factor, state.delta[problem] * factor)
    mu = wp.max(state.schedule[row, SCHEDULE_MIN], state.mu[problem] * delta)
    state.delta[problem] = delta
    if not (mu <= state.schedule[row, SCHEDULE_MAX]):
        return int(0)
    state.mu[problem] = mu
    return int(1)


@wp.func
def lower_regularization(state: SolverState, problem: int):
    """Decrease mu by the same schedule, to zero below its minimum."""
    row = schedule_row(state, problem)
    factor = state.schedule[row, SCHEDULE_FACTOR]
    delta = wp.min(wp.float64(1.0) / factor, state.delta[problem] / factor)
    mu = state.mu[problem] * delta
    if mu < state.schedule[row, SCHEDULE_MIN]:
        mu = wp.float64(0.0)
    state.delta[problem] = delta
    state.mu[problem] = mu
