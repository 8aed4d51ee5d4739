"""Steps and rollouts in launches that hand worlds on (`device/relay.py`): the same kernels for both methods.

With a `fast` method a step that is not solved is left to the other kernel, whatever its status; with a full
one its status is the world's.
"""

import warp as wp

from ..device.compile import fitted
from ..device.relay import Relay, hand_on, taken
from ..factories import cached
from ..policies.contract import PolicyKernel, make_policy
from ..specialisation import Specialisation
from ..status import SOLVED
from .rollout import make_batch


@cached
def make_step_relay(spec: Specialisation) -> wp.Kernel:
    """One step of every world with all of its outputs, as `make_step_kernel`."""
    s, dtype, method = spec
    batch = make_batch(spec, True)
    step = batch.step

    @fitted(method.fast, len(s.pairs))
    def step_relay_kernel(
        first: int,
        slot: int,
        last: int,
        most: int,
        relay: Relay,
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
        index = taken(relay, slot, first + wp.tid())
        if index < 0:
            return
        world = step.types.world_at(params, external, index)
        before = batch.load_state(x, index)
        sol = step.solve_step(world, before, batch.load_control(u, index), batch.warm_carry(warm, index))
        after = step.next_state(world, before, sol)
        code = batch.status_of(sol, after)
        if wp.static(method.fast):
            if code != wp.static(SOLVED):
                hand_on(relay, slot, index)
                return
        batch.put_step(world, index, before, sol, after, code, state, impulse, gap, multiplier, status)

    return step_relay_kernel


@cached
def make_rollout_relay(spec: Specialisation, policy: PolicyKernel, exact_gap: bool) -> wp.Kernel:
    """Roll worlds out under a policy, as `make_rollout_kernel`."""
    s, dtype, method = spec
    batch = make_batch(spec, exact_gap)
    step = batch.step
    NX = 2 * s.nv
    asked = make_policy(policy, NX, s.nu, dtype)
    Policy = asked.Struct

    @fitted(method.fast, len(s.pairs))
    def rollout_relay_kernel(
        first: int,
        slot: int,
        last: int,
        most: int,
        relay: Relay,
        warm: wp.array2d(dtype=dtype),  # (B, nr + 2 pairs) multipliers and normals of the last step
        kept: wp.array2d(dtype=dtype),  # (B, memory of the policy)
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
        # long: a world's run is one loop, and what it stands in is local to the thread
        i = taken(relay, slot, first + wp.tid())
        if i < 0:
            return
        begin = relay.next[i]
        if begin >= last:
            return
        x = batch.load_state(x0, i)
        carry = step.cold_carry()
        if begin == 0:
            for j in range(wp.static(NX)):
                states[i, 0, j] = x[j]
        else:
            for j in range(wp.static(NX)):
                x[j] = states[i, begin, j]
            carry = batch.carried(warm, i)
        memory = asked.recall(control, kept, i, i, begin, x)
        world = step.types.world_at(params, external, i)
        end = wp.min(begin + most, last)
        code = status[i]
        k = int(begin)
        while k < end and code == wp.static(SOLVED):
            u, remembered = asked.ask(control, i, k, x, memory)
            sol = step.solve_step(world, x, u, carry)
            after = step.next_state(world, x, sol)
            code = batch.status_of(sol, after)
            if code == wp.static(SOLVED):
                x = after
                carry.z = sol.z
                carry.normal = sol.normal
                memory = remembered
                batch.put_record(world, i, k, u, sol, controls, impulse, gap)
                k += 1
                for j in range(wp.static(NX)):
                    states[i, k, j] = x[j]
        if wp.static(method.fast):
            if status[i] == wp.static(SOLVED):
                code = wp.static(SOLVED)
        status[i] = code
        if code != wp.static(SOLVED):
            while k < states.shape[1] - 1:
                k += 1
                for j in range(wp.static(NX)):
                    states[i, k, j] = x[j]
        relay.next[i] = k
        if k < states.shape[1] - 1:
            batch.leave(warm, i, carry)
            asked.keep(kept, i, memory)
        if k < last:
            hand_on(relay, slot, i)

    return rollout_relay_kernel
