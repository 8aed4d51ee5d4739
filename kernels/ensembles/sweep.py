"""A robustness sweep in one launch: worlds rolled out under a policy, disturbed and looked at on the way."""

import warp as wp

from ..device.compile import fitted
from ..device.relay import Relay, hand_on, taken
from ..factories import cached
from ..policies.contract import PolicyKernel, make_policy
from ..specialisation import Specialisation
from ..status import NONFINITE, SOLVED
from ..step.pulls import make_pulls
from ..step.reach import AFTER
from ..step.rollout import make_batch
from ..structure import layout
from .arrival import OVERLAP, STOPPED, make_span
from .disturbances import END, make_conditions, make_disturbances, make_events
from .measures import NO_USERS, Users, make_measures, make_tables
from .pushing import make_pushing


@cached
def make_sweep_kernel(
    spec: Specialisation, policy: PolicyKernel, users: Users = NO_USERS, spans: bool = False
) -> wp.Kernel:
    """Roll out one world a thread for a duration, with all that happens to it.

    States are recorded where that is asked for; measures are taken, those of users' functions with `users`,
    and end a world where one of them says so. With `spans` a launch makes some of the steps, from
    `relay.next` on and before `last`, and worlds carry over what the next one needs; with a `fast` method,
    too, a step that is not solved is left to the other kernel (`device/relay.py`), and nothing is told of
    what steps begin from.
    """
    s, dtype, method = spec
    batch = make_batch(spec, AFTER if users.gaps else False)
    step = batch.step
    asked = make_policy(policy, 2 * s.nv, s.nu, dtype)
    disturb = make_disturbances(s.nv, s.nu, dtype)
    Conditions, Events, Policy = make_conditions(dtype), make_events(dtype), asked.Struct
    Span, Measures = make_span(dtype), make_tables(dtype)
    NX, NR = 2 * s.nv, s.nr
    H = layout(s).offset("step_size")
    pushing = make_pushing(spec, step, users)
    contacts, contacts_of = pushing.contacts, pushing.contacts_of
    pulls = make_pulls(s, dtype) if users.pulls else None
    measures = make_measures(NX, s.nu, dtype, contacts, users)
    VU = wp.types.vector(max(s.nu, 1), dtype)

    @wp.func
    def overlap(sol: step.Solution, h: wp.float64):
        """How deep rows overlap at the start of a step, of those that can act."""
        deepest = wp.float64(0.0)
        for r in range(wp.static(NR)):
            deepest = wp.max(deepest, -wp.float64(sol.rate[r]) * h)
        return deepest

    @wp.func
    def leave(span: Span, i: int, x: step.types.VX, carry: step.Carry, code: int, record: int, event: int):
        """What the next launch takes over."""
        span.p.status[i] = code
        span.p.record[i] = record
        span.p.event[i] = event
        for j in range(wp.static(NX)):
            span.state[i, j] = x[j]
        batch.leave(span.warm, i, carry)

    @fitted(method.fast, len(s.pairs))
    def sweep_kernel(
        first: int,
        slot: int,
        last: int,
        most: int,  # steps
        relay: Relay,
        c: Conditions,
        e: Events,
        params: wp.array2d(dtype=dtype),  # (B, P)
        x0: wp.array2d(dtype=dtype),  # (B, nx)
        control: Policy,
        m: Measures,
        span: Span,
        records: wp.array3d(dtype=wp.float32),  # out (B, S, R)
        kept: wp.array3d(dtype=wp.float64),  # out (B, M, WIDTH) of the measures
        noted: wp.array2d(dtype=wp.float64),  # out (B, NOTED)
        status: wp.array(dtype=wp.int32),  # out (B,)
    ):
        # long: a world's run is one loop over named stages, and what it stands in is local to the thread
        i = first + wp.tid()
        if wp.static(spans):
            i = taken(relay, slot, i)
            if i < 0:
                return
        number = disturb.number(c, e, i)
        who = wp.where(wp.static(policy.by_row), i, number)
        world = step.types.world_at(params, e.external, i)
        x = batch.load_state(x0, i)
        carry = step.cold_carry()
        h = disturb.seconds(c, world.params[wp.static(H)])
        steps = int(wp.round(c.duration / h))
        code = int(0)
        record = int(0)
        event = int(0)
        touching = contacts.none()
        u = VU()
        begin = int(0)
        end = steps
        if wp.static(spans):
            steps = span.p.steps[i]
            begin = relay.next[i]
            end = wp.min(wp.min(begin + most, last), steps)
            if begin >= end:
                return
            code = span.p.status[i]
            record = span.p.record[i]
            event = span.p.event[i]
            x = batch.load_state(span.state, i)
            carry = batch.carried(span.warm, i)
        if wp.static(policy.timed):
            control = asked.of_row(control, e.timing, i, c.step)
        memory = asked.begin(control, who, x)
        if wp.static(spans):
            memory = asked.recall(control, span.memory, i, who, begin, x)
        for k in range(begin, end):
            time = wp.float64(k) * h
            record = disturb.record(c, records, i, record, time, h, x, x0)
            coming = disturb.due(c, event, time, h)
            while event < coming:
                x = disturb.kicked(e, i, event, x)
                event += 1
            before = x
            touching = contacts.none()
            if code == wp.static(SOLVED):
                kept_memory = memory
                u, memory = asked.ask(control, who, k, x, memory)
                u = disturb.acting(c, e, i, number, k, time, h, u)
                if e.push.shape[1] > 0:
                    disturb.push(c, e, i, world.params, x, time, h)
                if wp.static(not method.fast):
                    disturb.tell(e, i, k, x, u)
                sol = step.solve_step(world, x, u, carry)
                after = step.next_state(world, x, sol)
                code = batch.status_of(sol, after)
                if wp.static(method.fast):
                    if code != wp.static(SOLVED):
                        code = wp.static(SOLVED)
                        memory = kept_memory
                        end = k
                        break
                if k == 0 and code != wp.static(NONFINITE):
                    noted[i, wp.static(OVERLAP)] = overlap(sol, h)
                if code == wp.static(SOLVED):
                    x = after
                    carry.z = sol.z
                    carry.normal = sol.normal
                    touching = contacts_of(world, before, sol, h)
                    if wp.static(pulls is not None):
                        touching.pull = wp.static(pulls)(world, before, u, x)
                else:
                    noted[i, wp.static(STOPPED)] = time
            if code != wp.static(SOLVED):
                u = VU()
            measures.look(m, kept, i, time, h, before, u, touching, 0)
            if measures.ended(m, kept, i):
                steps = k + 1
                end = steps
                break
        if wp.static(spans):
            asked.keep(span.memory, i, memory)
            leave(span, i, x, carry, code, record, event)
            span.p.steps[i] = steps
            relay.next[i] = end
            if end < steps:
                if end < last and relay.queue.shape[0] > 0:  # without a queue nobody waits
                    hand_on(relay, slot, i)
                return
        measures.look(m, kept, i, wp.float64(steps) * h, h, x, u, touching, 1)
        record = disturb.record(c, records, i, record, wp.float64(wp.static(END)), h, x, x0)
        status[i] = code

    return sweep_kernel
