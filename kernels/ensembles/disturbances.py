"""What the worlds of a sweep go through, and when they are looked at: the same in every sweep's kernels."""

from types import SimpleNamespace

import warp as wp

from ..device.random import make_normal
from ..factories import cached
from ..policies.pieces import make_limits

# streams of the random numbers; those of noisy sensors are in `policies/around.py`
START, CHOICE, PARAMETER, TORQUE, KICK = 0, 100, 200, 300, 400
FAR = 1 << 20  # streams of the torques beyond the hundredth, which would meet those of the kicks
PUSH, DROPOUT, DROPPED, TIMING = 1 << 22, (1 << 22) + 10, (1 << 22) + 20, (1 << 22) + 30
PUSH_FIELDS = ("start", "duration", "fx", "fy", "torque")  # of a push [s, s, N, N, N m]
DROPOUT_FIELDS = ("start", "duration")  # of a dropout [s]
TIMING_FIELDS = ("delay", "hold")  # of controls [s]
END = 1e300  # time after a world's last step [s]
ROUNDING = 1e-6  # of a step: by so much times may miss the limits that they are to meet
SINGLE = 1e-7  # of a time, the same: step sizes of single precision add up


@cached
def make_conditions(dtype: type) -> type:
    """Struct of the numbers that all worlds of a launch share."""

    @wp.struct
    class Conditions:
        world0: int  # number of the launch's first world
        step: wp.float64  # [s] of worlds that draw none; delays and holds are counted in it
        seed: int
        torque: dtype  # standard deviation of white torque noise per step
        dropped: wp.float64  # share of the steps without controls
        kick_times: wp.array(dtype=wp.float64)  # (K,) [s]
        pushed: wp.array(dtype=wp.int32)  # (Q,) bodies
        point: wp.array2d(dtype=dtype)  # (Q, 3): where in the body's frame [m]; 0: off its centre of mass
        com: int  # column of the parameters where the bodies' centres of mass begin
        turns: wp.array2d(dtype=wp.int32)  # (Q, nv): 1 where a coordinate turns the body
        leans: wp.array2d(dtype=wp.int32)  # (Q, L): columns of parameters that turn it, -1: none
        duration: wp.float64  # [s]
        interval: wp.float64  # between two records [s]
        recorded: wp.array(dtype=wp.int32)  # (R,) components of the state
        lower: wp.array(dtype=dtype)  # (0 or nu,) limits of the controls before their noise
        upper: wp.array(dtype=dtype)

    return Conditions


@cached
def make_events(dtype: type) -> type:
    """Struct of what happens to each of the B worlds of a launch; arrays without worlds: nothing of this."""

    @wp.struct
    class Events:
        number: wp.array(dtype=wp.int32)  # (0 or B,) of the worlds; without: from Conditions.world0 on
        kick: wp.array3d(dtype=dtype)  # (B, K, nv) added to the velocities
        push: wp.array3d(dtype=wp.float64)  # (B, Q, 5), see PUSH_FIELDS
        dropout: wp.array3d(dtype=wp.float64)  # (B, D, 2), see DROPOUT_FIELDS
        timing: wp.array3d(dtype=wp.float64)  # (0 or B, 1, 2), see TIMING_FIELDS
        external: wp.array2d(dtype=dtype)  # (0 or B, 3 nb), where pushes write the forces of a step
        told: wp.array3d(dtype=dtype)  # (0 or B, N, nx + nu + 3 nb) out: state, controls and forces of steps

    return Events


