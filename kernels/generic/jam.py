"""Proof that Coulomb's hard contact has no solution, in large scenes: what may be called JAMMED.

A contact is guided where J_n = kappa J_t with |kappa| < mu: it opens only by sliding, mu |J_t v'| >= J_n v'.
Let v' be a solution. A guided contact that enters (d < 0) and one that does not (d >= 0) do no positive work,
as -d/h <= J_n v' <= mu |J_t v'| in the first case. Let all other rows that enter be kept open by one that is
guided: the same direction, and less far to go. Then they do not press, v' . M (v' - v_free) = -sum lambda_n
(d/h + mu |J_t v'|) <= 0, and v' lies in the ball about v_free/2 of radius |v_free|_M/2, in which J_n v' is at
most (J_n v_free + sqrt(A_nn) |v_free|_M)/2. Where a guided contact that enters needs more, there is no v'.
"""

import warp as wp

from ..factories import cached
from .contact import ROUNDING
from .newton import make_newton
from .topology import CONTACT, Topology
from .work import WORK, Work

PARALLEL = 1e-24  # squares of what two directions differ by
STRICTLY = 1e-9  # by which inequalities must hold, relative to their terms


@cached
def make_jam(given: type) -> wp.Function:
    """proves_jam(t, k, b, n, h) -> 1 if the data of the acting rows and v_free prove that there is none."""
    dtype = WORK
    dot = make_newton(given, "hard").dot
    ZERO, HALF, ONE, TWO, TINY = dtype(0.0), dtype(0.5), dtype(1.0), dtype(2.0), dtype(1e-30)
    CLOSE, ROUND, LESS = dtype(PARALLEL), dtype(ROUNDING[given]), dtype(1.0 - STRICTLY)

    @wp.func
    def second_row(t: Topology, i: int):
        """J_n - mu J_t of the contact whose J_n + mu J_t is row i; row i itself without friction."""
        if t.row_kind[i] == CONTACT and t.row_sign[i] != 0:
            return i + 1
        return i

    @wp.func
    def guided(t: Topology, k: Work, b: int, i: int):
        """|J_n|^2 of the contact of rows i and i + 1 where J_n = kappa J_t with |kappa| < mu, else -1."""
        square = dtype(0.0)
        cross = dtype(0.0)
        slip = dtype(0.0)
        left = dtype(0.0)
        shift = t.row_start[second_row(t, i)] - t.row_start[i]
        for look in range(2):
            for at in range(t.row_start[i], t.row_start[i + 1]):
                normal = HALF * (k.jac[at, b] + k.jac[at + shift, b])
                tangent = HALF * (k.jac[at, b] - k.jac[at + shift, b])
                if look == 0:
                    square += normal * normal
                    cross += normal * tangent
                    slip += tangent * tangent
                else:
                    miss = slip * normal - cross * tangent
                    left += miss * miss
        if square < LESS * slip and left <= CLOSE * slip * slip * square:
            return square
        return -ONE

    @wp.func
    def is_kept_open(t: Topology, k: Work, b: int, i: int, square: dtype, gap: dtype):
        """Whether J_n of row i is that in k.move (of this square) times a positive number, by which a motion
        that opens `gap` there opens row i, too.
        """
        along = dtype(0.0)
        own = dtype(0.0)
        covered = dtype(0.0)
        shift = t.row_start[second_row(t, i)] - t.row_start[i]
        for at in range(t.row_start[i], t.row_start[i + 1]):
            normal = HALF * (k.jac[at, b] + k.jac[at + shift, b])
            other = k.move[t.row_place[at], b]
            along += normal * other
            own += normal * normal
            covered += other * other
        left = dtype(0.0)
        for at in range(t.row_start[i], t.row_start[i + 1]):
            normal = HALF * (k.jac[at, b] + k.jac[at + shift, b])
            miss = square * normal - along * k.move[t.row_place[at], b]
            left += miss * miss
        parallel = covered >= LESS * square and left <= CLOSE * square * square * own
        return parallel and along > ZERO and -gap * along * LESS > -k.gap[i, b] * square

    @wp.func
    def enters(t: Topology, k: Work, b: int, i: int, h: dtype):
        """Whether row i is a limit or the first of a pair, and d < 0."""
        if t.row_kind[i] == CONTACT and t.row_sign[i] < 0:
            return False
        return k.gap[i, b] * h < -ROUND

    @wp.func
    def proves_jam(t: Topology, k: Work, b: int, n: int, h: dtype):
        energy = dtype(0.0)  # |v_free|_M^2
        for i in range(t.nv):
            k.move[i, b] = ZERO
            for j in range(t.mass_first[i], i + 1):
                share = wp.where(j < i, TWO, ONE) * k.mass[t.mass_at[i] + j, b]
                energy += share * k.vfree[i, b] * k.vfree[j, b]
        worst = int(-1)  # guided, and without a way out
        for r in range(n):
            i = k.active[r, b]
            k.res[i, b] = guided(t, k, b, i)
            if worst < 0 and enters(t, k, b, i, h) and k.res[i, b] >= ZERO:
                plus = dtype(0.0)
                for at in range(t.row_start[i], t.row_start[i + 1]):
                    plus += k.jac[at, b] * k.jac[at, b]
                reach = wp.sqrt(k.diag[i, b] * k.res[i, b] / wp.max(plus, TINY) * energy)
                along = HALF * (dot(t, k, k.vfree, i, b) + dot(t, k, k.vfree, i + 1, b))
                if HALF * (along + reach) < -LESS * k.gap[i, b]:
                    worst = i
        if worst < 0:
            return 0
        shift = t.row_start[worst + 1] - t.row_start[worst]
        for at in range(t.row_start[worst], t.row_start[worst + 1]):
            k.move[t.row_place[at], b] = HALF * (k.jac[at, b] + k.jac[at + shift, b])
        for r in range(n):
            i = k.active[r, b]
            if enters(t, k, b, i, h) and k.res[i, b] < ZERO:
                if not is_kept_open(t, k, b, i, k.res[worst, b], k.gap[worst, b]):
                    return 0
        return 1

    return proves_jam
