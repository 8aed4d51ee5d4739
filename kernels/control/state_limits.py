"""Limits on states as an augmented Lagrangian: a penalty on top of the cost (Nocedal & Wright, 17.4).

With the multiplier y and the weight w of a limited state s at a step, and v = s + y/w less the nearest point
between the limits, the penalty is w v^2 / 2 - y^2 / (2 w) (M46); the next multiplier is w v (M47). Where y
stays 0 the limits are soft.
"""

from types import SimpleNamespace

import warp as wp

from ..device.compile import named_by_code
from ..factories import cached
from .solver_state import make_derivative_arrays, make_policy_arrays


@cached
def make_state_limits(dtype):
    """Struct of the limits of the states, and what is paid beyond them; a problem without any has no rows."""

    @wp.struct
    class StateLimits:
        lower: wp.array(ndim=2, dtype=dtype)  # (1 or B, nx), infinite where there is none
        upper: wp.array(ndim=2, dtype=dtype)  # (1 or B, nx)
        weight: wp.array(dtype=dtype)  # (B,)
        multiplier: wp.array(ndim=3, dtype=dtype)  # (B, N+1, nx); of the first state unused

    return StateLimits


@cached
def make_penalty(nx, dtype):
    """Warp functions of state limits at step k of problem b: the penalty on a state, and its violation v."""
    VX = wp.types.vector(nx, dtype)
    StateLimits = make_state_limits(dtype)
    HALF = dtype(0.5)

    @wp.func
    def violation(limits: StateLimits, b: int, k: int, x: VX):
        row = wp.where(limits.lower.shape[0] == 1, 0, b)
        out = VX()
        for i in range(wp.static(nx)):
            shifted = x[i] + limits.multiplier[b, k, i] / limits.weight[b]
            if shifted < limits.lower[row, i]:
                out[i] = shifted - limits.lower[row, i]
            if shifted > limits.upper[row, i]:
                out[i] = shifted - limits.upper[row, i]
        return out

    @wp.func
    def penalty(limits: StateLimits, b: int, k: int, x: VX):
        v = violation(limits, b, k, x)
        out = HALF * limits.weight[b] * wp.dot(v, v)
        for i in range(wp.static(nx)):
            y = limits.multiplier[b, k, i]
            out -= HALF * y * y / limits.weight[b]
        return out

    return SimpleNamespace(violation=violation, penalty=penalty)


@cached
def make_limit_kernels(nx, dtype):
    """Kernels over problems: ``add`` puts the penalties' derivatives on the cost's; ``update`` makes the next
    multipliers and weights.
    """
    Policy = make_policy_arrays(dtype)
    VX = wp.types.vector(nx, dtype)
    StateLimits, Derivatives = make_state_limits(dtype), make_derivative_arrays(dtype)
    violation = make_penalty(nx, dtype).violation
    ZERO = dtype(0.0)

    @wp.func
    def state(policy: Policy, b: int, k: int):
        x = VX()
        for i in range(nx):
            x[i] = policy.xs[b, k, i]
        return x

    @named_by_code(max_unroll=1)
    def add(
        first: int, policy: Policy, limits: StateLimits, fresh: wp.array(dtype=wp.int32), out: Derivatives
    ):
        b = first + wp.tid()
        if fresh[b] == 0:
            return
        for k in range(1, policy.xs.shape[1]):
            v = violation(limits, b, k, state(policy, b, k))
            for i in range(nx):
                if v[i] != ZERO:
                    out.lx[b, k, i] = out.lx[b, k, i] + limits.weight[b] * v[i]
                    out.lxx[b, k, i, i] = out.lxx[b, k, i, i] + limits.weight[b]

    @named_by_code(max_unroll=1)
    def update(
        first: int, policy: Policy, limits: StateLimits, going: wp.array(dtype=wp.int32), factor: dtype
    ):
        b = first + wp.tid()
        if going[b] == 0:
            return
        for k in range(1, policy.xs.shape[1]):
            v = violation(limits, b, k, state(policy, b, k))
            for i in range(nx):
                limits.multiplier[b, k, i] = limits.weight[b] * v[i]
        limits.weight[b] = factor * limits.weight[b]

    return add, update
