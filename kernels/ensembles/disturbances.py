"""What the worlds of a sweep go through, and when they are looked at: the same in every sweep's kernels."""

from types import SimpleNamespace

import warp as wp

from ..device.random import make_normal
from ..factories import cached
from ..policies.pieces import make_limits

# streams of the random numbers
START, CHOICE, PARAMETER, TORQUE, KICK = 0, 100, 200, 300, 400
FAR = 1 << 20  # streams of the torques beyond the hundredth, which would meet those of the kicks


@cached
def make_conditions(dtype: type) -> type:
    """Struct of the numbers that all worlds of a launch share."""

    @wp.struct
    class Conditions:
        world0: int  # number of the launch's first world
        seed: int
        torque: dtype  # standard deviation of white torque noise per step
        kick: dtype  # standard deviation of velocity kicks
        kick_times: wp.array(dtype=wp.float64)  # (K,) [s]
        duration: wp.float64  # [s]
        interval: wp.float64  # between two samples [s]
        component: int  # of the state that is sampled
        lower: wp.array(dtype=dtype)  # (0 or nu,) limits of the controls before their noise
        upper: wp.array(dtype=dtype)

    return Conditions


@cached
def make_disturbances(nv: int, nu: int, dtype: type) -> SimpleNamespace:
    """Warp functions of what happens to world `world` of a sweep, under its `Conditions` c.

    limited(c, u): controls within their limits. due(c, event, time, h): kicks up to the step that begins at
    `time`, from the first that is still to come.
    kicked(c, world, event, x), noisy(c, world, k, u): a state after a kick, controls of step k with noise.
    sampled(c, samples, i, sample, time, h, value): writes the samples of launch's world i up to `time` and
    gives the first that is still to come.
    """
    rng = make_normal(dtype)
    Conditions = make_conditions(dtype)
    VX, VU = wp.types.vector(2 * nv, dtype), wp.types.vector(max(nu, 1), dtype)
    HALF = wp.float64(0.5)
    within = make_limits(nu, dtype)

    @wp.func
    def due(c: Conditions, event: int, time: wp.float64, h: wp.float64):
        last = event
        while last < c.kick_times.shape[0] and time >= c.kick_times[last] - HALF * h:
            last += 1
        return last

    @wp.func
    def kicked(c: Conditions, world: int, event: int, x: VX):
        out = x
        for j in range(nv):
            out[nv + j] = x[nv + j] + c.kick * rng.normals(c.seed, world, event, KICK + j)[0]
        return out

    @wp.func
    def limited(c: Conditions, u: VU):
        return within(c.lower, c.upper, u)

    @wp.func
    def noisy(c: Conditions, world: int, k: int, u: VU):
        out = u
        if c.torque > dtype(0.0):
            for j in range(nu):
                stream = wp.where(j < KICK - TORQUE, TORQUE + j, FAR + j)
                out[j] = u[j] + c.torque * rng.normals(c.seed, world, k, stream)[0]
        return out

    @wp.func
    def sampled(
        c: Conditions,
        samples: wp.array2d(dtype=wp.float32),
        i: int,
        sample: int,
        time: wp.float64,
        h: wp.float64,
        value: wp.float32,
    ):
        out = sample
        while out < samples.shape[1] and time >= wp.float64(out) * c.interval - HALF * h:
            samples[i, out] = value
            out += 1
        return out

    return SimpleNamespace(due=due, kicked=kicked, limited=limited, noisy=noisy, sampled=sampled)
