"""A robustness sweep in one launch with generic kernels: what `sweep.py` does with specialised ones.

Between two steps a world stands in the precision of its arrays, so that it does not matter where a launch
ends and the next one goes on.
"""

import warp as wp

from ..contact.problem import COLD
from ..device.compile import of_any_scene
from ..factories import cached
from ..generic.motion.pulls import make_pulls
from ..generic.topology import Topology
from ..generic.work import ROWS, WORK, Slot, Work, view
from ..policies.contract import PolicyKernel, make_policy
from ..status import NONFINITE, SOLVED
from ..structure import STEP_SIZE
from .arrival import OVERLAP, STOPPED, make_span
from .disturbances import END, make_conditions, make_disturbances, make_events
from .generic_rollout import make_world
from .measures import NO_USERS, Users, make_measures, make_tables
from .pushing import make_listed_pushing


@cached
def make_generic_sweep_kernel(
    given: type, residual: str, nv: int, nu: int, policy: PolicyKernel, users: Users = NO_USERS
) -> wp.Kernel:
    """Roll out one world a thread for a duration, with all that happens to it, as `make_sweep_kernel`; a span
    with room for states says that a launch makes some of the steps.
    """
    one = make_world(given, residual, nv, nu)
    asked = make_policy(policy, 2 * nv, nu, given)
    disturb = make_disturbances(nv, nu, given)
    Conditions, Events, Policy = make_conditions(given), make_events(given), asked.Struct
    Span, Measures = make_span(given), make_tables(given)
    pushing = make_listed_pushing(given, residual, one.step, users)
    contacts, contacts_of = pushing.contacts, pushing.contacts_of
    pulling = make_pulls(given, nv, nu) if users.pulls else None
    measures = make_measures(2 * nv, nu, given, contacts, users)
    VX, VU = wp.types.vector(2 * nv, given), wp.types.vector(max(nu, 1), given)
    ZERO, UNUSED = WORK(0.0), WORK(COLD)

    @wp.func
    def load(x: wp.array2d(dtype=given), i: int):
        out = VX()
        for j in range(2 * nv):
            out[j] = x[i, j]
        return out

    @wp.func
    def overlap(t: wp.ref[Topology], k: wp.ref[Slot]):
        """How deep rows overlap at the start of a step, of those that can act."""
        deepest = ZERO
        if wp.static(residual != "none"):
            for r in range(k.count[wp.static(ROWS)]):
                deepest = wp.max(deepest, -one.step.row_gap(t, k, r))
        return deepest

    @wp.func
    def leave(
        t: wp.ref[Topology], k: wp.ref[Slot], span: Span, i: int, x: VX, code: int, record: int, event: int
    ):
        """What a world's next step takes over in the next launch."""
        span.p.status[i] = code
        span.p.record[i] = record
        span.p.event[i] = event
        for j in range(2 * nv):
            span.state[i, j] = x[j]
        for r in range(t.nr):
            span.warm[i, r] = given(UNUSED)
        if wp.static(residual != "none"):
            for r in range(k.count[wp.static(ROWS)]):
                span.warm[i, k.row[r]] = given(k.z[r])
        for n in range(t.pairs):
            span.warm[i, t.nr + 2 * n] = given(k.normal[n][0])
            span.warm[i, t.nr + 2 * n + 1] = given(k.normal[n][1])

    @of_any_scene(residual != "none")
    def generic_sweep_kernel(
        first: int,
        base: int,
        last: int,
        most: int,  # steps of the launch, where it is one of several: up to `last`, from each world's next on
        next: wp.array(dtype=wp.int32),  # (0 or B,)
        t: Topology,
        work: Work,
        impulse: wp.array2d(dtype=wp.float64),  # (0 or slots, pairs) where contacts or tendons are looked at
        distance: wp.array2d(dtype=wp.float64),
        slips: wp.array2d(dtype=wp.float64),
        rubs: wp.array2d(dtype=wp.float64),
        pulls: wp.array2d(dtype=wp.float64),  # (0 or slots, tendons)
        c: Conditions,
        e: Events,
        params: wp.array2d(dtype=given),  # (B, P)
        x0: wp.array2d(dtype=given),  # (B, nx)
        control: Policy,
        m: Measures,
        span: Span,
        records: wp.array3d(dtype=wp.float32),  # out (B, S, R)
        kept: wp.array3d(dtype=wp.float64),  # out (B, M, WIDTH) of the measures
        noted: wp.array2d(dtype=wp.float64),  # out (B, NOTED)
        status: wp.array(dtype=wp.int32),  # out (B,)
    ):
        # long: a world's run is one loop over named stages, and what it stands in is local to the thread
        b = first + wp.tid()
        i = base + b
        number = disturb.number(c, e, i)
        who = wp.where(wp.static(policy.by_row), i, number)
        x = load(x0, i)
        h = disturb.seconds(c, params[i, STEP_SIZE])
        steps = int(wp.round(c.duration / h))
        code = int(0)
        record = int(0)
        event = int(0)
        touching = contacts.Contacts()
        if impulse.shape[0] > 0:
            touching.impulse = impulse[b]
            touching.distance = distance[b]
            touching.slip = slips[b]
            touching.rub = rubs[b]
            touching.pull = pulls[b]
        u = VU()
        begin = int(0)
        end = steps
        spans = span.state.shape[0] > 0
        k = view(work, b)
        one.step.prepare(t, k, params, i)
        if spans:
            steps = span.p.steps[i]
            begin = next[i]
            end = wp.min(wp.min(begin + most, last), steps)
            if begin >= end:
                return
            code = span.p.status[i]
            record = span.p.record[i]
            event = span.p.event[i]
            x = load(span.state, i)
            one.step.recall(t, k, span.warm, i)
        if wp.static(policy.timed):
            control = asked.of_row(control, e.timing, i, c.step)
        memory = asked.begin(control, who, x)
        if spans:
            memory = asked.recall(control, span.memory, i, who, begin, x)
        for n in range(begin, end):
            time = wp.float64(n) * h
            record = disturb.record(c, records, i, record, time, h, x, x0)
            coming = disturb.due(c, event, time, h)
            while event < coming:
                x = disturb.kicked(e, i, event, x)
                event += 1
            before = x
            touching.on = 0
            if code == wp.static(SOLVED):
                u, memory = asked.ask(control, who, n, x, memory)
                u = disturb.acting(c, e, i, number, n, time, h, u)
                if e.push.shape[1] > 0:
                    disturb.push(c, e, i, params[i], x, time, h)
                disturb.tell(e, i, n, x, u)
                one.put(t, k, x)
                code = one.advance(t, k, e.external, i, u)
                if n == 0 and code != wp.static(NONFINITE):
                    noted[i, wp.static(OVERLAP)] = overlap(t, k)
                if code == wp.static(SOLVED):
                    x = one.state(t, k)
                    if impulse.shape[0] > 0:
                        touching.on = 1
                        contacts_of(t, k, touching, h)
                        if wp.static(pulling is not None):
                            wp.static(pulling)(t, k, touching.pull, before, u, x)
                else:
                    noted[i, wp.static(STOPPED)] = time
            if code != wp.static(SOLVED):
                u = VU()
            measures.look(m, kept, i, time, h, before, u, touching, 0)
            if measures.ended(m, kept, i):
                steps = n + 1
                end = steps
                break
        if spans:
            asked.keep(span.memory, i, memory)
            leave(t, k, span, i, x, code, record, event)
            span.p.steps[i] = steps
            next[i] = end
            if end < steps:
                return
        measures.look(m, kept, i, wp.float64(steps) * h, h, x, u, touching, 1)
        record = disturb.record(c, records, i, record, wp.float64(wp.static(END)), h, x, x0)
        status[i] = code

    return generic_sweep_kernel
