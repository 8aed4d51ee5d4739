"""Kernels that step: one step of every world, and whole rollouts under a policy, one launch each.

A thread owns a world. A world whose step is not solved keeps its last valid state to the end and reports the
first status that was not SOLVED.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import COLD
from ..device.compile import specialised
from ..factories import cached
from ..policies.contract import PolicyKernel, make_policy
from ..specialisation import Specialisation
from ..status import NONFINITE, SOLVED
from .step import make_step


@cached
def make_batch(spec: Specialisation, exact_gap: bool) -> SimpleNamespace:
    """Warp functions that read and write one world's rows of the batch arrays."""
    s, dtype, _ = spec
    step = make_step(spec, exact_gap)
    t = step.types
    NX, NU, NR, NP = 2 * s.nv, s.nu, s.nr, len(s.pairs)
    VX, VU = t.VX, t.VU

    @wp.func
    def load_state(x: wp.array2d(dtype=dtype), index: int):
        out = VX()
        for j in range(wp.static(NX)):
            out[j] = x[index, j]
        return out

    @wp.func
    def load_control(u: wp.array2d(dtype=dtype), index: int):
        out = VU()
        for j in range(wp.static(NU)):
            out[j] = u[index, j]
        return out

    @wp.func
    def warm_carry(multiplier: wp.array2d(dtype=dtype), index: int):
        """Carry from the last step's multipliers (B, nr + 2 pairs); cold where there are none."""
        out = step.cold_carry()
        if multiplier.shape[0] > 0:
            for i in range(wp.static(NR)):
                out.z[i] = multiplier[index, i]
            for k in range(wp.static(NP)):
                x = multiplier[index, wp.static(NR + 2 * k)]
                y = multiplier[index, wp.static(NR + 2 * k + 1)]
                norm = wp.sqrt(x * x + y * y)
                if norm > dtype(0.0):
                    out.normal[wp.static(2 * k)] = x / norm
                    out.normal[wp.static(2 * k + 1)] = y / norm
        return out

    @wp.func
    def status_of(sol: step.Solution, x: VX):
        if sol.status == wp.static(SOLVED) and not wp.isfinite(x):
            return wp.static(NONFINITE)
        return sol.status

    return SimpleNamespace(
        step=step,
        load_state=load_state,
        load_control=load_control,
        warm_carry=warm_carry,
        status_of=status_of,
    )


@cached
def make_transition(spec: Specialisation) -> SimpleNamespace:
    """The step as others roll it out: advance(params, row, x, u, carry) -> (x', carry', status)."""
    dtype = spec.dtype
    batch = make_batch(spec, False)
    step = batch.step
    t = step.types

    @wp.func
    def advance(params: wp.array2d(dtype=dtype), row: int, x: t.VX, u: t.VU, carry: step.Carry):
        world = t.World()
        world.params = params[row]
        sol = step.solve_step(world, x, u, carry)
        after = step.next_state(world, x, sol)
        out = step.Carry()
        out.z = sol.z
        out.normal = sol.normal
        return after, out, batch.status_of(sol, after)

    return SimpleNamespace(advance=advance, cold_carry=step.cold_carry)


