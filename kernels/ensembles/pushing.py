"""What pushes in a step, as measures look at it: of specialised kernels and of generic ones."""

from types import SimpleNamespace
from typing import Any

import warp as wp

from ..factories import cached
from ..generic.contact import make_contact
from ..generic.motion.mechanism import COLUMN, make_mechanism
from ..generic.topology import CONTACT, Topology
from ..generic.work import ROWS, V2, V4, WORK, Slot
from ..specialisation import Specialisation
from ..step.slips import make_slips
from ..structure import layout
from .contacts import TOUCH, make_contacts, make_listed_contacts


def make_pushing(spec: Specialisation, step: Any, users: Any) -> SimpleNamespace:
    """contacts_of(world, x, solution, h) -> Contacts of a step from x of specialised kernels; `contacts`.

    Args:
        spec: of the kernels.
        step: functions of a step, of `make_step`.
        users: which of all that measures look at: `measures.Users`.
    """
    s, dtype, _ = spec
    t, NP = step.types, len(s.pairs)
    contacts = make_contacts(NP, users.slips, users.rubs, len(s.tendons) if users.pulls else 0)
    slips = make_slips(spec) if users.slips else None
    FRICTION = layout(s).offset("friction")
    pair_of = [row.index if row.kind == "contact" else -1 for row in s.rows]
    tangent = step.rows.tangent
    apart = {pair_of[r] for r in range(s.nr) if tangent[r]}  # whose rows are (n, t), not n +- mu t
    rubs = [tangent[r] or (s.rows[r].sign != 0 and pair_of[r] not in {-1, *apart}) for r in range(s.nr)]

    @wp.func
    def pushes(sol: step.Solution, h: wp.float64):
        out = contacts.none()
        for r in range(wp.static(s.nr)):
            if wp.static(pair_of[r] >= 0):
                if wp.static(users.gaps):
                    gap = wp.float64(sol.rate[wp.static(step.gap_row[r])]) * h
                    out.distance[wp.static(pair_of[r])] = gap
                if (sol.mask & wp.static(1 << r)) != 0:
                    if wp.static(step.gap_row[r] == r):
                        out.impulse[wp.static(pair_of[r])] = out.impulse[wp.static(pair_of[r])] + wp.float64(
                            sol.lam[r]
                        )
        return out

    @wp.func
    def with_rubs(c: contacts.Contacts, world: t.World, sol: step.Solution):
        out = c
        for r in range(wp.static(s.nr)):
            if wp.static(rubs[r]):
                if (sol.mask & wp.static(1 << r)) != 0:
                    rub = sol.lam[r]
                    if wp.static(not tangent[r]):
                        rub = (
                            wp.static(dtype(float(s.rows[r].sign)))
                            * world.params[wp.static(FRICTION + max(pair_of[r], 0))]
                            * rub
                        )
                    out.rub[wp.static(pair_of[r])] = out.rub[wp.static(pair_of[r])] + wp.float64(rub)
        return out

    @wp.func
    def with_slips(c: contacts.Contacts, world: t.World, x: t.VX, sol: step.Solution):
        out = c
        wanted = int(0)
        for p in range(wp.static(NP)):
            if out.impulse[p] > wp.float64(wp.static(TOUCH)):
                wanted = wanted | wp.static(1 << p)
        q, _v = step.split(x)
        found = wp.static(slips)(world, q, sol.v, sol.normal, wanted)
        for p in range(wp.static(NP)):
            out.slip[p] = wp.float64(found[p])
        return out

    @wp.func
    def contacts_of(world: t.World, x: t.VX, sol: step.Solution, h: wp.float64):
        """Normal impulses of the pairs that act, and what else is looked at."""
        out = pushes(sol, h)
        if wp.static(users.rubs):
            out = with_rubs(out, world, sol)
        if wp.static(users.slips):
            out = with_slips(out, world, x, sol)
        return out

    return SimpleNamespace(contacts=contacts, contacts_of=contacts_of)


@cached
def make_slip(given: type, residual: str) -> wp.Function:
    """slip(t, k, pair) -> J_t v' (M6) of a pair [m/s], once its step is solved and before the next one
    begins; where its normal was found is not remembered, so that motion does not depend on what is looked at.
    """
    contact = make_contact(given, residual)
    GEO = wp.types.vector(8, WORK)
    ZERO = WORK(0.0)

    @wp.func(inline=False)
    def slip(t: wp.ref[Topology], k: wp.ref[Slot], pair: int):
        normal = V2(k.normal[pair][0], k.normal[pair][1])
        nx, ny, gap, ha, turn_a, hb, turn_b = contact.geometry(t, k, pair)
        k.normal[pair] = normal
        g = GEO(nx, ny, gap, ha, turn_a, hb, turn_b, ZERO)
        pa = V4(contact.pose_a(t, k, pair))
        pb = V4(contact.pose_b(t, k, pair))
        out = ZERO
        for at in range(t.pair_start[pair], t.pair_start[pair + 1]):
            j = t.pair_dof[at]
            out += contact.moved_by(t, k, pair, at, pa, pb, g)[1] * k.v0[j]
        return out

    return slip


def make_listed_pushing(given: type, residual: str, step: Any, users: Any) -> SimpleNamespace:
    """contacts_of(t, k, c, h) fills the Contacts of a step of generic kernels; `contacts`.

    Args:
        given: precision of the arrays.
        residual: of the kernels; "none": nothing touches.
        step: functions of a step, of `make_step`.
        users: which of all that measures look at: `measures.Users`.
    """
    contacts = make_listed_contacts()
    slip = make_slip(given, residual) if users.slips and residual != "none" else None
    number, FRICTION = make_mechanism(given).number, COLUMN["friction"]
    ZERO = WORK(0.0)

    @wp.func
    def contacts_of(t: wp.ref[Topology], k: wp.ref[Slot], c: contacts.Contacts, h: wp.float64):
        """Normal impulses of the pairs that act, and what else is looked at."""
        for pair in range(t.pairs):
            c.impulse[pair] = ZERO
            if wp.static(users.rubs):
                c.rub[pair] = ZERO
            if wp.static(users.gaps and residual != "none"):
                if k.known[pair] == 0:
                    c.distance[pair] = step.far_gap(t, k, pair)
        for r in range(k.count[wp.static(ROWS)]):
            i = k.row[r]
            if t.row_kind[i] == wp.static(CONTACT):
                pair = t.row_index[i]
                if wp.static(users.gaps):
                    c.distance[pair] = step.row_gap(t, k, r)
                if k.acting[r] > 0:
                    c.impulse[pair] = c.impulse[pair] + k.lam[r]
                    if wp.static(users.rubs):
                        share = WORK(t.row_sign[i]) * number(t, k, FRICTION, pair)
                        c.rub[pair] = c.rub[pair] + share * k.lam[r]
        if wp.static(slip is not None):
            for pair in range(t.pairs):
                c.slip[pair] = ZERO
                if c.impulse[pair] > WORK(wp.static(TOUCH)):
                    c.slip[pair] = wp.static(slip)(t, k, pair)

    return SimpleNamespace(contacts=contacts, contacts_of=contacts_of)
