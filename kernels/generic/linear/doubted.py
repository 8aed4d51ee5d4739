"""M^-1 times forces where springs and tendons are in M: a stiff one ties coordinates whose own inertia has no
digits beside it.

What M^-1 makes of forces f beyond what the diagonal of M does, f.M^-1 f against the sum of f_i^2/M_ii, is how
many digits the sum that M is may have lost. From DOUBTFUL on the solution is refined, and from LOST on, or
where that changes it by MISSED still, it is none.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..topology import Topology
from ..work import V3, WORK, Slot
from .envelope import make_envelope

DOUBTFUL, LOST = 1e6, 1e13
MISSED, FINE, ROUNDS = 1e-4, 1e-10, 3  # of the solution, by its kinetic energy on M's diagonal


@cached
def make_doubted() -> SimpleNamespace:
    """solve(t, k): k.move = M^-1 k.move by the factor at hand, 1 if that is lost; k.v, k.vfree are used."""
    dtype, env = WORK, make_envelope()
    ZERO, SOME, MOST = dtype(0.0), dtype(DOUBTFUL), dtype(LOST)
    MISS, SMALL = dtype(MISSED * MISSED), dtype(FINE * FINE)

    @wp.func
    def energy(t: wp.ref[Topology], k: wp.ref[Slot], x: wp.array(dtype=V3)):
        """Twice the kinetic energy of x on the diagonal of M."""
        out = ZERO + ZERO
        for i in range(t.blocks):
            m = k.mass[t.mass_at[i] + i]
            for part in range(3):
                out += m[part, part] * x[i][part] * x[i][part]
        return out

    @wp.func
    def miss(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.move = k.v - M k.vfree"""
        for i in range(t.blocks):
            k.move[i] = k.v[i]
        for i in range(t.blocks):
            at = t.mass_at[i]
            x = k.vfree[i]
            value = k.mass[at + i] * x
            for j in range(t.mass_first[i], i):
                m = k.mass[at + j]
                value += m * k.vfree[j]
                k.move[j] = k.move[j] - wp.transpose(m) * x
            k.move[i] = k.move[i] - value

    @wp.func(inline=False)
    def solve(t: wp.ref[Topology], k: wp.ref[Slot]):
        for i in range(t.blocks):
            k.v[i] = k.move[i]
        env.solve(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, 0, t.blocks)
        work = ZERO + ZERO
        plain = ZERO + ZERO
        for i in range(t.blocks):
            m = k.mass[t.mass_at[i] + i]
            k.vfree[i] = k.move[i]
            work += wp.dot(k.v[i], k.move[i])
            for part in range(3):
                plain += k.v[i][part] * k.v[i][part] / m[part, part]
        if work <= SOME * plain:
            return int(0)
        moved = ZERO + ZERO
        whole = ZERO + ZERO
        n = int(0)
        while n < wp.static(ROUNDS):
            miss(t, k)
            env.solve(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, 0, t.blocks)
            moved = energy(t, k, k.move)
            for i in range(t.blocks):
                k.vfree[i] = k.vfree[i] + k.move[i]
            whole = energy(t, k, k.vfree)
            n += 1
            if moved <= SMALL * whole:
                n = int(wp.static(ROUNDS))
        for i in range(t.blocks):
            k.move[i] = k.vfree[i]
        return wp.where(work <= MOST * plain and moved <= MISS * whole, 0, 1)

    return SimpleNamespace(solve=solve)
