"""Control policies evaluated inside a rollout: u = control(policy, world, step, x).

Each maker returns the policy's struct of arrays and its Warp function. Differences of periodic state components are
wrapped to half a period (the finger's free ellipse looks the same after a turn by pi).
"""

import functools
from types import SimpleNamespace

import warp as wp


@functools.cache
def make_open_loop(nx: int, nu: int, dtype: type) -> SimpleNamespace:
    """Controls (B, N, nu), one sequence per world."""
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)

    @wp.struct
    class OpenLoop:
        us: wp.array3d(dtype=dtype)

    @wp.func
    def control(policy: OpenLoop, world: int, k: int, x: VX):
        u = VU()
        for i in range(wp.static(nu)):
            u[i] = policy.us[world, k, i]
        return u

    return SimpleNamespace(name="open_loop", Struct=OpenLoop, control=control)


@functools.cache
def make_tracking(nx: int, nu: int, dtype: type) -> SimpleNamespace:
    """u = us_k + K_k (x - xs_k) along one nominal trajectory per world or one for all; its last step is held."""
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)

    @wp.struct
    class Tracking:
        us: wp.array3d(dtype=dtype)  # (1 or B, N, nu)
        xs: wp.array3d(dtype=dtype)  # (1 or B, N, nx)
        gain: wp.array4d(dtype=dtype)  # (1 or B, N, nu, nx)
        period: wp.array(dtype=dtype)  # (nx,), 0: none

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
            u[i] = value
        return u

    wrapped = make_wrap(dtype)
    return SimpleNamespace(name="tracking", Struct=Tracking, control=control)


@functools.cache
def make_nearest(nx: int, nu: int, dtype: type) -> SimpleNamespace:
    """The nearest-neighbour rule (20): u = u_j + K_j (x - x_j), j = argmin |W (x - x_j)|, W W' = inverse covariance.

    Entries are stored whitened, y_j = W x_j, with one period per turn taken off: |W x - y_j - m W e_p period|.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)
    ZERO = dtype(0.0)
    FAR = dtype(1e30)

    @wp.struct
    class Nearest:
        us: wp.array2d(dtype=dtype)  # (L, nu)
        xs: wp.array2d(dtype=dtype)  # (L, nx)
        gain: wp.array3d(dtype=dtype)  # (L, nu, nx)
        white: wp.array2d(dtype=dtype)  # (L, nx) = W x_j
        whitening: wp.array2d(dtype=dtype)  # (nx, nx) W
        period: wp.array(dtype=dtype)  # (nx,)
        turning: int  # the periodic component, -1: none
        limit: dtype  # the feedback term K dx is clamped to +- limit

    @wp.func
    def nearest(policy: Nearest, x: VX):
        """Index of the nearest entry."""
        y = VX()
        jump = VX()
        for i in range(wp.static(nx)):
            value = ZERO
            for j in range(wp.static(nx)):
                value += policy.whitening[i, j] * x[j]
            y[i] = value
        period = ZERO
        angle = ZERO
        turning = wp.max(policy.turning, 0)
        if policy.turning >= 0:
            period = policy.period[turning]
            angle = x[turning]
            for i in range(wp.static(nx)):
                jump[i] = policy.whitening[i, turning] * period
        best = int(0)
        least = ZERO + FAR
        for e in range(policy.white.shape[0]):
            turns = ZERO
            if period > ZERO:
                turns = wp.round((angle - policy.xs[e, turning]) / period)
            distance = ZERO
            for i in range(wp.static(nx)):
                delta = y[i] - policy.white[e, i] - turns * jump[i]
                distance += delta * delta
            if distance < least:
                least = distance
                best = e
        return best

    @wp.func
    def control(policy: Nearest, world: int, k: int, x: VX):
        e = nearest(policy, x)
        u = VU()
        for i in range(wp.static(nu)):
            value = ZERO
            for j in range(wp.static(nx)):
                value += policy.gain[e, i, j] * wrapped(x[j] - policy.xs[e, j], policy.period[j])
            u[i] = policy.us[e, i] + wp.clamp(value, -policy.limit, policy.limit)
        return u

    wrapped = make_wrap(dtype)
    return SimpleNamespace(name="nearest", Struct=Nearest, control=control, nearest=nearest)


@functools.cache
def make_wrap(dtype: type) -> wp.Function:
    """wrapped(d, period): d less the nearest multiple of the period; d itself where the period is 0."""

    @wp.func
    def wrapped(d: dtype, period: dtype):
        if period > dtype(0.0):
            return d - period * wp.round(d / period)
        return d

    return wrapped
