"""Worlds of a sweep between two launches: where they stand, and what meets them before their next step."""

from types import SimpleNamespace

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from ..structure import STEP_SIZE
from .disturbances import make_conditions, make_disturbances, make_events

# columns of what a sweep notes of its worlds (B, NOTED): how deep rows overlap where the first step begins
# [m, rad], NaN: not known; when the step began that was not solved [s], infinite: all were
OVERLAP, STOPPED, NOTED = 0, 1, 2


@wp.struct
class Progress:
    """Where every world (B) of a sweep stands."""

    record: wp.array(dtype=wp.int32)  # next record
    event: wp.array(dtype=wp.int32)  # next kick
    steps: wp.array(dtype=wp.int32)  # number of steps in all
    status: wp.array(dtype=wp.int32)
    records: wp.array3d(dtype=wp.float32)  # (B, S, R)


@cached
def make_span(dtype: type) -> type:
    """Struct of what worlds carry over from the launch before."""

    @wp.struct
    class Span:
        p: Progress
        state: wp.array2d(dtype=dtype)  # (B, nx)
        warm: wp.array2d(dtype=dtype)  # (B, nr + 2 pairs)
        memory: wp.array2d(dtype=dtype)  # (B, memory of the policy)

    return Span


@cached
def make_arrival(nv: int, nu: int, dtype: type) -> SimpleNamespace:
    """arrive(c, e, params, x0, p, i, k, state) -> x: records and kicks of step k of launch's world i, which
    come once however often they are asked for; `kernel` does it for all worlds, of the step that is each
    one's next.
    """
    disturb = make_disturbances(nv, nu, dtype)
    VX, Conditions, Events = wp.types.vector(2 * nv, dtype), make_conditions(dtype), make_events(dtype)

    @wp.func
    def arrive(
        c: Conditions,
        e: Events,
        params: wp.array2d(dtype=dtype),
        x0: wp.array2d(dtype=dtype),
        p: Progress,
        i: int,
        k: int,
        state: wp.array2d(dtype=dtype),
    ):
        x = VX()
        for j in range(2 * nv):
            x[j] = state[i, j]
        event = p.event[i]
        h = disturb.seconds(c, params[i, STEP_SIZE])
        time = wp.float64(k) * h
        p.record[i] = disturb.record(c, p.records, i, p.record[i], time, h, x, x0)
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
        next: wp.array(dtype=wp.int32),  # (B,) steps
        c: Conditions,
        e: Events,
        params: wp.array2d(dtype=dtype),  # (B, P)
        x0: wp.array2d(dtype=dtype),  # (B, nx)
        p: Progress,
        state: wp.array2d(dtype=dtype),  # in and out (B, nx)
    ):
        i = first + wp.tid()
        if next[i] < p.steps[i]:
            arrive(c, e, params, x0, p, i, next[i], state)

    return SimpleNamespace(arrive=arrive, kernel=sweep_arrival_kernel)
