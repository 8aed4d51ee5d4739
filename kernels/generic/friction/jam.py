"""Proof that Coulomb's hard contact has no solution, in large scenes: what may be called JAMMED.

A contact is guided where J_n = kappa J_t with |kappa| < mu: it opens only by sliding, mu |J_t v'| >= J_n v'.
Let v' be a solution. A guided contact that enters (d < 0) and one that does not (d >= 0) do no positive work,
as -d/h <= J_n v' <= mu |J_t v'| in the first case. Let all other rows that enter be kept open by one that is
guided: the same direction, and less far to go. Then they do not press, v' . M (v' - v_free) = -sum lambda_n
(d/h + mu |J_t v'|) <= 0, and v' lies in the ball about v_free/2 of radius |v_free|_M/2, in which J_n v' is at
most (J_n v_free + sqrt(A_nn) |v_free|_M)/2. Where a guided contact that enters needs more, there is no v'.
"""

import warp as wp

from ...factories import cached
from ..contact import ROUNDING
from ..newton import make_newton
from ..topology import CONTACT, Topology
from ..work import V3, WORK, Island, Slot

PARALLEL = 1e-24  # squares of what two directions differ by
STRICTLY = 1e-9  # by which inequalities must hold, relative to their terms


@cached
def make_jam(given: type) -> wp.Function:
    """proves_jam(t, k, o, h) -> 1 if the data of the acting rows and v_free prove that there is none."""
    dtype = WORK
    dot = make_newton(given, "hard").dot
    ZERO, HALF, ONE, TWO, TINY = dtype(0.0), dtype(0.5), dtype(1.0), dtype(2.0), dtype(1e-30)
    CLOSE, ROUND, LESS = dtype(PARALLEL), dtype(ROUNDING[given]), dtype(1.0 - STRICTLY)

    @wp.func
    def second_row(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """J_n - mu J_t of the contact whose J_n + mu J_t is row r; row r itself without friction."""
        i = k.row[r]
        if t.row_kind[i] == CONTACT and t.row_sign[i] != 0:
            return r + 1
        return r

    @wp.func
    def guided(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """|J_n|^2 of the contact of rows r and r + 1 where J_n = kappa J_t with |kappa| < mu, else -1."""
        square = dtype(0.0)
        cross = dtype(0.0)
        slip = dtype(0.0)
        left = dtype(0.0)
        shift = k.entry[second_row(t, k, r)] - k.entry[r]
        for look in range(2):
            for at in range(k.entry[r], k.entry[r + 1]):
                normal = HALF * (k.jac[at] + k.jac[at + shift])
                tangent = HALF * (k.jac[at] - k.jac[at + shift])
                if look == 0:
                    square += wp.dot(normal, normal)
                    cross += wp.dot(normal, tangent)
                    slip += wp.dot(tangent, tangent)
                else:
                    miss = slip * normal - cross * tangent
                    left += wp.dot(miss, miss)
        if square < LESS * slip and left <= CLOSE * slip * slip * square:
            return square
        return -ONE

    @wp.func
    def is_kept_open(t: wp.ref[Topology], k: wp.ref[Slot], r: int, square: dtype, gap: dtype):
        """Whether J_n of row r is that in k.move (of this square) times a positive number, by which a motion
        that opens `gap` there opens row r, too.
        """
        along = dtype(0.0)
        own = dtype(0.0)
        covered = dtype(0.0)
        start = k.entry[r]
        pattern = k.pattern[r]
        shift = k.entry[second_row(t, k, r)] - start
        for e in range(k.entry[r + 1] - start):
            normal = HALF * (k.jac[start + e] + k.jac[start + shift + e])
            other = k.move[t.row_block[pattern + e]]
            along += wp.dot(normal, other)
            own += wp.dot(normal, normal)
            covered += wp.dot(other, other)
        left = dtype(0.0)
        for e in range(k.entry[r + 1] - start):
            normal = HALF * (k.jac[start + e] + k.jac[start + shift + e])
            miss = square * normal - along * k.move[t.row_block[pattern + e]]
            left += wp.dot(miss, miss)
        parallel = covered >= LESS * square and left <= CLOSE * square * square * own
        return parallel and along > ZERO and -gap * along * LESS > -k.gap[r] * square

    @wp.func
    def enters(t: wp.ref[Topology], k: wp.ref[Slot], r: int, h: dtype):
        """Whether row r is a limit or the first of a pair, and d < 0."""
        i = k.row[r]
        if k.acting[r] == 0 or (t.row_kind[i] == CONTACT and t.row_sign[i] < 0):
            return False
        return k.gap[r] * h < -ROUND

    @wp.func(inline=False)
    def proves_jam(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, h: dtype):
        energy = dtype(0.0)  # |v_free|_M^2
        for place in range(o.start, o.end):
            i = k.block[place]
            k.move[i] = V3()
            energy += wp.dot(k.vfree[i], k.mass[t.mass_at[i] + i] * k.vfree[i])
            for j in range(t.mass_first[i], i):
                energy += TWO * wp.dot(k.vfree[i], k.mass[t.mass_at[i] + j] * k.vfree[j])
        worst = int(-1)  # guided, and without a way out
        for r in range(o.row, o.last_row):
            if enters(t, k, r, h):
                k.res[r] = guided(t, k, r)
                if worst < 0 and k.res[r] >= ZERO:
                    plus = dtype(0.0)
                    for at in range(k.entry[r], k.entry[r + 1]):
                        plus += wp.dot(k.jac[at], k.jac[at])
                    reach = wp.sqrt(k.diag[r] * k.res[r] / wp.max(plus, TINY) * energy)
                    along = HALF * (dot(t, k, k.vfree, r) + dot(t, k, k.vfree, r + 1))
                    if HALF * (along + reach) < -LESS * k.gap[r]:
                        worst = r
        if worst < 0:
            return 0
        start = k.entry[worst]
        shift = k.entry[worst + 1] - start
        for e in range(shift):
            normal = HALF * (k.jac[start + e] + k.jac[start + shift + e])
            k.move[t.row_block[k.pattern[worst] + e]] = normal
        for r in range(o.row, o.last_row):
            if enters(t, k, r, h):
                if k.res[r] < ZERO and not is_kept_open(t, k, r, k.res[worst], k.gap[worst]):
                    return 0
        return 1

    return proves_jam
