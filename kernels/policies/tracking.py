"""Feedback along a trajectory, u = us_k + K_k (x - xs_k); along a single point, linear feedback."""

import warp as wp

from ..factories import cached
from .contract import PolicyFunctions, PolicyKernel
from .pieces import make_hold, make_wrap


@cached
def make_tracking(nx: int, nu: int, dtype: type) -> PolicyFunctions:
    """u = us_k + K_k (x - xs_k) along one trajectory per world or one for all; its last step is held."""
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)

    @wp.struct
    class Tracking:
        us: wp.array3d(dtype=dtype)  # (1 or B, N, nu)
        xs: wp.array3d(dtype=dtype)  # (1 or B, >= N, nx)
        gain: wp.array4d(dtype=dtype)  # (1 or B, N, nu, nx)
        period: wp.array(dtype=dtype)  # (nx,), 0: none
        lower: wp.array2d(dtype=dtype)  # (0, 1 or B, nu) limits of the controls
        upper: wp.array2d(dtype=dtype)

    @wp.func
    def control(policy: Tracking, world: int, k: int, x: VX):
        row = wp.where(policy.us.shape[0] == 1, 0, world)
        at = wp.min(k, policy.us.shape[1] - 1)
        dx = VX()
        for j in range(wp.static(nx)):
            dx[j] = wrapped(x[j] - policy.xs[row, at, j], policy.period[j])
        u = VU()
        for i in range(wp.static(nu)):
            value = policy.us[row, at, i]
            for j in range(wp.static(nx)):
                value += policy.gain[row, at, i, j] * dx[j]
            if policy.lower.shape[0] > 0:
                limits = wp.where(policy.lower.shape[0] == 1, 0, world)
                value = held(value, policy.lower[limits, i], policy.upper[limits, i])
            u[i] = value
        return u

    wrapped, held = make_wrap(dtype), make_hold(dtype)
    return PolicyFunctions(Tracking, control)


TRACKING = PolicyKernel("tracking", make_tracking)
