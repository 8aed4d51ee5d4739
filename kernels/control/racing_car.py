"""The racing car of the paper's [18]: a step with smoothed tyre friction, and the cost of a bend with walls.

State (x, y, heading, v_x, v_y) [m, rad, m/s]; controls (thrust [m/s^2], curvature of the steering [1/m]). The
tyres roll along the heading t and hold across it, along n, with Coulomb friction of at most mu g per mass. A
step steers, thrusts, and solves for the lateral impulse -p per mass of a box problem of one row: |p| <= mu g
h, and v_n = 0 after the step unless |p| = mu g h. Its solution is p = clamp(v_n, mu g h). Logistic noise of
scale sigma [m/s] on v_n turns that into its mean (M40),

    p = s(v_n + mu g h) - s(v_n - mu g h) - mu g h,   s(z) = sigma log(1 + e^(z/sigma)) of (5) and (17).
"""

import warp as wp

from ..residual.smoothing import make_smoothing
from .costs import CostFunctions
from .user_dynamics import DynamicsFunctions


def make_car(dtype, VX, VU):
    """A step; parameters step_size [s], friction, sigma [m/s], gravity [m/s^2]."""
    smooth = make_smoothing(dtype, "rem-logistic").smooth
    ONE = dtype(1.0)

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        h, sigma = params[row, 0], params[row, 2]
        most = params[row, 1] * params[row, 3] * h
        along = wp.cos(x[2]) * x[3] + wp.sin(x[2]) * x[4]
        heading = x[2] + h * u[1] * along
        c, s = wp.cos(heading), wp.sin(heading)
        vx, vy = x[3] + h * u[0] * c, x[4] + h * u[0] * s
        across = c * vy - s * vx
        high = smooth(across + most, sigma, ONE / sigma)
        low = smooth(across - most, sigma, ONE / sigma)
        p = high[0] - low[0] - most
        vx, vy = vx + s * p, vy - c * p
        return VX(x[0] + h * vx, x[1] + h * vy, heading, vx, vy)

    return DynamicsFunctions(step)


def make_hairpin(dtype, VX, VU):
    """Legs along x < 0 at y = -R and R, joined by a half circle: l_f = x plus walls, l = effort plus walls.

    A wall costs the mean of (max(0, excess + noise))^2, the noise normal: the position is known only so well.
    Weights: of the walls [1/m^2], standard deviation of the position [m], of either control squared / 2, R
    [m], half the width of the road [m].
    """
    smooth = make_smoothing(dtype, "rem-normal").smooth
    ZERO, ONE, HALF = dtype(0.0), dtype(1.0), dtype(0.5)

    @wp.func
    def mean_square(excess: dtype, sd: dtype):
        s = smooth(excess, sd, ONE / sd)  # s[0] the mean of max(0, excess + noise), s[2] its slope
        return excess * s[0] + sd * sd * s[2]

    @wp.func
    def walls(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        radius = wp.abs(x[1])
        if x[0] > ZERO:
            radius = wp.sqrt(x[0] * x[0] + x[1] * x[1])
        offset, sd, width = radius - weights[row, 4], weights[row, 1], weights[row, 5]
        return weights[row, 0] * (mean_square(offset - width, sd) + mean_square(-offset - width, sd))

    @wp.func
    def running(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
        effort = weights[row, 2] * u[0] * u[0] + weights[row, 3] * u[1] * u[1]
        return HALF * effort + walls(weights, row, x)

    @wp.func
    def final(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        return x[0] + walls(weights, row, x)

    return CostFunctions(running, final)
