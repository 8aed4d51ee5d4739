"""M with all that tendons with a limit have of it, by which D is, whatever yields.

D = diag(J M^-1 J') of an M that hangs on v' would be another law at every v': where tendons yield and contact
is smoothed, a step could have two solutions, or none. The factor of the whole M is kept behind what
`tendons.py` keeps in k.numbers, and lent in the place of that of M.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..linear.envelope import make_envelope
from ..topology import SMOOTHED, Topology
from ..work import Island, Slot
from .tendons import make_tendons


@cached
def make_whole(given: type) -> SimpleNamespace:
    """keep(t, k), once M and the forces are there without such tendons. exchange(t, k): k.mass_factor is the
    whole one's, and at the next call M's again. Neither does anything where D does not ask for it. Of an
    island that such tendons move, concerns(t, k, o) says where it does: lend(t, k, o), and with k.mass, too,
    lend_all(t, k, o); by take_back(t, k, o) and take_all(t, k, o) M's again. Those of all use k.move.
    """
    tendons, env = make_tendons(given), make_envelope()
    ONE = wp.float64(1.0)

    @wp.func
    def is_other(t: wp.ref[Topology]):
        return t.limited == wp.static(SMOOTHED) and t.inertia_scaling == 1

    @wp.func(inline=False)
    def stretch_all(t: wp.ref[Topology], k: wp.ref[Slot]):
        for i in range(t.tendons):
            if t.tendon_limited[i] == 1:
                tendons.stretch(t, k, i, ONE)

    @wp.func(inline=False)
    def swap(t: wp.ref[Topology], k: wp.ref[Slot], b: int):
        """A block's row of both factors."""
        start = t.width + 3 * t.tendons + 1 + 9 * k.mass.shape[0] + 3 * t.blocks
        for i in range(t.mass_at[b] + t.mass_first[b], t.mass_at[b] + b + 1):
            for n in range(9):
                value = k.numbers[start + 9 * i + n]
                k.numbers[start + 9 * i + n] = k.mass_factor[i][n // 3, n % 3]
                k.mass_factor[i][n // 3, n % 3] = value

    @wp.func
    def exchange(t: wp.ref[Topology], k: wp.ref[Slot]):
        if is_other(t):
            for b in range(t.blocks):
                swap(t, k, b)

    @wp.func(inline=False)
    def keep(t: wp.ref[Topology], k: wp.ref[Slot]):
        if not is_other(t):
            return
        tendons.hold(t, k, 0)
        stretch_all(t, k)
        for i in range(k.mass.shape[0]):
            k.mass_factor[i] = k.mass[i]
        env.factor(k.mass_factor, t.mass_first, t.mass_at, 0, t.blocks)
        exchange(t, k)
        tendons.hold(t, k, 1)

    @wp.func
    def concerns(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        if not is_other(t):
            return False
        for i in range(t.tendons):
            if t.tendon_limited[i] == 1:
                b = t.dof_block[t.tendon_dof[t.tendon_start[i]]]
                place = k.place[b]
                if place >= o.start and place < o.end:
                    if k.block[place] == b:
                        return True
        return False

    @wp.func
    def lend(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        for place in range(o.start, o.end):
            swap(t, k, k.block[place])

    @wp.func
    def lend_all(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        lend(t, k, o)
        tendons.hold(t, k, 1)
        stretch_all(t, k)

    @wp.func
    def take_all(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        lend(t, k, o)
        tendons.hold(t, k, 1)
        tendons.tense(t, k)

    return SimpleNamespace(
        keep=keep,
        exchange=exchange,
        concerns=concerns,
        lend=lend,
        take_back=lend,
        lend_all=lend_all,
        take_all=take_all,
    )
