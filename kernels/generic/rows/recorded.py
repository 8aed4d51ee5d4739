"""What a solved step reports of its rows: impulses, and gaps of pairs that are near or far."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..contact import make_contact
from ..motion.mechanism import COLUMN, make_mechanism
from ..topology import CONTACT, Topology
from ..work import ROWS, V2, Slot


@cached
def make_recorded(given: type, residual: str) -> SimpleNamespace:
    """reported(t, k, r), far_gap(t, k, pair), row_gap(t, k, r); record(t, k, world, n, impulse, gap)."""
    contact = make_contact(given, residual) if residual != "none" else None
    number = make_mechanism(given).number
    FRICTION = COLUMN["friction"]

    @wp.func
    def reported(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """What row r reports: lambda, and with Coulomb friction the normal, then the tangential impulse."""
        i = k.row[r]
        if t.coulomb == 0 or t.row_sign[i] == 0 or t.row_kind[i] != CONTACT:
            return k.lam[r]
        if t.row_sign[i] > 0:
            return k.lam[r] + k.lam[r + 1]
        return number(t, k, FRICTION, t.row_index[i]) * (k.lam[r - 1] - k.lam[r])

    @wp.func
    def far_gap(t: wp.ref[Topology], k: wp.ref[Slot], pair: int):
        """The signed distance of a pair that is not near; where it was looked for is not remembered, so that
        motion does not depend on what is recorded.
        """
        normal = V2(k.normal[pair][0], k.normal[pair][1])
        _nx, _ny, gap, _ha, _turn_a, _hb, _turn_b = contact.geometry(t, k, pair)
        k.normal[pair] = normal
        return gap

    @wp.func(inline=False)
    def record(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        world: int,
        n: int,
        impulse: wp.array3d(dtype=given),
        gap: wp.array3d(dtype=given),
    ):
        """Impulses and gaps of step n of a rollout, where there is room for them."""
        if impulse.shape[0] > 0:
            for i in range(t.nr):
                impulse[world, n, i] = given(0.0)
            for r in range(k.count[wp.static(ROWS)]):
                impulse[world, n, k.row[r]] = given(reported(t, k, r))
        if gap.shape[0] > 0:
            for pair in range(t.pairs):
                if k.known[pair] == 0:
                    far = given(far_gap(t, k, pair))
                    for i in range(t.pair_row[pair], t.pair_row[pair + 1]):
                        gap[world, n, i] = far
            for r in range(k.count[wp.static(ROWS)]):
                gap[world, n, k.row[r]] = given(contact.row_gap(t, k, r))

    return SimpleNamespace(
        reported=reported,
        far_gap=far_gap,
        row_gap=contact.row_gap if residual != "none" else None,
        record=record if residual != "none" else None,
    )
