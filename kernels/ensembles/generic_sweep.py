"""Sweeps with the generic step kernel: what happens to a world between two of its steps.

`sweep.py` rolls a world out in one launch. Here a step is three: `begin` records, kicks and asks the policy,
the generic kernel steps (`generic/step.py`), `end` takes the step over or the status and takes measures. The
random numbers are those of `sweep.py`, by world and step, so nothing depends on the split.
"""

from types import SimpleNamespace

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from ..policies.contract import PolicyKernel, make_policy
from ..status import SOLVED
from ..structure import STEP_SIZE
from .arrival import Progress, make_arrival
from .disturbances import END, make_conditions, make_disturbances, make_events
from .measures import NO_USERS, Users, make_measures, make_row_contacts, make_tables


@cached
def make_sweep_begin_kernel(
    nv: int, nu: int, dtype: type, policy: PolicyKernel, acts: bool = True
) -> wp.Kernel:
    """Before step k: records, kicks, pushes, and the controls as they act; or as the policy gave them."""
    asked = make_policy(policy, 2 * nv, nu, dtype)
    disturb, arrive = make_disturbances(nv, nu, dtype), make_arrival(nv, nu, dtype).arrive
    Conditions, Events, Policy = make_conditions(dtype), make_events(dtype), asked.Struct

    @specialised
    def sweep_begin_kernel(
        first: int,
        k: int,
        c: Conditions,
        e: Events,
        params: wp.array2d(dtype=dtype),  # (B, P)
        x0: wp.array2d(dtype=dtype),  # (B, nx)
        control: Policy,
        p: Progress,
        state: wp.array2d(dtype=dtype),  # in and out (B, nx)
        us: wp.array2d(dtype=dtype),  # out (B, nu)
        memories: wp.array2d(dtype=dtype),  # in and out (B, memory of the policy)
    ):
        i = first + wp.tid()
        world = disturb.number(c, e, i)
        who = wp.where(wp.static(policy.by_row), i, world)
        if k >= p.steps[i]:
            return
        x = arrive(c, e, params, x0, p, i, k, state)
        h = wp.float64(params[i, STEP_SIZE])
        time = wp.float64(k) * h
        if p.status[i] == wp.static(SOLVED):
            memory = asked.recall(control, memories, i, who, k, x)
            u, memory = asked.ask(control, who, k, x, memory)
            if wp.static(acts):
                u = disturb.acting(c, e, i, world, k, time, h, u)
                if e.push.shape[1] > 0:
                    disturb.push(c, e, i, params[i], x, time, h)
            for j in range(nu):
                us[i, j] = u[j]
            asked.keep(memories, i, memory)

    return sweep_begin_kernel


@cached
def make_sweep_end_kernels(nv: int, nu: int, dtype: type, users: Users = NO_USERS) -> SimpleNamespace:
    """`end`, after step k: the new state or the status, measures. `finish`, after the last step: records."""
    contacts = make_row_contacts(dtype)
    measures = make_measures(2 * nv, nu, dtype, contacts, users)
    Contacts, Measures = contacts.Contacts, make_tables(dtype)
    Conditions, disturb = make_conditions(dtype), make_disturbances(nv, nu, dtype)
    VX, VU = wp.types.vector(2 * nv, dtype), wp.types.vector(max(nu, 1), dtype)

    @specialised
    def sweep_end_kernel(
        first: int,
        k: int,
        params: wp.array2d(dtype=dtype),  # (B, P)
        after: wp.array2d(dtype=dtype),  # (B, nx) of the step
        us: wp.array2d(dtype=dtype),  # (B, nu)
        contacts_of: Contacts,
        code: wp.array(dtype=wp.int32),  # (B,)
        m: Measures,
        p: Progress,
        state: wp.array2d(dtype=dtype),  # out (B, nx)
        warm: wp.array2d(dtype=dtype),  # out (B, nr + 2 pairs)
        kept: wp.array3d(dtype=wp.float64),  # out (B, M, WIDTH)
    ):
        i = first + wp.tid()
        if k >= p.steps[i]:
            return
        h = wp.float64(params[i, STEP_SIZE])
        x = VX()
        for j in range(2 * nv):
            x[j] = state[i, j]
        u = VU()
        c = contacts_of
        c.world = i
        c.on = 0
        if p.status[i] == wp.static(SOLVED):
            p.status[i] = code[i]
            if code[i] == wp.static(SOLVED):
                c.on = 1
                for j in range(nu):
                    u[j] = us[i, j]
                for j in range(2 * nv):
                    state[i, j] = after[i, j]
                for j in range(warm.shape[1]):
                    warm[i, j] = contacts_of.multiplier[i, j]
        measures.look(m, kept, i, wp.float64(k) * h, h, x, u, c, 0)
        if measures.ended(m, kept, i):
            p.steps[i] = k + 1
        if k == p.steps[i] - 1:
            for j in range(2 * nv):
                x[j] = state[i, j]
            measures.look(m, kept, i, wp.float64(k + 1) * h, h, x, u, c, 1)

    @specialised
    def sweep_finish_kernel(
        first: int,
        c: Conditions,
        x0: wp.array2d(dtype=dtype),  # (B, nx)
        state: wp.array2d(dtype=dtype),  # (B, nx)
        p: Progress,
    ):
        i = first + wp.tid()
        x = VX()
        for j in range(2 * nv):
            x[j] = state[i, j]
        end = wp.float64(wp.static(END))
        p.record[i] = disturb.record(c, p.records, i, p.record[i], end, end, x, x0)

    return SimpleNamespace(end=sweep_end_kernel, finish=sweep_finish_kernel)
