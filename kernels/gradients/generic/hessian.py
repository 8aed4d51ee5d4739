"""Second derivatives of a weighted sum of the state after a step, by the state and controls before it.

With L = P.F1 + rho.F2 at the weights' P and rho (M31) and y = (v', z), d2(weights.x')/ds2 of s = (q, v, u)
is [1; Y]' L'' [1; Y], Y = dy/ds (M55): what solved equations say of a function of their solution. L is linear
in v', u and impulses, quadratic in v: of L'' the part by q takes differences (of the slopes by q, v and y at
fixed y, without another solution), the part by v exact ones, and by z it is diagonal, s''(z) row by row.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.contact import make_contact
from ...generic.derivatives.rows import make_row_slopes
from ...generic.derivatives.system import make_system
from ...generic.derivatives.tables import Groups, Slopes
from ...generic.linear.envelope import make_envelope
from ...generic.motion.mechanism import COLUMN, make_mechanism
from ...generic.motion.whole import make_whole
from ...generic.step import make_step
from ...generic.topology import CONTACT, TURN, Topology, place
from ...generic.work import LANES, ROWS, SETTLED, WORK, Slot
from ...residual.smoothing import make_smoothing
from ...structure import WORLD
from .coriolis import make_coriolis
from .curves import Curves
from .room import OLD, Room, View
from .spans import make_spans
from .step import make_step_adjoint
from .tendons import make_clamped

STEP = 2.0**-21  # of a radian or of a length of the scene, times the root of how many of these q is
PART = 1e-3  # of a spring's length now, rounded at zero: no step is longer
LEAST = 1e-30  # of D, as of a step's


@cached
def make_hessian(given: type, residual: str) -> SimpleNamespace:
    """keep(t, k, g, d, e, b, n, first): LANES columns of the first-order expansion, from `first` on.
    hessian(t, k, g, room, w, e, b, n, external, world, leaps): e.found by w.weight of the state after the
    step whose n acting rows have their factor in room.factor, 1 if it holds; the step's q and v are in w. Of
    a leapfrog's whole step without what bends its prediction, and the slopes by that in w.by_lead.
    """
    contacts, hard = residual != "none", residual == "hard"
    step, adjoint = make_step(given, residual), make_step_adjoint(given, residual, False)
    contact = make_contact(given, residual) if contacts else None
    rows_of = make_row_slopes(given, residual) if contacts else None
    system = make_system(given, residual) if contacts else None
    bend = None if hard or not contacts else make_smoothing(WORK, residual).bend
    dual, env, coriolis = adjoint.dual, make_envelope(), make_coriolis(given, residual)
    number, clamped, whole = make_mechanism(given).number, make_clamped(given), make_whole(given)
    spans, LONG = make_spans(given, False), WORK(PART / STEP)
    RADIUS, OFFSET, LENGTH = (COLUMN[name] for name in ("radius", "shape_offset", "spring_length"))
    ZERO, ONE, TWO, HALF = WORK(0.0), WORK(1.0), WORK(2.0), WORK(0.5)

    @wp.func
    def lose_scale(t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, e: Curves, b: int, n: int):
        """Of hard rows lambda is what it is, whatever D: off dz what D's change makes of it."""
        for n_th in range(wp.min(n, e.strength.shape[1])):
            s = d.row[b, n_th]
            begin = n_th * g.width
            for side in range(2):
                group = rows_of.first_group(t, g, k.row[s])
                if side == 1:
                    group = rows_of.second_group(t, g, k.row[s])
                if group >= 0:
                    for at in range(g.group_start[group], g.group_start[group + 1]):
                        j = g.group_dof[at]
                        e.root[b, n_th, j] = e.root[b, n_th, j] - k.lam[s] * d.scale_by_q[b, begin]
                        begin += 1

    @wp.func
    def keep(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, e: Curves, b: int, n: int, first: int
    ):
        width = 2 * t.nv + t.nu
        if wp.static(contacts):
            system.follow(t, k, d, b, n)
        for lane in range(LANES):
            if first + lane < width:
                for j in range(t.nv):
                    value = d.found[b, place(t, j)]
                    e.move[b, j, first + lane] = value[lane]
                for n_th in range(wp.min(n, e.strength.shape[1])):
                    value = d.root[b, n_th]
                    e.root[b, n_th, first + lane] = value[lane]
        if first + LANES >= width:
            if wp.static(hard):
                if t.inertia_scaling == 1:
                    lose_scale(t, k, g, d, e, b, n)

    @wp.func
    def follow(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, room: wp.ref[Room], b: int, n: int, group: int
    ):
        """Of the acting rows those that a group moves act, -1: all; the others' numbers are negative."""
        for n_th in range(n):
            r = room.factor.row[b, n_th]
            number = wp.abs(k.acting[r])
            moved = group < 0
            if not moved:
                moved = rows_of.first_group(t, g, k.row[r]) == group
            if not moved:
                moved = rows_of.second_group(t, g, k.row[r]) == group
            k.acting[r] = wp.where(moved, number, -number)

    @wp.func
    def refill(t: wp.ref[Topology], k: wp.ref[Slot]):
        """d/h and J of the rows that follow; which pairs bounce stays, and which overlaps do."""
        k.count[wp.static(SETTLED)] = 1
        r = int(0)
        while r < k.count[wp.static(ROWS)]:
            start = r + 0
            i = k.row[r]
            r += 1
            bounce = ZERO
            if t.row_kind[i] == wp.static(CONTACT):
                pair = t.row_index[i]
                r = start + t.pair_row[pair + 1] - t.pair_row[pair]
                if t.bounces == 1:
                    bounce = k.bounce[pair]
            acts = int(0)
            for one in range(start, r):
                acts = wp.max(acts, k.acting[one])
            if acts > 0:
                contact.fill(t, k, start, r, ONE)
                if t.bounces == 1 and t.row_kind[i] == wp.static(CONTACT):
                    k.bounce[t.row_index[i]] = bounce
        k.count[wp.static(SETTLED)] = 0

    @wp.func
    def rescale(t: wp.ref[Topology], k: wp.ref[Slot], room: wp.ref[Room], e: Curves, b: int, n: int):
        """D and lambda of smoothed rows at this configuration and fixed z."""
        for i in range(k.mass.shape[0]):
            k.mass_factor[i] = k.mass[i]
        env.factor(k.mass_factor, t.mass_first, t.mass_at, 0, t.blocks)
        whole.exchange(t, k)
        for n_th in range(n):
            r = room.factor.row[b, n_th]
            if k.acting[r] > 0:
                dual.response(t, k, r)
                k.scale[r] = wp.max(dual.along(t, k, k.move, r), WORK(LEAST))
                k.lam[r] = e.strength[b, n_th] / k.scale[r]
        whole.exchange(t, k)

    @wp.func(inline=False)
    def configure(
        t: wp.ref[Topology], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View], e: Curves, b: int, n: int,
        external: wp.array2d(dtype=given), world: int,
    ):  # fmt: skip
        """All that hangs on the configuration w.q: bodies, M, forces and the rows, whose pairs stay."""
        for j in range(t.nv):
            k.q[j] = w.q[j]
            k.v0[j] = w.rates[wp.static(OLD) * t.nv + j]
        step.begin(t, k, external, world)
        if wp.static(contacts and not hard):  # what tendons themselves do is linear in w.q
            if t.limited > 0:
                whole.keep(t, k)
        if wp.static(contacts):
            contact.move_shapes(t, k)
            refill(t, k)
            if wp.static(not hard):
                if t.inertia_scaling == 1:
                    rescale(t, k, room, e, b, n)

    @wp.func
    def gather(
        t: wp.ref[Topology], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View], e: Curves, b: int, n: int,
        sign: WORK, leaps: int,
    ):  # fmt: skip
        """Slopes of L by q, v, v' and z, with a sign, to those that are there."""
        for j in range(t.nv):
            e.by_state[b, j] = e.by_state[b, j] + sign * w.by_q[j]
            e.by_state[b, t.nv + j] = e.by_state[b, t.nv + j] + sign * w.by_v[j]
        dual.momenta(t, k, w.p)
        for n_th in range(n):
            r = room.factor.row[b, n_th]
            if k.acting[r] > 0:
                dual.push(t, k, w, k.balance, r, w.rho[r])
                pushed = k.p[r] / k.scale[r] * dual.along(t, k, w.p, r)
                e.by_root[b, n_th] = e.by_root[b, n_th] + sign * pushed
        for j in range(t.nv):
            e.by_move[b, j] = e.by_move[b, j] - sign * k.balance[t.dof_block[j]][t.dof_part[j]]
        if leaps == 1:
            for j in range(t.nv):
                e.by_lead[b, j] = e.by_lead[b, j] + sign * w.by_lead[j]

    @wp.func
    def cross(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        room: wp.ref[Room],
        e: Curves,
        b: int,
        n: int,
        c: int,
        leaps: int,
    ):
        """What v' and z, which follow all of s, make of the differences by coordinate c."""
        width = 2 * t.nv + t.nu
        for i in range(width):
            e.cross[b, i] = ZERO
        for j in range(t.nv):
            by = e.by_move[b, j]
            if by != ZERO:
                for i in range(width):
                    e.cross[b, i] = e.cross[b, i] + by * e.move[b, j, i]
        if leaps == 1:
            for j in range(t.nv):
                for i in range(width):
                    e.cross[b, i] = e.cross[b, i] + e.by_lead[b, j] * coriolis.ahead(t, room, b, j, i)
        for n_th in range(n):
            by = e.by_root[b, n_th]
            if by != ZERO:
                for i in range(width):
                    e.cross[b, i] = e.cross[b, i] + by * e.root[b, n_th, i]
        for i in range(width):
            e.found[b, i, c] = e.found[b, i, c] + e.cross[b, i]
            e.found[b, c, i] = e.found[b, c, i] + e.cross[b, i]

    @wp.func
    def kinked(k: wp.ref[Slot], room: wp.ref[Room], e: Curves, b: int, n: int):
        """Whether a row that follows is at the end of a side: there A and B are a mean of both sides."""
        found = int(0)
        for n_th in range(n):
            if k.acting[room.factor.row[b, n_th]] > 0:
                found = wp.max(found, e.edge[b, n_th])
        return found

    @wp.func(inline=False)
    def of_configuration(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, room: wp.ref[Room], w: wp.ref[View], e: Curves,
        b: int, n: int, c: int, length: wp.vec2d, external: wp.array2d(dtype=given), world: int, leaps: int,
    ):  # fmt: skip
        """What moves with coordinate c, in a scene of such a length and share of a radian."""
        for j in range(2 * t.nv):
            e.by_state[b, j] = ZERO
        for j in range(t.nv):
            e.by_move[b, j] = ZERO
            e.by_lead[b, j] = ZERO
        for n_th in range(n):
            e.by_root[b, n_th] = ZERO
        if wp.static(contacts):
            follow(t, k, g, room, b, n, g.dof_group[c])
        q = w.q[c] + ZERO
        unit = wp.where(t.dof_kind[c] == wp.static(TURN), length[1], length[0])
        far = (q + WORK(STEP) * unit * wp.sqrt(wp.max(ONE, wp.abs(q) / unit))) - q  # what q can be moved by
        points = int(2)
        if kinked(k, room, e, b, n) == 1:  # the mean of the slopes' own slopes to both sides
            points = int(4)
        for point in range(points):
            side = wp.where(point % 2 == 0, far, -far)
            weight = wp.where(point == 0, ONE, -ONE) / (TWO * far)
            if points == 4:
                side = side * wp.where(point < 2, ONE, TWO)
                weight = wp.where(point == 1 or point == 2, ONE, -ONE) / (TWO * far)
            w.q[c] = q + side
            configure(t, k, room, w, e, b, n, external, world)
            adjoint.slopes(t, g, k, room, w, external, world, leaps)
            gather(t, k, room, w, e, b, n, weight, leaps)
        w.q[c] = q
        for j in range(t.nv):
            half = HALF * e.by_state[b, j]
            e.found[b, j, c] = e.found[b, j, c] + half
            e.found[b, c, j] = e.found[b, c, j] + half
            other = e.by_state[b, t.nv + j]
            e.found[b, t.nv + j, c] = e.found[b, t.nv + j, c] + other
            e.found[b, c, t.nv + j] = e.found[b, c, t.nv + j] + other
        cross(t, k, room, e, b, n, c, leaps)

    @wp.func
    def length_of(t: wp.ref[Topology], k: wp.ref[Slot]):
        """A length of a scene: how far its largest shape on a body reaches, or its longest spring; 1 where it
        has neither. Where a spring is short now it is less, and so is the share of a radian beside it: steps
        are no more than a thousandth of its length.
        """
        out = ZERO + ZERO
        for i in range(t.shapes):
            if t.shape_body[i] != WORLD:
                reach = wp.length(wp.vec2d(number(t, k, OFFSET, 2 * i), number(t, k, OFFSET, 2 * i + 1)))
                reach += wp.max(number(t, k, RADIUS, 2 * i), number(t, k, RADIUS, 2 * i + 1))
                out = wp.max(out, reach)
        if out == ZERO:
            for i in range(t.springs):
                out = wp.max(out, number(t, k, LENGTH, i))
        reach = wp.where(out > ZERO, out, ONE)
        out = reach + ZERO
        for i in range(t.springs):
            out = wp.min(out, LONG / wp.sqrt(spans.span(t, k, i, number(t, k, LENGTH, i)).inv))
        return wp.vec2d(out, out / reach)

    @wp.func
    def of_rows(t: wp.ref[Topology], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View], e: Curves, b: int,
                n: int):  # fmt: skip
        """What bends with z itself: s'' (J P/D + rho), with the signs of L."""
        width = 2 * t.nv + t.nu
        for n_th in range(n):
            r = room.factor.row[b, n_th]
            e.strength[b, n_th] = k.lam[r] * k.scale[r]
            e.edge[b, n_th] = 0
            if t.row_kind[k.row[r]] == wp.static(CONTACT):
                e.edge[b, n_th] = adjoint.at_edge(t, k, t.row_index[k.row[r]])
            if wp.static(not hard):
                curve = -w.y[r] / k.scale[r]
                curve = curve * bend(k.z[r], ONE / k.sigma[r])
                for i in range(width):
                    own = curve * e.root[b, n_th, i]
                    for j in range(i + 1):
                        e.found[b, i, j] = e.found[b, i, j] + own * e.root[b, n_th, j]
        for i in range(width):
            for j in range(i):
                e.found[b, j, i] = e.found[b, i, j]

    @wp.func
    def hessian(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, room: wp.ref[Room], w: wp.ref[View], e: Curves,
        b: int, n: int, external: wp.array2d(dtype=given), world: int, leaps: int,
    ):  # fmt: skip
        width = 2 * t.nv + t.nu
        for i in range(width):
            for j in range(width):
                e.found[b, i, j] = ZERO
        if n > e.strength.shape[1]:
            return int(0)
        adjoint.aim(t, k, w)
        if dual.solved(t, k, room, w, b, n) == 0:
            return int(0)
        if wp.static(contacts):
            of_rows(t, k, room, w, e, b, n)
        if t.limited > 0:
            adjoint.rates(t, k, w)
            clamped(t, k, w, e, b)
        length = length_of(t, k)
        for c in range(t.nv):
            of_configuration(t, k, g, room, w, e, b, n, c, length, external, world, leaps)
        if wp.static(contacts):
            follow(t, k, g, room, b, n, -1)
        configure(t, k, room, w, e, b, n, external, world)
        adjoint.rates(t, k, w)
        coriolis.of_velocities(t, k, w, e, b, leaps)
        if leaps == 1:
            coriolis.of_predicted(t, k, room, w, e, b)
            adjoint.rates(t, k, w)
            adjoint.leap.by_predicted(t, k, w)
        total = ZERO + ZERO
        for i in range(width):
            for j in range(width):
                total += wp.abs(e.found[b, i, j])
        return wp.where(wp.isfinite(total), 1, 0)

    return SimpleNamespace(keep=keep, hessian=hessian)
