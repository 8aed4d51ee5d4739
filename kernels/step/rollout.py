"""Kernels that step: one step of every world, and whole rollouts under a policy, one launch each.

A thread owns a world. A world whose step is not solved keeps its last valid state to the end and reports the
first status that was not SOLVED.
"""

from types import SimpleNamespace
from typing import NamedTuple

import warp as wp

from ..contact.problem import COLD
from ..device.compile import fitted
from ..factories import cached
from ..policies.contract import PolicyKernel, make_policy
from ..specialisation import Specialisation
from ..status import NONFINITE, SOLVED
from .step import make_step


@cached
def make_batch(spec: Specialisation, exact_gap: int) -> SimpleNamespace:
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
    def carried(warm: wp.array2d(dtype=dtype), i: int):
        """What a world's next step takes over from the launch before."""
        out = step.Carry()
        for r in range(wp.static(NR)):
            out.z[r] = warm[i, r]
        for n in range(wp.static(2 * NP)):
            out.normal[n] = warm[i, wp.static(NR) + n]
        return out

    @wp.func
    def leave(warm: wp.array2d(dtype=dtype), i: int, carry: step.Carry):
        """The same for the next launch."""
        for r in range(wp.static(NR)):
            warm[i, r] = carry.z[r]
        for n in range(wp.static(2 * NP)):
            warm[i, wp.static(NR) + n] = carry.normal[n]

    @wp.func
    def status_of(sol: step.Solution, x: VX):
        if sol.status == wp.static(SOLVED) and not wp.isfinite(x):
            return wp.static(NONFINITE)
        return sol.status

    @wp.func
    def put_step(
        world: t.World,
        index: int,
        before: VX,
        sol: step.Solution,
        after: VX,
        code: int,
        state: wp.array2d(dtype=dtype),
        impulse: wp.array2d(dtype=dtype),
        gap: wp.array2d(dtype=dtype),
        multiplier: wp.array2d(dtype=dtype),
        status: wp.array(dtype=wp.int32),
    ):
        """All outputs of a step of world `index`."""
        solved = code == wp.static(SOLVED)
        for j in range(wp.static(NX)):
            state[index, j] = wp.where(solved, after[j], before[j])
        for i in range(wp.static(NR)):
            impulse[index, i] = wp.where(solved, sol.lam[i], dtype(0.0))
            gap[index, i] = sol.rate[wp.static(step.gap_row[i])] * world.params[0]
            multiplier[index, i] = wp.where(solved, sol.z[i], dtype(wp.static(COLD)))
        for i in range(wp.static(2 * NP)):
            multiplier[index, wp.static(NR + i)] = wp.where(solved, sol.normal[i], dtype(0.0))
        status[index] = code

    @wp.func
    def put_record(
        world: t.World,
        index: int,
        k: int,
        u: VU,
        sol: step.Solution,
        controls: wp.array3d(dtype=dtype),
        impulse: wp.array3d(dtype=dtype),
        gap: wp.array3d(dtype=dtype),
    ):
        """What is recorded of step k of world `index`, where there is room for it."""
        if controls.shape[0] > 0:
            for i in range(wp.static(NU)):
                controls[index, k, i] = u[i]
        if impulse.shape[0] > 0:
            for i in range(wp.static(NR)):
                impulse[index, k, i] = sol.lam[i]
        if gap.shape[0] > 0:
            for i in range(wp.static(NR)):
                gap[index, k, i] = sol.rate[wp.static(step.gap_row[i])] * world.params[0]

    return SimpleNamespace(
        step=step,
        load_state=load_state,
        load_control=load_control,
        warm_carry=warm_carry,
        carried=carried,
        leave=leave,
        status_of=status_of,
        put_step=put_step,
        put_record=put_record,
    )


class Transition(NamedTuple):
    """A step as others roll it out: advance(params, row, x, u, carry) -> (x', carry', status).

    carried(kept, row) -> carry and leave(kept, row, carry) take it from launch to launch, `width` numbers.
    """

    advance: wp.Function
    cold_carry: wp.Function
    carried: wp.Function
    leave: wp.Function
    width: int
    fast: bool


@cached
def make_transition(spec: Specialisation) -> Transition:
    """Of a simulator's step."""
    s, dtype, _ = spec
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

    return Transition(
        advance=advance,
        cold_carry=step.cold_carry,
        carried=batch.carried,
        leave=batch.leave,
        width=s.nr + 2 * len(s.pairs),
        fast=spec.method.fast,
    )


@cached
def make_step_kernel(spec: Specialisation) -> wp.Kernel:
    """One step of every world with all of its outputs (gaps exact)."""
    dtype = spec.dtype
    batch = make_batch(spec, True)
    step = batch.step

    @fitted(False, len(spec.structure.pairs))
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
        batch.put_step(world, index, before, sol, after, code, state, impulse, gap, multiplier, status)

    return step_kernel


@cached
def make_rollout_kernel(spec: Specialisation, policy: PolicyKernel, exact_gap: int) -> wp.Kernel:
    """Roll every world out under a policy; `exact_gap` as in `make_step`."""
    s, dtype, _ = spec
    batch = make_batch(spec, exact_gap)
    step = batch.step
    NX, NU = 2 * s.nv, s.nu
    asked = make_policy(policy, NX, NU, dtype)
    Policy = asked.Struct

    @fitted(False, len(spec.structure.pairs))
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
                    batch.put_record(world, index, k, u, sol, controls, impulse, gap)
            for j in range(wp.static(NX)):
                states[index, k + 1, j] = x[j]
        status[index] = code

    return rollout_kernel
