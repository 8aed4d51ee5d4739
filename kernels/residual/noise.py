"""Noise level sigma of every row, section IV.B: given for each row, or mapped from covariances of the state.

With covariances Sigma_q of positions and Sigma_v of velocities eq. (18) gives w_i = J_i v' + d_i/h the
variance sigma_i^2 = J_i (Sigma_q/h^2 + Sigma_v) J_i' (M18), at the start of every step; FLOOR is added in
squares, for rows whose J vanishes or that the covariances do not reach. The step keeps these levels in a
vector; a level given for a row is read where it is used. A logistic distribution's scale is sqrt(3)/pi of its
standard deviation: `Method.deviation` says which of the two a level is.
"""

import math
from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..mechanism.kinematics import make_types
from ..specialisation import Specialisation
from ..structure import layout

FLOOR = 1e-6  # [m/s, rad/s]
LOGISTIC = math.sqrt(3.0) / math.pi  # scale of a logistic distribution of standard deviation 1


@cached
def make_noise(spec: Specialisation) -> SimpleNamespace:
    """Warp functions of the noise.

    level[i](world, sigma): what the residual of row i takes as its sigma. spread(world, y): the
    covariance of the rows' velocities times y. deviation(J . y) for y = spread(J): sigma_i.
    """
    s, dtype, method = spec
    t = make_types(s, dtype)
    lay = layout(s)
    NV = s.nv
    VQ = t.VQ
    SIGMA, H = lay.offset("sigma"), lay.offset("step_size")
    POSITION, VELOCITY = (
        lay.offset(name) if s.uncertain else 0 for name in ("position_covariance", "velocity_covariance")
    )
    FACTOR = dtype(LOGISTIC)
    SMALLEST = dtype(FLOOR * FLOOR)
    ZERO = dtype(0.0)

    def make_level(i: int) -> wp.Function:
        @wp.func
        def level(world: t.World, sigma: t.VR):
            if wp.static(method.state_noise and method.converts):
                return FACTOR * sigma[wp.static(i)]
            if wp.static(method.state_noise):
                return sigma[wp.static(i)]
            if wp.static(method.converts):
                return FACTOR * world.params[wp.static(SIGMA + i)]
            return world.params[wp.static(SIGMA + i)]

        return level

    @wp.func
    def spread(world: t.World, y: VQ):
        out = VQ()
        h = world.params[wp.static(H)]
        for i in range(wp.static(NV)):
            for j in range(wp.static(NV)):
                c = world.params[wp.static(POSITION + NV * i + j)] / (h * h)
                out[i] = out[i] + (c + world.params[wp.static(VELOCITY + NV * i + j)]) * y[j]
        return out

    @wp.func
    def deviation(variance: dtype):
        return wp.sqrt(wp.max(variance, ZERO) + SMALLEST)

    return SimpleNamespace(
        level=tuple(make_level(i) for i in range(s.nr)), spread=spread, deviation=deviation
    )