@cached
def make_step_kernel(spec: Specialisation) -> wp.Kernel:
    """One step of every world with all of its outputs (gaps exact)."""
    s, dtype, _ = spec
    batch = make_batch(spec, True)
    step = batch.step
    NX, NR, NP = 2 * s.nv, s.nr, len(s.pairs)

    @specialised
    def step_kernel(
        first: int,
        params: wp.array2d(dtype=dtype),
        x: wp.array2d(dtype=dtype),  # (B, nx)
        u: wp.array2d(dtype=dtype),  # (B, nu)
        external: wp.array2d(dtype=dtype),  # (0 or B, 3 nb)
        warm: wp.array2d(dtype=dtype),  # (0 or B, nr + 2 pairs)
        state: wp.array2d(dtype=dtype),  # out (B, nx)
        impulse: wp.array2d(dtype=dtype),  # out (B, nr)
        gap: wp.array2d(dtype=dtype),  # out (B, nr)
        multiplier: wp.array2d(dtype=dtype),  # out (B, nr + 2 pairs)
        status: wp.array(dtype=wp.int32),  # out (B,)
    ):
        index = first + wp.tid()
        world = step.types.world_at(params, external, index)
        before = batch.load_state(x, index)
        carry = batch.warm_carry(warm, index)
        sol = step.solve_step(world, before, batch.load_control(u, index), carry)
        after = step.next_state(world, before, sol)
        code = batch.status_of(sol, after)
        if code != wp.static(SOLVED):
            after = before
        for j in range(wp.static(NX)):
            state[index, j] = after[j]
        for i in range(wp.static(NR)):
            impulse[index, i] = wp.where(code == wp.static(SOLVED), sol.lam[i], dtype(0.0))
            gap[index, i] = sol.rate[wp.static(step.gap_row[i])] * world.params[0]
            multiplier[index, i] = wp.where(code == wp.static(SOLVED), sol.z[i], dtype(wp.static(COLD)))
        for i in range(wp.static(2 * NP)):
            multiplier[index, wp.static(NR + i)] = wp.where(
                code == wp.static(SOLVED), sol.normal[i], dtype(0.0)
            )
        status[index] = code

    return step_kernel


@cached
def make_rollout_kernel(spec: Specialisation, policy: PolicyKernel, exact_gap: bool) -> wp.Kernel:
    """Roll every world out under a policy; `exact_gap` as in `make_step`."""
    s, dtype, _ = spec
    batch = make_batch(spec, exact_gap)
    step = batch.step
    NX, NU, NR = 2 * s.nv, s.nu, s.nr
    asked = make_policy(policy, NX, NU, dtype)
    Policy = asked.Struct

    @specialised
    def rollout_kernel(
        first: int,
        params: wp.array2d(dtype=dtype),
        x0: wp.array2d(dtype=dtype),  # (B, nx)
        control: Policy,
        external: wp.array2d(dtype=dtype),  # (0 or B, 3 nb), constant over the rollout
        states: wp.array3d(dtype=dtype),  # out (B, N+1, nx)
        controls: wp.array3d(dtype=dtype),  # out (0 or B, N, nu)
        impulse: wp.array3d(dtype=dtype),  # out (0 or B, N, nr)
        gap: wp.array3d(dtype=dtype),  # out (0 or B, N, nr)
        status: wp.array(dtype=wp.int32),  # in and out (B,): a world that comes in unsolved stays where it is
    ):
        index = first + wp.tid()
        world = step.types.world_at(params, external, index)
        x = batch.load_state(x0, index)
        carry = step.cold_carry()
        memory = asked.begin(control, index, x)
        code = status[index]
        for j in range(wp.static(NX)):
            states[index, 0, j] = x[j]
        for k in range(states.shape[1] - 1):
            if code == wp.static(SOLVED):
                u, memory = asked.ask(control, index, k, x, memory)
                sol = step.solve_step(world, x, u, carry)
                after = step.next_state(world, x, sol)
                code = batch.status_of(sol, after)
                if code == wp.static(SOLVED):
                    x = after
                    carry.z = sol.z
                    carry.normal = sol.normal
                    if controls.shape[0] > 0:
                        for i in range(wp.static(NU)):
                            controls[index, k, i] = u[i]
                    if impulse.shape[0] > 0:
                        for i in range(wp.static(NR)):
                            impulse[index, k, i] = sol.lam[i]
                    if gap.shape[0] > 0:
                        for i in range(wp.static(NR)):
                            gap[index, k, i] = sol.rate[wp.static(step.gap_row[i])] * world.params[0]
            for j in range(wp.static(NX)):
                states[index, k + 1, j] = x[j]
        status[index] = code

    return rollout_kernel