@cached
def make_disturbances(nv: int, nu: int, dtype: type) -> SimpleNamespace:
    """Warp functions of what happens to a world of a sweep, row i of Events e, under Conditions c.

    seconds(c, h): a world's step size in float64, so that times are those of any precision.
    number(c, e, i): the world's number. due(c, event, time, h): kicks up to the step that begins at `time`,
    from the first that is still to come. kicked(e, i, event, x): a state after a kick.
    acting(c, e, i, world, k, time, h, u): controls of step k as they act: within limits, with noise, dropped.
    push(c, e, i, params, x, time, h): writes the forces of a step into e.external.
    tell(e, i, k, x, u): notes what step k begins from, where that is asked for.
    record(c, records, i, record, time, h, x, x0): writes the records of launch's world i up to `time`, what
    components of x are beyond the start in row i of x0, and gives the first that is still to come.
    """
    rng = make_normal(dtype)
    Conditions, Events = make_conditions(dtype), make_events(dtype)
    VX, VU = wp.types.vector(2 * nv, dtype), wp.types.vector(max(nu, 1), dtype)
    HALF, ZERO, EPS, PART = wp.float64(0.5), wp.float64(0.0), wp.float64(ROUNDING), wp.float64(SINGLE)
    within = make_limits(nu, dtype)

    @wp.func
    def seconds(c: Conditions, h: dtype):
        if dtype(c.step) == h:  # not one that was rounded, whose steps add up to another time
            return c.step
        return wp.float64(h)

    @wp.func
    def number(c: Conditions, e: Events, i: int):
        if e.number.shape[0] > 0:
            return e.number[i]
        return c.world0 + i

    @wp.func
    def due(c: Conditions, event: int, time: wp.float64, h: wp.float64):
        last = event
        while last < c.kick_times.shape[0] and time >= c.kick_times[last] - HALF * h:
            last += 1
        return last

    @wp.func
    def kicked(e: Events, i: int, event: int, x: VX):
        out = x
        for j in range(nv):
            out[nv + j] = x[nv + j] + e.kick[i, event, j]
        return out

    @wp.func
    def noisy(c: Conditions, world: int, k: int, u: VU):
        out = u
        if c.torque > dtype(0.0):
            for j in range(nu):
                stream = wp.where(j < KICK - TORQUE, TORQUE + j, FAR + j)
                out[j] = u[j] + c.torque * rng.normal(c.seed, world, k, stream)
        return out

    @wp.func
    def drops(c: Conditions, e: Events, i: int, world: int, k: int, time: wp.float64, h: wp.float64):
        """1 in a step without controls."""
        if c.dropped > ZERO:
            if rng.share(c.seed, world, k, wp.static(DROPPED)) < c.dropped:
                return 1
        for d in range(e.dropout.shape[1]):
            since = time - e.dropout[i, d, 0] + EPS * h + PART * time
            if since >= ZERO and since < e.dropout[i, d, 1]:
                return 1
        return 0

    @wp.func
    def acting(c: Conditions, e: Events, i: int, world: int, k: int, time: wp.float64, h: wp.float64, u: VU):
        if drops(c, e, i, world, k, time, h) == 1:
            return VU()
        return noisy(c, world, k, within(c.lower, c.upper, u))

    @wp.func
    def push(
        c: Conditions,
        e: Events,
        i: int,
        params: wp.array(dtype=dtype),
        x: VX,
        time: wp.float64,
        h: wp.float64,
    ):
        for j in range(e.external.shape[1]):
            e.external[i, j] = dtype(0.0)
        for n in range(e.push.shape[1]):
            start = e.push[i, n, 0]
            share = (wp.min(start + e.push[i, n, 1], time + h) - wp.max(start, time)) / h  # of the step
            if share > ZERO:
                angle = dtype(0.0)
                for j in range(nv):
                    if c.turns[n, j] == 1:
                        angle += x[j]
                for j in range(c.leans.shape[1]):
                    if c.leans[n, j] >= 0:
                        angle += params[c.leans[n, j]]
                body = c.pushed[n]
                rx = c.point[n, 0] - c.point[n, 2] * params[c.com + 2 * body]
                ry = c.point[n, 1] - c.point[n, 2] * params[c.com + 2 * body + 1]
                ax = wp.cos(angle) * rx - wp.sin(angle) * ry
                ay = wp.sin(angle) * rx + wp.cos(angle) * ry
                fx = dtype(share * e.push[i, n, 2])
                fy = dtype(share * e.push[i, n, 3])
                torque = dtype(share * e.push[i, n, 4]) + ax * fy - ay * fx
                e.external[i, 3 * body] = e.external[i, 3 * body] + fx
                e.external[i, 3 * body + 1] = e.external[i, 3 * body + 1] + fy
                e.external[i, 3 * body + 2] = e.external[i, 3 * body + 2] + torque

    @wp.func
    def tell(e: Events, i: int, k: int, x: VX, u: VU):
        if k < e.told.shape[1]:
            for j in range(2 * nv):
                e.told[i, k, j] = x[j]
            for j in range(nu):
                e.told[i, k, 2 * nv + j] = u[j]
            for j in range(e.external.shape[1]):
                e.told[i, k, 2 * nv + nu + j] = e.external[i, j]

    @wp.func
    def record(
        c: Conditions,
        records: wp.array3d(dtype=wp.float32),
        i: int,
        record: int,
        time: wp.float64,
        h: wp.float64,
        x: VX,
        x0: wp.array2d(dtype=dtype),
    ):
        out = record
        while out < records.shape[1] and time >= wp.float64(out) * c.interval - HALF * h:
            for n in range(c.recorded.shape[0]):  # relative to the start: float32 keeps its digits
                records[i, out, n] = wp.float32(x[c.recorded[n]] - x0[i, c.recorded[n]])
            out += 1
        return out

    return SimpleNamespace(
        seconds=seconds, number=number, due=due, kicked=kicked, acting=acting, push=push, tell=tell,
        record=record,
    )  # fmt: skip
