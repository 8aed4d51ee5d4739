"""Small dense factorisations and the box-constrained quadratic program of one DDP step, one thread each."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached

EPSILON = {wp.float32: 1.1920929e-07, wp.float64: 2.220446049250313e-16}


@cached
def make_small_solver(nx, nu, dtype):
    """Warp functions on (nu, nu) matrices: Cholesky that detects failure, substitution, projected Newton."""
    VU = wp.types.vector(nu, dtype)
    MUU = wp.types.matrix((nu, nu), dtype)
    MUX = wp.types.matrix((nu, nx), dtype)
    ZERO, ONE, HALF = dtype(0.0), dtype(1.0), dtype(0.5)
    PIVOT_FLOOR = dtype(8.0 * EPSILON[dtype])
    TOLERANCE = dtype(16.0 * EPSILON[dtype])
    ARMIJO = dtype(0.1)
    MAX_ITERATIONS = 20 + 10 * nu

    @wp.func
    def cholesky(a: MUU):
        """Lower factor of a, and its smallest pivot: not positive (or NaN) if a is not positive definite."""
        l = MUU()
        lowest = dtype(0.0)
        for i in range(nu):
            for j in range(i + 1):
                s = a[i, j]
                for m in range(j):
                    s -= l[i, m] * l[j, m]
                if j < i:
                    l[i, j] = s / l[j, j]
                else:
                    if not (s > PIVOT_FLOOR * wp.abs(a[i, i])):
                        if wp.isfinite(s):
                            return l, wp.min(s, ZERO)
                        return l, s
                    l[i, i] = wp.sqrt(s)
                    if i == 0 or s < lowest:
                        lowest = s
        return l, lowest

    @wp.func
    def solve_vector(l: MUU, b: VU):
        """Solution of l l' y = b."""
        y = VU()
        for i in range(nu):
            s = b[i]
            for m in range(i):
                s -= l[i, m] * y[m]
            y[i] = s / l[i, i]
        for r in range(nu):
            i = nu - 1 - r
            s = y[i]
            for m in range(i + 1, nu):
                s -= l[m, i] * y[m]
            y[i] = s / l[i, i]
        return y

    @wp.func
    def solve_matrix(l: MUU, b: MUX):
        """Solution of l l' Y = b, column by column."""
        y = MUX()
        for c in range(nx):
            for i in range(nu):
                s = b[i, c]
                for m in range(i):
                    s -= l[i, m] * y[m, c]
                y[i, c] = s / l[i, i]
            for r in range(nu):
                i = nu - 1 - r
                s = y[i, c]
                for m in range(i + 1, nu):
                    s -= l[m, i] * y[m, c]
                y[i, c] = s / l[i, i]
        return y

    @wp.func
    def clamp_vector(v: VU, lower: VU, upper: VU):
        """v held inside its limits; NaN stays NaN."""
        out = v
        for i in range(nu):
            if v[i] < lower[i]:
                out[i] = lower[i]
            if v[i] > upper[i]:
                out[i] = upper[i]
        return out

    @wp.func
    def free_set(y: VU, g: VU, lower: VU, upper: VU):
        """1 for controls that may move downhill, 0 for those that a limit holds."""
        free = VU()
        for i in range(nu):
            free[i] = ONE
            if (y[i] <= lower[i] and g[i] > ZERO) or (y[i] >= upper[i] and g[i] < ZERO):
                free[i] = ZERO
        return free

    @wp.func
    def masked(h: MUU, free: VU):
        """h with rows and columns of held controls replaced by the identity's."""
        out = MUU()
        for i in range(nu):
            for j in range(nu):
                out[i, j] = h[i, j] * free[i] * free[j]
            out[i, i] += ONE - free[i]
        return out

    @wp.func
    def step_inside(h: MUU, l: MUU, slope: VU, y: VU, free: VU, lower: VU, upper: VU):
        """Newton's step on the free set, less what would lead out of limits that y is at: downhill."""
        moving = free
        step = -solve_vector(l, wp.cw_mul(slope, free))
        blocked = int(1)
        while blocked == 1:
            blocked = int(0)
            left = int(0)
            for i in range(nu):
                if (y[i] <= lower[i] and step[i] < ZERO) or (y[i] >= upper[i] and step[i] > ZERO):
                    moving[i] = ZERO
                    blocked = 1
                if moving[i] == ONE:
                    left = 1
            if blocked == 1:
                step = -wp.cw_mul(slope, free)  # along the gradient nothing leads out
                if left == 1:
                    factor, _lowest = cholesky(masked(h, moving))
                    step = -solve_vector(factor, wp.cw_mul(slope, moving))
                else:
                    step = step / wp.trace(h)
                    blocked = 0
        return step

    @wp.func
    def to_first_limit(y: VU, step: VU, lower: VU, upper: VU):
        """y + t step with the largest t <= 1 that stays inside; what meets its limit is on it exactly."""
        length = ONE
        for i in range(nu):
            if y[i] + step[i] < lower[i]:
                length = wp.min(length, (lower[i] - y[i]) / step[i])
            if y[i] + step[i] > upper[i]:
                length = wp.min(length, (upper[i] - y[i]) / step[i])
        out = clamp_vector(y + length * step, lower, upper)
        for i in range(nu):
            if y[i] + step[i] < lower[i] and (lower[i] - y[i]) / step[i] <= length:
                out[i] = lower[i]
            if y[i] + step[i] > upper[i] and (upper[i] - y[i]) / step[i] <= length:
                out[i] = upper[i]
        return out

    @wp.func
    def box_qp(h: MUU, g: VU, lower: VU, upper: VU, start: VU):
        """Minimise y'hy/2 + g'y within lower <= y <= upper by projected Newton (Tassa et al. 2014, III).

        Where the projected step does not lower the cost, the step to the first limit does.

        Returns y, the free set, the factor of h on it, and the smallest pivot (not positive: h is not
        positive definite on a free set that was met; y is then of no use).
        """
        y = clamp_vector(start, lower, upper)
        free = VU()
        l = MUU()
        pivot = dtype(0.0)
        running = int(1)
        iteration = int(0)
        while running == 1:
            slope = g + h * y
            free = free_set(y, slope, lower, upper)
            l, pivot = cholesky(masked(h, free))
            scale = dtype(0.0)
            size = dtype(0.0)
            for i in range(nu):
                size = wp.max(size, wp.abs(slope[i]) * free[i])
                for j in range(nu):
                    scale = wp.max(scale, wp.abs(h[i, j] * y[j]))
                scale = wp.max(scale, wp.abs(g[i]))
            if not (pivot > ZERO) or not (size > TOLERANCE * scale) or iteration >= MAX_ITERATIONS:
                running = 0
            else:
                step = step_inside(h, l, slope, y, free, lower, upper)
                trial = clamp_vector(y + step, lower, upper)
                move = trial - y
                descent = -wp.dot(slope, move)
                if descent - HALF * wp.dot(move, h * move) < ARMIJO * descent:
                    trial = to_first_limit(y, step, lower, upper)
                y = trial
            iteration += 1
        return y, free, l, pivot

    return SimpleNamespace(
        cholesky=cholesky,
        solve_vector=solve_vector,
        solve_matrix=solve_matrix,
        clamp_vector=clamp_vector,
        free_set=free_set,
        masked=masked,
        box_qp=box_qp,
    )
