"""What lies between a policy and its world: a noisy sensor, a zero-order hold, a delay, limits."""

from functools import partial
from typing import NamedTuple

import warp as wp

from ..device.compile import specialised
from ..device.random import make_normal
from ..factories import cached
from .contract import PolicyFunctions, PolicyKernel, make_policy
from .pieces import make_limits

SENSOR, OF_TASK = 1 << 21, 1 << 23  # first streams of sensors' noise, of a policy's own and of a task's
OF_ESTIMATES = 1 << 24  # and of what a filter reads beside them


class Between(NamedTuple):
    """What changes code: most steps of delay, whether a control is held over several steps, noise."""

    delay: int
    holds: bool
    noisy: bool


def around_kernel(inner: PolicyKernel, between: Between, timed: bool = False) -> PolicyKernel:
    """The kernel of a policy with things between it and the world; `timed` as of a `PolicyKernel`."""
    late = f"up to {between.delay} steps late" if between.delay else ""
    words = (late, "held" if between.holds else "", "with a noisy sensor" if between.noisy else "")
    by_world = ", by world" if timed else ""
    key = f"{inner.in_words}, {', '.join(filter(None, words)) or 'on time'}{by_world}:{inner.key}"
    return PolicyKernel(key, partial(make_around, inner, between), inner, inner.by_row, inner.apart, timed)


@cached
def make_around(inner: PolicyKernel, between: Between, nx: int, nu: int, dtype: type) -> PolicyFunctions:
    """Kept are the policy's memory, the control that is held, those on their way, the oldest first, and the
    step after the last one in which it was asked: another hold around it may not ask in every step.
    """
    asked = make_policy(inner, nx, nu, dtype)
    Inner, Inside = asked.Struct, wp.types.vector(max(asked.size, 1), dtype)
    DELAY, HELD = between.delay, asked.size
    WAY = HELD + (nu if between.holds else 0)
    FOLLOWS = WAY + DELAY * nu
    COUNTS = between.holds or DELAY > 0
    SIZE = max(1, FOLLOWS + COUNTS)
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)
    Memory = wp.types.vector(SIZE, dtype)
    normal, limited = make_normal(dtype).normal, make_limits(nu, dtype)

    @wp.struct
    class Around:
        inner: Inner
        delay: int  # steps, at most as many as there is code for
        hold: int  # steps
        seed: int
        stream: int  # the first of the noise
        noise: wp.array(dtype=dtype)  # (nx,) standard deviations
        lower: wp.array(dtype=dtype)  # (0 or nu,)
        upper: wp.array(dtype=dtype)
        before: wp.array(dtype=dtype)  # (0 or nu,) what acts until what is sent does

    @wp.func
    def start(data: Around, world: int, x: VX):
        memory = Memory()
        inside = asked.begin(data.inner, world, seen(data, world, 0, x))
        for j in range(HELD):
            memory[j] = inside[j]
        if data.before.shape[0] > 0:
            for j in range(wp.static(DELAY * nu)):
                memory[WAY + j] = data.before[j % nu]
        return memory

    @wp.func
    def seen(data: Around, world: int, step: int, x: VX):
        out = x
        if wp.static(between.noisy):
            for j in range(nx):
                out[j] = x[j] + data.noise[j] * normal(data.seed, world, step, data.stream + j)
        return out

    @wp.func
    def later(data: Around, memory: Memory):
        """What is on the way, one step nearer; behind it what was sent last."""
        out = memory
        for d in range(DELAY - 1):
            if d < data.delay - 1:
                for i in range(nu):
                    out[WAY + d * nu + i] = memory[WAY + (d + 1) * nu + i]
        return out

    @wp.func
    def control(data: Around, world: int, step: int, x: VX, memory: Memory):
        after = memory
        u = VU()
        follows = step  # the step after the last one in which this was asked, or 0
        if wp.static(COUNTS):
            follows = int(memory[FOLLOWS])
            after[FOLLOWS] = dtype(step + 1)
        asks = follows == 0 or step // data.hold != (follows - 1) // data.hold
        if asks:
            inside = Inside()
            for j in range(HELD):
                inside[j] = memory[j]
            u, inside = asked.ask(data.inner, world, step, seen(data, world, step, x), inside)
            for j in range(HELD):
                after[j] = inside[j]
        if wp.static(between.holds):
            for i in range(nu):
                if not asks:
                    u[i] = memory[HELD + i]
                after[HELD + i] = u[i]
        if wp.static(DELAY > 0):
            if data.delay > 0:
                missed = wp.where(follows == 0, 0, step - follows)  # in which nobody asked
                for _step in range(wp.min(missed, data.delay)):
                    after = later(data, after)
                arriving = VU()
                for i in range(nu):
                    arriving[i] = after[WAY + i]
                after = later(data, after)
                for i in range(nu):
                    after[WAY + (data.delay - 1) * nu + i] = u[i]
                u = arriving
        return limited(data.lower, data.upper, u), after

    return PolicyFunctions(Around, control, SIZE, start)


@cached
def make_noise_kernel(nx: int, dtype: type) -> wp.Kernel:
    """The sensor's noise (B, nx) of step k, for whoever repeats what a kernel has seen."""
    normals = make_normal(dtype).normals

    @specialised
    def noise_kernel(
        first: int,
        k: int,
        seed: int,
        stream: int,
        deviation: wp.array(dtype=dtype),  # (nx,)
        noise: wp.array2d(dtype=dtype),  # out (B, nx)
    ):
        i = first + wp.tid()
        for j in range(nx):
            noise[i, j] = deviation[j] * normals(seed, i, k, stream + j)[0]

    return noise_kernel


@cached
def make_sensor_kernel(dtype: type) -> wp.Kernel:
    """What a noisy sensor shows of states in the step that is each world's next."""
    normal = make_normal(dtype).normal

    @specialised
    def sensor_kernel(
        first: int,
        next: wp.array(dtype=wp.int32),  # (B,) steps
        seed: int,
        stream: int,  # the first
        number: wp.array(dtype=wp.int32),  # (B,) of the worlds
        noise: wp.array(dtype=dtype),  # (nx,) standard deviations
        state: wp.array2d(dtype=dtype),  # (B, nx)
        seen: wp.array2d(dtype=dtype),  # out (B, nx)
    ):
        i = first + wp.tid()
        for j in range(noise.shape[0]):
            seen[i, j] = state[i, j] + noise[j] * normal(seed, number[i], next[i], stream + j)

    return sensor_kernel
