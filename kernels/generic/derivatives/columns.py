"""Right-hand sides of the implicit function theorem: LANES columns of -F1 and -F2 by (q, v, u) at once."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...mechanism.stiff_springs import SHARE
from ..motion.mechanism import COLUMN, make_mechanism
from ..motion.tendons import make_tendons
from ..topology import CONTACT, Topology, place
from ..work import LANES, WORK, Lanes, Slot
from .bodies import make_bodies
from .gaps import limit_slope
from .pairs import make_pair_slopes
from .rows import make_row_slopes
from .springs import make_spring_slopes
from .system import make_system
from .tables import Groups, Slopes


@cached
def make_columns(given: type, residual: str) -> SimpleNamespace:
    """fill(t, k, g, d, b, n, pairs, first, leaps): d.known and d.given for LANES columns of (q, v, u), from
    `first` on; `leaps`: 1 of a leapfrog's whole step.
    """
    dtype = WORK
    number = make_mechanism(given).number
    TENSION, SLOWING, SHARE_OF = (COLUMN[f"tendon_{n}"] for n in ("stiffness", "damping", "coefficient"))
    bodies, springs, tendons = make_bodies(given), make_spring_slopes(given), make_tendons(given)
    contacts = residual != "none"
    pairs = make_pair_slopes(given, residual) if contacts else None
    rows = make_row_slopes(given, residual) if contacts else None
    system = make_system(given, residual)
    H, MASS, INERTIA, DAMPING, STIFFNESS, GEAR, ARMATURE = (
        COLUMN[n] for n in ("step_size", "mass", "inertia", "damping", "stiffness", "gear", "armature")
    )
    PART, COUNT = dtype(SHARE), LANES

    @wp.func
    def put(x: wp.array(dtype=Lanes), p: int, lane: int, value: dtype):
        x[p][lane] = x[p][lane] + value

    @wp.func
    def of_bodies(
        t: wp.ref[Topology], d: Slopes, k: wp.ref[Slot], b: int, first: int, velocity: int, share: dtype
    ):
        """What bodies make of the columns by q, or by v, of the degrees of freedom from `first` on; `share`:
        of the Coriolis forces, those at v.
        """
        x = d.known[b]
        h = share * number(t, k, H, 0)
        for i in range(t.nb):
            start = t.chain_start[i]
            end = t.chain_start[i + 1]
            if t.chain[end - 1] >= first and t.chain[start] < first + COUNT:
                mass = number(t, k, MASS, i)
                inertia = number(t, k, INERTIA, i)
                for by in range(start, end):
                    lane = t.chain[by] - first
                    if lane >= 0 and lane < COUNT:
                        for at in range(start, end):
                            p = place(t, t.chain[at])
                            if velocity == 1:
                                put(x, p, lane, bodies.by_v(t, d, b, mass, inertia, h, at, by))
                            else:
                                put(x, p, lane, bodies.by_q(t, d, b, i, mass, at, by))

    @wp.func
    def of_springs(
        t: wp.ref[Topology], g: Groups, d: Slopes, k: wp.ref[Slot], b: int, first: int,
        velocity: int,
    ):  # fmt: skip
        x = d.known[b]
        h = number(t, k, H, 0)
        for i in range(t.springs):
            for by in range(g.spring_start[i], g.spring_start[i + 1]):
                lane = g.spring_dof[by] - first
                if lane >= 0 and lane < COUNT:
                    for at in range(g.spring_start[i], g.spring_start[i + 1]):
                        p = place(t, g.spring_dof[at])
                        if velocity == 0:
                            put(x, p, lane, springs.by_q(g, d, b, i, at, by))
                        elif t.implicit_damping == 0:
                            put(x, p, lane, springs.by_v(d, b, i, h, at, by))
                        if t.implicit_stiffness == 1:
                            if velocity == 0:
                                put(x, p, lane, springs.stiff_by_q(g, d, b, i, at, by))
                            else:
                                put(x, p, lane, springs.stiff_by_v(d, b, i, at, by))

    @wp.func
    def of_joints(t: wp.ref[Topology], d: Slopes, k: wp.ref[Slot], b: int, first: int, velocity: int):
        """Joint springs, by v where they are implicit, joint dampers where these are not, armature."""
        x = d.known[b]
        h = number(t, k, H, 0)
        if velocity == 0 or t.implicit_stiffness == 1:
            share = wp.where(velocity == 0, -h, PART * h * h)
            least = wp.where(velocity == 0, dtype(-1e300), dtype(0.0))  # what is positive is met late
            for one in range(t.sprung):
                j = t.sprung_dof[one]
                if j >= first and j < first + COUNT:
                    put(x, place(t, j), j - first, share * wp.max(number(t, k, STIFFNESS, j), least))
        if velocity == 1 and t.implicit_damping == 0:
            for j in range(wp.max(first, 0), wp.min(first + COUNT, t.nv)):
                put(x, place(t, j), j - first, -h * number(t, k, DAMPING, j))
        if velocity == 1:
            for one in range(t.rotors):
                j = t.rotor_dof[one]
                if j >= first and j < first + COUNT:
                    put(x, place(t, j), j - first, number(t, k, ARMATURE, j))

    @wp.func
    def of_tendons(t: wp.ref[Topology], d: Slopes, k: wp.ref[Slot], b: int, first: int, velocity: int):
        """As `of_joints` of tendons, of one with a limit as much as it has by what is asked of it."""
        x = d.known[b]
        h = number(t, k, H, 0)
        for i in range(t.tendons):
            part = tendons.slope(t, k, i)
            if part == dtype(0.0):
                continue
            stiffness = part * number(t, k, TENSION, i)
            weight = -h * stiffness
            if velocity == 1:
                weight = dtype(0.0)
                if t.implicit_stiffness == 1:
                    weight += PART * h * h * wp.max(stiffness, dtype(0.0))
                if t.implicit_damping == 0:
                    weight -= part * h * number(t, k, SLOWING, i)
            for by in range(t.tendon_start[i], t.tendon_start[i + 1]):
                lane = t.tendon_dof[by] - first
                if lane >= 0 and lane < COUNT:
                    share = weight * number(t, k, SHARE_OF, by)
                    for at in range(t.tendon_start[i], t.tendon_start[i + 1]):
                        own = number(t, k, SHARE_OF, at)
                        put(x, place(t, t.tendon_dof[at]), lane, share * own)

    @wp.func
    def of_control(t: wp.ref[Topology], d: Slopes, k: wp.ref[Slot], b: int, i: int, lane: int):
        """What actuator i drives, a degree of freedom or what a tendon pulls."""
        x = d.known[b]
        push = number(t, k, H, 0) * number(t, k, GEAR, i)
        if t.actuator[i] >= 0:
            put(x, place(t, t.actuator[i]), lane, push)
        else:
            tendon = -1 - t.actuator[i]
            push *= tendons.slope(t, k, tendon)
            for at in range(t.tendon_start[tendon], t.tendon_start[tendon + 1]):
                share = number(t, k, SHARE_OF, at)
                put(x, place(t, t.tendon_dof[at]), lane, push * share)

    @wp.func
    def is_within(g: Groups, group: int, first: int):
        """Whether degrees of freedom of a group may be among from `first` on."""
        if group < 0:
            return False
        last = g.group_dof[g.group_start[group + 1] - 1]
        return last >= first and g.group_dof[g.group_start[group]] < first + COUNT

    @wp.func
    def is_moved(t: wp.ref[Topology], g: Groups, i: int, first: int):
        """Whether one of them may move what row i is about."""
        if is_within(g, rows.first_group(t, g, i), first):
            return True
        return is_within(g, rows.second_group(t, g, i), first)

    @wp.func
    def of_pairs(t: wp.ref[Topology], g: Groups, d: Slopes, k: wp.ref[Slot], b: int, count: int, first: int):
        """d(J' lambda)/dq."""
        x = d.known[b]
        for one in range(count):
            pair = d.pair[b, one]
            if not is_moved(t, g, t.pair_row[pair], first):
                continue
            start = t.pair_start[pair]
            end = t.pair_start[pair + 1]
            entry = one * g.most - start
            f = d.force[b, one]
            n = k.normal[pair]
            push = pairs.force(n, f[0], f[1])
            for by in range(start, end):
                dof = t.pair_dof[by]
                lane = dof - first
                if lane >= 0 and lane < COUNT:
                    o = d.of_contact[b, entry + by]
                    for at in range(start, end):
                        j = t.pair_dof[at]
                        e = d.of_contact[b, entry + at]
                        value = pairs.entry(e, o, push, f[0], f[1], wp.where(j <= dof, 1, 0))
                        put(x, place(t, j), lane, value)

    @wp.func
    def of_scale(
        t: wp.ref[Topology],
        g: Groups,
        d: Slopes,
        k: wp.ref[Slot],
        b: int,
        r: int,
        group: int,
        start: int,
        first: int,
    ):
        """J_i' times what D_i's change makes of lambda_i at fixed z."""
        begin = g.group_start[group]
        end = g.group_start[group + 1]
        if g.group_dof[end - 1] < first or g.group_dof[begin] >= first + COUNT:
            return
        change = Lanes()
        s = d.row[b, r]
        share = -k.lam[s] / k.scale[s]
        for at in range(begin, end):
            lane = g.group_dof[at] - first
            if lane >= 0 and lane < COUNT:
                change[lane] = share * d.scale_by_q[b, start + at - begin]
        system.add(t, k, s, d.known[b], change)

    @wp.func
    def of_rows(
        t: wp.ref[Topology], g: Groups, d: Slopes, k: wp.ref[Slot], b: int, n: int,
        first: int,
    ):  # fmt: skip
        h = number(t, k, H, 0)
        for r in range(n):
            i = k.row[d.row[b, r]]
            if not is_moved(t, g, i, first):
                d.given[b, r] = Lanes()
                continue
            out = Lanes()
            if t.row_kind[i] == CONTACT:
                pair = t.row_index[i]
                start = t.pair_start[pair]
                for at in range(start, t.pair_start[pair + 1]):
                    lane = t.pair_dof[at] - first
                    if lane >= 0 and lane < COUNT:
                        out[lane] = -d.gap_by_q[b, r * g.most + at - start]
            else:
                lane = t.row_index[i] - first
                if lane >= 0 and lane < COUNT:
                    out[lane] = -limit_slope(t, k, i) / h
            d.given[b, r] = out
            if t.inertia_scaling == 1:
                low = rows.first_group(t, g, i)
                high = rows.second_group(t, g, i)
                begin = r * g.width
                if low >= 0:
                    of_scale(t, g, d, k, b, r, low, begin, first)
                    begin += g.group_start[low + 1] - g.group_start[low]
                if high >= 0:
                    of_scale(t, g, d, k, b, r, high, begin, first)

    @wp.func
    def of_bounces(t: wp.ref[Topology], d: Slopes, k: wp.ref[Slot], b: int, n: int, first: int):
        """What rows that bounce, J_i v' + e J_n v, make of the columns by v from `first` on."""
        for r in range(n):
            s = d.row[b, r]
            i = k.row[s]
            if t.row_kind[i] != CONTACT:
                continue
            pair = t.row_index[i]
            e = k.bounce[pair]
            if not (e > dtype(0.0)):
                continue
            start = t.pair_row[pair]
            rows = t.pair_row[pair + 1] - start
            top = s - (i - start)
            out = d.given[b, r]
            for at in range(t.pair_start[pair], t.pair_start[pair + 1]):
                lane = t.pair_dof[at] - first
                if lane >= 0 and lane < COUNT:
                    part = t.dof_part[t.pair_dof[at]]
                    along = dtype(0.0)  # J_n
                    for m in range(rows):
                        along += k.jac[k.entry[top + m] + t.pair_entry[at]][part] / dtype(rows)
                    out[lane] = out[lane] - e * along
            d.given[b, r] = out

    @wp.func
    def fill(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, b: int, n: int,
        count: int, first: int, leaps: int,
    ):  # fmt: skip
        share = wp.where(leaps == 1, dtype(0.5), dtype(1.0))
        for i in range(3 * t.blocks):
            d.known[b, i] = Lanes()
        for part in range(2):
            start = first - part * t.nv
            if start < t.nv and start + COUNT > 0:
                of_bodies(t, d, k, b, start, part, share)
                of_springs(t, g, d, k, b, start, part)
                of_joints(t, d, k, b, start, part)
                of_tendons(t, d, k, b, start, part)
        if first + COUNT > 2 * t.nv:
            for i in range(t.nu):
                lane = 2 * t.nv + i - first
                if lane >= 0 and lane < COUNT:
                    of_control(t, d, k, b, i, lane)
        if leaps == 1:
            bodies.coriolis(t, k, d, b, first / COUNT)
        if wp.static(contacts):
            if first < t.nv:
                of_pairs(t, g, d, k, b, count, first)
                of_rows(t, g, d, k, b, n, first)
            else:
                for r in range(n):
                    d.given[b, r] = Lanes()
            if t.bounces == 1 and first + COUNT > t.nv and first < 2 * t.nv:
                of_bounces(t, d, k, b, n, first - t.nv)

    return SimpleNamespace(fill=fill)
