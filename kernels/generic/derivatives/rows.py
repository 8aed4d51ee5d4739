"""How the rows of a solved step change with the configuration: J v' + d/h, and with inertia scaling D.

dD_i = 2 dJ_i m - m' dM m with m = M^-1 J_i', within the groups that row i moves.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..motion.mechanism import COLUMN, make_mechanism
from ..motion.whole import make_whole
from ..topology import CONTACT, Topology
from ..work import WORK, Slot
from .bodies import make_bodies
from .gaps import make_gap_slopes
from .pairs import make_pair_slopes
from .springs import make_spring_slopes
from .system import make_system
from .tables import Groups, Pair, Slopes


@cached
def make_row_slopes(given: type, residual: str) -> SimpleNamespace:
    """prepare(t, k, g, d, b, n) -> number of pairs with acting rows, listed in d.pair: fills
    d.of_contact, d.force, d.gap_by_q and d.scale_by_q of the n acting rows. place(t, g, i, dof): where in its
    part of d.scale_by_q a row has a degree of freedom, -1: nowhere.
    """
    dtype = WORK
    number = make_mechanism(given).number
    bodies, springs = make_bodies(given), make_spring_slopes(given)
    pairs, system = make_pair_slopes(given, residual), make_system(given, residual)
    gaps, whole = make_gap_slopes(given, residual), make_whole(given)
    H, FRICTION, MASS = COLUMN["step_size"], COLUMN["friction"], COLUMN["mass"]
    V2, V4 = wp.types.vector(2, dtype), wp.types.vector(4, dtype)
    ZERO, ONE, TWO = dtype(0.0), dtype(1.0), dtype(2.0)

    @wp.func
    def first_group(t: wp.ref[Topology], g: Groups, i: int):
        """The group of a limit's degree of freedom, of body A of a contact; -1: none."""
        if t.row_kind[i] != CONTACT:
            return g.dof_group[t.row_index[i]]
        return g.shape_group[t.pair_a[t.row_index[i]]]

    @wp.func
    def second_group(t: wp.ref[Topology], g: Groups, i: int):
        """The group of body B of a contact if it is another one; -1: none."""
        if t.row_kind[i] != CONTACT:
            return -1
        found = g.shape_group[t.pair_b[t.row_index[i]]]
        if found == first_group(t, g, i):
            return -1
        return found

    @wp.func
    def size(g: Groups, group: int):
        if group < 0:
            return 0
        return g.group_start[group + 1] - g.group_start[group]

    @wp.func
    def place(t: wp.ref[Topology], g: Groups, i: int, dof: int):
        group = g.dof_group[dof]
        first = first_group(t, g, i)
        if group == first:
            return g.dof_local[dof]
        if group == second_group(t, g, i):
            return size(g, first) + g.dof_local[dof]
        return -1

    @wp.func
    def mass_terms(
        t: wp.ref[Topology], g: Groups, d: Slopes, k: wp.ref[Slot], b: int, group: int,
        start: int,
    ):  # fmt: skip
        """Add -m' dM m of a group, m = d.answer."""
        for at in range(g.group_body_start[group], g.group_body_start[group + 1]):
            body = g.group_body[at]
            bodies.turned(t, d, b, body, number(t, k, MASS, body), g.dof_local, start)
        if t.implicit_damping == 1 or t.implicit_stiffness == 1:
            h = number(t, k, H, 0)
            for i in range(t.springs):
                begin = g.spring_start[i]
                if g.spring_start[i + 1] > begin:
                    if g.dof_group[g.spring_dof[begin]] == group:
                        if t.implicit_damping == 1:
                            springs.damped(g, d, b, i, h, g.dof_local, start)
                        if t.implicit_stiffness == 1:
                            springs.stiffened(g, d, b, i, g.dof_local, start)

    @wp.func
    def answer(t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, b: int, group: int):
        """d.answer of a group, from the places that `system.response` filled."""
        for at in range(g.group_start[group], g.group_start[group + 1]):
            j = g.group_dof[at]
            d.answer[b, j] = k.move[t.dof_block[j]][t.dof_part[j]]

    @wp.func
    def scaling(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, b: int, r: int,
        i: int, start: int, f: V2, rub: dtype,
    ):  # fmt: skip
        """d.scale_by_q of the r-th acting row, which is row i; a contact's entries are at `start`."""
        system.response(t, k, d.row[b, r])
        low = first_group(t, g, i)
        high = second_group(t, g, i)
        begin = r * g.width
        for at in range(begin, begin + size(g, low) + size(g, high)):
            d.scale_by_q[b, at] = ZERO
        if low >= 0:
            answer(t, k, g, d, b, low)
            mass_terms(t, g, d, k, b, low, begin)
        if high >= 0:
            answer(t, k, g, d, b, high)
            mass_terms(t, g, d, k, b, high, begin + size(g, low))
        if t.row_kind[i] == CONTACT:
            pair = t.row_index[i]
            first = r * g.most
            pairs.contract(t, d, b, pair, start, d.answer[b], f, ONE, rub, d.gap_by_q[b], first)
            for at in range(t.pair_start[pair], t.pair_start[pair + 1]):
                slot = begin + place(t, g, i, t.pair_dof[at])
                value = TWO * d.gap_by_q[b, first + at - t.pair_start[pair]]
                d.scale_by_q[b, slot] = d.scale_by_q[b, slot] + value

    @wp.func
    def prepare(t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, b: int, n: int):
        h = number(t, k, H, 0)
        found = int(0)
        normal = V4()
        last = int(-1)
        whole.exchange(t, k)
        for r in range(n):
            s = d.row[b, r]
            i = k.row[s]
            mu = dtype(0.0)
            rub = dtype(0.0)
            direction = V2()
            if t.row_kind[i] == CONTACT:
                pair = t.row_index[i]
                if pair != last:
                    normal = pairs.prepare(t, k, d, b, pair, found * g.most)
                    d.pair[b, found] = pair
                    d.force[b, found] = Pair()
                    last = pair
                    found += 1
                mu = number(t, k, FRICTION, pair)
                rub = dtype(t.row_sign[i]) * mu
                d.force[b, found - 1] = d.force[b, found - 1] + k.lam[s] * Pair(ONE, rub)
                direction = pairs.force(V2(normal[0], normal[1]), ONE, rub)
            if t.inertia_scaling == 1:
                scaling(t, k, g, d, b, r, i, (found - 1) * g.most, direction, rub)
            if t.row_kind[i] == CONTACT:
                if d.slides[b, r] == 1:
                    rub = ZERO
                start = (found - 1) * g.most
                gaps(t, k, d, b, i, start, normal, rub, k.v0, h, r * g.most)
        whole.exchange(t, k)
        return found

    return SimpleNamespace(prepare=prepare, place=place, first_group=first_group, second_group=second_group)
