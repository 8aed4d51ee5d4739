"""The backward pass of DDP (`riccati.py`), one problem by the lanes of a warp: for a GPU.

A thread takes some 25,000 cycles a step on an H200 whatever the number of problems, since its loads and
divisions wait for each other, and a warp of 32 problems as long as the one that begins again most often.
Here entries of matrices are shared out among the lanes, which find what others made in a room of the
problem's in memory; what is small, a step's direction, every lane works out by itself. Lanes agree on all
that they decide by, since they read it from the same places.

With one lane it is a program for a CPU, too, of the same arithmetic; tests run that.
"""

from types import SimpleNamespace

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
from .riccati_parts import make_pass_parts
from .riccati_steps import LANES, make_shared_steps, room_of, together


@cached
def make_lanes_kernel(nx, nu, nw, method, has_limits, dtype, lanes=LANES):
    """Kernel ``(first, Derivatives, Policy, SolverState, room, gradient_tolerance, last)``, an item a lane.

    As that of `make_backward_kernel`; room (B, `room_of(nx, nu, nw)["width"]`) is overwritten.
    """
    VU = wp.types.vector(nu, dtype)
    Derivatives, Policy = make_derivative_arrays(dtype), make_policy_arrays(dtype)
    parts = make_pass_parts(nx, nu, method, has_limits, dtype)
    cholesky, direction, steepest = parts.cholesky, parts.direction, parts.steepest
    linearised, end = parts.linearised, parts.end
    share = make_shared_steps(nx, nu, nw, method, dtype, lanes)
    at = SimpleNamespace(**room_of(nx, nu, nw))
    ZERO, HALF = dtype(0.0), dtype(0.5)
    quadratic = method != "first-order"

    @named_by_code(max_unroll=1)
    def backward_by_lanes(
        first: int,
        d: Derivatives,
        policy: Policy,
        state: SolverState,
        room: wp.array2d(dtype=dtype),
        tolerance: wp.float64,
        last: int,
    ):
        # long: a pass is one loop over steps in one over regularisations
        item = first + wp.tid()
        b = item // lanes
        lane = item % lanes
        if state.active[b] == 0:
            return
        together()  # before one of them may end it
        if not linearised(d, policy, state, b):
            return
        horizon = policy.us.shape[1]
        row = schedule_row(state, b)
        limits = wp.where(policy.lower.shape[0] == 1, 0, b)
        unsolved = int(1)
        restarts = int(0)
        broken = int(0)
        lowest = wp.float64(0.0)
        change_1 = wp.float64(0.0)
        change_2 = wp.float64(0.0)
        felt = ZERO
        wanted = ZERO
        highest, widest = VU(), VU()
        while unsolved == 1:
            mu_x = dtype(state.mu[b] * state.schedule[row, SCHEDULE_STATE])
            mu_u = dtype(state.mu[b] * state.schedule[row, SCHEDULE_CONTROL])
            if wp.static(not quadratic):
                mu_u += mu_x
            change_1 = wp.float64(0.0)
            change_2 = wp.float64(0.0)
            felt = ZERO
            wanted = ZERO
            highest, widest = VU(), VU()
            broken = int(0)
            step = VU()
            share.final_value(d, policy, room, b, horizon, lane)
            k = horizon - 1
            good = int(1)
            while good == 1 and k >= 0:
                if policy.gaps.shape[0] > 0:
                    change_1 += share.shifted(policy, room, b, k, lane)
                vx = share.read_x(room, b, wp.static(at.vx))
                for j in range(nx):
                    wanted = wp.max(wanted, wp.abs(vx[j]))
                share.model(d, room, b, k, lane, mu_x, mu_u)
                qx = share.read_x(room, b, wp.static(at.qx))
                qu = share.read_u(room, b, wp.static(at.qu))
                quu = share.read_uu(room, b, wp.static(at.quu))
                ruu = share.read_uu(room, b, wp.static(at.ruu))
                rux = share.read_ux(room, b, wp.static(at.rux))
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
                    sizes = share.read_u(room, b, wp.static(at.sizes))
                    slopes = steepest(policy, b, k, limits, qu)
                    for i in range(nu):
                        highest[i] = wp.max(highest[i], slopes[i])
                        widest[i] = wp.max(widest[i], sizes[i])
                        felt += sizes[i] * sizes[i] / wp.max(ruu[i, i], ZERO)  # a held one may bend down
                    bent = quu * step
                    change_1 += wp.float64(wp.dot(step, qu))
                    change_2 += wp.float64(HALF * wp.dot(step, bent))
                    share.value(policy, room, b, k, lane, qu, bent, step, gain)
                    k -= 1
            together()
            if good == 1:
                unsolved = 0
            else:
                if lane == 0:
                    room[b, wp.static(at.raised)] = dtype(raise_regularization(state, b))
                together()
                if room[b, wp.static(at.raised)] == ZERO:
                    unsolved = 2
                else:
                    restarts += 1
        together()
        if lane == 0:
            end(
                policy, state, b, unsolved, restarts, broken, lowest, change_1, change_2, highest, widest,
                felt, wanted, tolerance, last,
            )  # fmt: skip

    return backward_by_lanes
