"""A robustness sweep in one launch: worlds rolled out under a policy, disturbed and looked at on the way."""

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from ..specialisation import Specialisation
from ..status import SOLVED
from ..step.rollout import POLICIES, make_batch
from ..structure import layout
from .disturbances import NOWHERE, TOUCH, make_conditions, make_disturbances


@cached
def make_sweep_kernel(spec: Specialisation, policy_name: str) -> wp.Kernel:
    """Roll out one world a thread for a duration, with torque noise and velocity kicks.

    One state component is sampled.
    """
    s, dtype, _ = spec
    batch = make_batch(spec, False)
    step = batch.step
    policy = POLICIES[policy_name](2 * s.nv, s.nu, dtype)
    disturb = make_disturbances(s.nv, s.nu, dtype)
    Conditions, Policy = make_conditions(dtype), policy.Struct
    NR = s.nr
    H = layout(s).offset("step_size")
    contact_rows = sum(1 << i for i, r in enumerate(s.rows) if r.kind == "contact")

    @wp.func
    def contact_of(sol: step.Solution, h: wp.float64, lowest: wp.float32):
        """The lowest gap of an acting contact up to this step, and 1 if a contact pushes."""
        low = lowest
        pushed = int(0)
        for r in range(wp.static(NR)):
            if wp.static((contact_rows & (1 << r)) != 0):
                if (sol.mask & wp.static(1 << r)) != 0:
                    low = wp.min(low, wp.float32(sol.rate[wp.static(step.gap_row[r])]) * wp.float32(h))
                    if sol.lam[r] > dtype(TOUCH):
                        pushed = 1
        return low, pushed

    @specialised
    def sweep_kernel(
        first: int,
        c: Conditions,
        params: wp.array2d(dtype=dtype),  # (B, P)
        x0: wp.array2d(dtype=dtype),  # (B, nx)
        control: Policy,
        external: wp.array2d(dtype=dtype),
        samples: wp.array2d(dtype=wp.float32),  # out (B, S)
        contact_share: wp.array(dtype=wp.float32),  # out (B,) share of steps with a contact impulse
        lowest: wp.array(dtype=wp.float32),  # out (B,) lowest d/h h of an acting contact
        status: wp.array(dtype=wp.int32),  # out (B,)
    ):
        i = first + wp.tid()
        number = c.world0 + i
        world = step.types.world_at(params, external, i)
        x = batch.load_state(x0, i)
        carry = step.cold_carry()
        h = wp.float64(world.params[wp.static(H)])
        steps = int(wp.round(c.duration / h))
        code = int(0)
        touched = int(0)
        sample = int(0)
        event = int(0)
        low = float(NOWHERE)
        base = x[c.component]  # samples are relative to the start: float32 keeps its digits
        for k in range(steps):
            time = wp.float64(k) * h
            sample = disturb.sampled(c, samples, i, sample, time, h, wp.float32(x[c.component] - base))
            coming = disturb.due(c, event, time, h)
            while event < coming:
                x = disturb.kicked(c, number, event, x)
                event += 1
            if code == wp.static(SOLVED):
                u = disturb.noisy(c, number, k, policy.control(control, i, k, x))
                sol = step.solve_step(world, x, u, carry)
                after = step.next_state(world, x, sol)
                code = batch.status_of(sol, after)
                if code == wp.static(SOLVED):
                    x = after
                    carry.z = sol.z
                    carry.normal = sol.normal
                    low, pushed = contact_of(sol, h, low)
                    touched += pushed
        while sample < samples.shape[1]:
            samples[i, sample] = wp.float32(x[c.component] - base)
            sample += 1
        contact_share[i] = wp.float32(touched) / wp.float32(wp.max(steps, 1))
        lowest[i] = low
        status[i] = code

    return sweep_kernel
