"""Kernels of robustness sweeps: draw each world's parameters and start, roll it out under a policy with
disturbances.
"""

from types import SimpleNamespace

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from ..specialisation import Specialisation
from ..status import SOLVED
from ..step.rollout import POLICIES, make_world
from ..structure import STEP_SIZE, layout
from .random import make_normal, philox

# streams of the random numbers
START, CHOICE, PARAMETER, TORQUE, KICK = 0, 100, 200, 300, 400
FAR = 1 << 20  # streams of the torques beyond the hundredth, which would meet those of the kicks
TOUCH = 1e-6  # impulse above which a contact counts as one
NOWHERE = 1e30  # lowest gap of a world without an acting contact


@cached
def make_draw_kernel(nx: int, dtype: type) -> wp.Kernel:
    """Parameter tables and initial states of worlds `world0 + i` from a base row and a set of starts."""
    rng = make_normal(dtype)

    @specialised
    def draw_kernel(
        first: int,
        world0: int,
        seed: int,
        base: wp.array(dtype=dtype),  # (P,)
        spread: wp.array(dtype=dtype),  # (P,) standard deviation of the logarithm
        group: wp.array(dtype=wp.int32),  # (P,) columns of one group share their random number
        starts: wp.array2d(dtype=dtype),  # (M, nx)
        deviation: wp.array(dtype=dtype),  # (nx,)
        longest: dtype,  # largest step size [s]
        params: wp.array2d(dtype=dtype),  # out (B, P)
        x0: wp.array2d(dtype=dtype),  # out (B, nx)
    ):
        i = first + wp.tid()
        world = world0 + i
        for c in range(base.shape[0]):
            value = base[c]
            if spread[c] > dtype(0.0):
                value *= wp.exp(spread[c] * rng.normals(seed, world, group[c], PARAMETER)[0])
            if c == STEP_SIZE:
                value = wp.min(value, longest)
            params[i, c] = value
        word = philox(
            wp.uint64(world),
            wp.uint64(0),
            wp.uint64(CHOICE),
            wp.uint64(0),
            wp.uint64(seed) & wp.uint64(0xFFFFFFFF),
            wp.uint64(0),
        )
        pick = int(word[0] % wp.uint64(starts.shape[0]))
        for j in range(wp.static(nx)):
            x0[i, j] = starts[pick, j] + deviation[j] * rng.normals(seed, world, j, START)[0]

    return draw_kernel


@cached
def make_disturbances(nv: int, nu: int, dtype: type) -> SimpleNamespace:
    """Warp functions of what disturbs a world, and of when it is looked at; the same in every sweep."""
    rng = make_normal(dtype)
    VX, VU = wp.types.vector(2 * nv, dtype), wp.types.vector(max(nu, 1), dtype)
    HALF = wp.float64(0.5)

    @wp.func
    def due(times: wp.array(dtype=wp.float64), event: int, time: wp.float64, h: wp.float64):
        """Events up to the step that begins at `time`, from the first one that is still to come."""
        last = event
        while last < times.shape[0] and time >= times[last] - HALF * h:
            last += 1
        return last

    @wp.func
    def kicked(seed: int, world: int, event: int, kick: dtype, x: VX):
        out = x
        for j in range(nv):
            out[nv + j] = x[nv + j] + kick * rng.normals(seed, world, event, KICK + j)[0]
        return out

    @wp.func
    def noisy(seed: int, world: int, k: int, torque: dtype, u: VU):
        out = u
        for j in range(nu):
            stream = wp.where(j < KICK - TORQUE, TORQUE + j, FAR + j)
            out[j] = u[j] + torque * rng.normals(seed, world, k, stream)[0]
        return out

    @wp.func
    def sampled(
        samples: wp.array2d(dtype=wp.float32),
        i: int,
        sample: int,
        interval: wp.float64,
        time: wp.float64,
        h: wp.float64,
        value: wp.float32,
    ):
        """Write the samples up to `time`; the first one that is still to come."""
        out = sample
        while out < samples.shape[1] and time >= wp.float64(out) * interval - HALF * h:
            samples[i, out] = value
            out += 1
        return out

    return SimpleNamespace(due=due, kicked=kicked, noisy=noisy, sampled=sampled)


@cached
def make_sweep_kernel(spec: Specialisation, policy_name: str) -> wp.Kernel:
    """Roll out one world a thread for a duration, with torque noise and velocity kicks; samples one state
    component.
    """
    s, dtype, _ = spec
    world_of = make_world(spec, False)
    step = world_of.step
    policy = POLICIES[policy_name](2 * s.nv, s.nu, dtype)
    disturb = make_disturbances(s.nv, s.nu, dtype)
    NR = s.nr
    H = layout(s).offset("step_size")
    Policy = policy.Struct
    contact_rows = sum(1 << i for i, r in enumerate(s.rows) if r.kind == "contact")

    @specialised
    def sweep_kernel(
        first: int,
        world0: int,
        seed: int,
        params: wp.array2d(dtype=dtype),  # (B, P)
        x0: wp.array2d(dtype=dtype),  # (B, nx)
        control: Policy,
        torque: dtype,  # standard deviation of white torque noise per step
        kick: dtype,  # standard deviation of velocity kicks
        kick_times: wp.array(dtype=wp.float64),  # (K,) [s]
        duration: wp.float64,
        interval: wp.float64,  # sampling interval [s]
        component: int,
        external: wp.array2d(dtype=dtype),
        samples: wp.array2d(dtype=wp.float32),  # out (B, S)
        contact_share: wp.array(dtype=wp.float32),  # out (B,) share of steps with a contact impulse
        lowest: wp.array(dtype=wp.float32),  # out (B,) lowest d/h h of an acting contact
        status: wp.array(dtype=wp.int32),  # out (B,)
    ):
        i = first + wp.tid()
        world = world0 + i
        x = world_of.load_state(x0, i)
        carry = step.cold_carry()
        h = wp.float64(params[i, H])
        steps = int(wp.round(duration / h))
        code = int(0)
        touched = int(0)
        sample = int(0)
        event = int(0)
        low = float(NOWHERE)
        base = x[component]  # samples are relative to the start: float32 keeps its digits
        for k in range(steps):
            time = wp.float64(k) * h
            sample = disturb.sampled(samples, i, sample, interval, time, h, wp.float32(x[component] - base))
            coming = disturb.due(kick_times, event, time, h)
            while event < coming:
                x = disturb.kicked(seed, world, event, kick, x)
                event += 1
            if code == wp.static(SOLVED):
                u = policy.control(control, i, k, x)
                if torque > dtype(0.0):
                    u = disturb.noisy(seed, world, k, torque, u)
                sol = step.solve_step(params, i, x, u, external, i, carry)
                after = step.next_state(params, i, x, sol)
                code = world_of.status_of(sol, after)
                if code == wp.static(SOLVED):
                    x = after
                    carry.z = sol.z
                    carry.normal = sol.normal
                    pushed = int(0)
                    for r in range(wp.static(NR)):
                        if wp.static((contact_rows & (1 << r)) != 0):
                            if (sol.mask & wp.static(1 << r)) != 0:
                                low = wp.min(
                                    low, wp.float32(sol.rate[wp.static(step.gap_row[r])]) * wp.float32(h)
                                )
                                if sol.lam[r] > dtype(TOUCH):
                                    pushed = 1
                    touched += pushed
        while sample < samples.shape[1]:
            samples[i, sample] = wp.float32(x[component] - base)
            sample += 1
        contact_share[i] = wp.float32(touched) / wp.float32(wp.max(steps, 1))
        lowest[i] = low
        status[i] = code

    return sweep_kernel
