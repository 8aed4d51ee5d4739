"""Worlds of a sweep between two launches: where they stand, and what meets them before their next step."""

from types import SimpleNamespace

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from ..structure import STEP_SIZE
from .disturbances import make_conditions, make_disturbances, make_events


@wp.struct
class Progress:
    """Where every world (B) of a sweep stands."""

    sample: wp.array(dtype=wp.int32)  # next sample
    event: wp.array(dtype=wp.int32)  # next kick
    steps: wp.array(dtype=wp.int32)  # number of steps in all
    status: wp.array(dtype=wp.int32)
    start: wp.array(dtype=wp.float64)  # the observed component at the start
    samples: wp.array2d(dtype=wp.float32)  # (B, S)


@cached
def make_span(dtype: type) -> type:
    """Struct of the steps of a launch, and of what its worlds carry over from the launch before."""

    @wp.struct
    class Span:
        first: int  # step
        last: int  # one after the last
        p: Progress
        state: wp.array2d(dtype=dtype)  # (B, nx)
        warm: wp.array2d(dtype=dtype)  # (B, nr + 2 pairs)
        memory: wp.array2d(dtype=dtype)  # (B, memory of the policy)

    return Span


@cached
def make_arrival(nv: int, nu: int, dtype: type) -> SimpleNamespace:
    """arrive(c, e, params, p, i, k, state) -> x: samples and kicks of step k of launch's world i, which come
    once however often they are asked for; `kernel` does it for all worlds.
    """
    disturb = make_disturbances(nv, nu, dtype)
    VX, Conditions, Events = wp.types.vector(2 * nv, dtype), make_conditions(dtype), make_events(dtype)

    @wp.func
    def arrive(
        c: Conditions,
        e: Events,
        params: wp.array2d(dtype=dtype),
        p: Progress,
        i: int,
        k: int,
        state: wp.array2d(dtype=dtype),
    ):
        x = VX()
        for j in range(2 * nv):
            x[j] = state[i, j]
        event = p.event[i]
        if k == 0 and event == 0:
            p.start[i] = wp.float64(x[c.component])
        h = wp.float64(params[i, STEP_SIZE])
        time = wp.float64(k) * h
        moved = wp.float32(x[c.component] - dtype(p.start[i]))
        p.sample[i] = disturb.sampled(c, p.samples, i, p.sample[i], time, h, moved)
        coming = disturb.due(c, event, time, h)
        if coming > event:
            while event < coming:
                x = disturb.kicked(e, i, event, x)
                event += 1
            for j in range(2 * nv):
                state[i, j] = x[j]
            p.event[i] = event
        return x

    @specialised
    def sweep_arrival_kernel(
        first: int,
        k: int,
        c: Conditions,
        e: Events,
        params: wp.array2d(dtype=dtype),  # (B, P)
        p: Progress,
        state: wp.array2d(dtype=dtype),  # in and out (B, nx)
    ):
        i = first + wp.tid()
        if k < p.steps[i]:
            arrive(c, e, params, p, i, k, state)

    return SimpleNamespace(arrive=arrive, kernel=sweep_arrival_kernel)
