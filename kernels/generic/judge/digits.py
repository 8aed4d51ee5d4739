"""Whether D = diag(J N^-1 J') of a smoothed law, (M3) and (M17), has the digits that a solution is judged by.

D of a row is J y with y = N^-1 J'. Where N is ill-conditioned y is off, and J y with it, to first order by
y (J' - N y); D with this added is no better, as the entries of N have lost the same digits. The law is then
another row's: it moves D lambda by what D lacks times lambda, and w by s'(-z)/s'(z) times that, next to
nothing of a row that presses by many sigma. Where the less of both is more than the row is judged by, the
step is NOT_CONVERGED. Hard contact does not ask for D, and without inertia scaling it is 1.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..motion.whole import make_whole
from ..newton import make_newton
from ..topology import Topology
from ..work import WORK, Island, Slot
from .scales import gather

ILL = 1e4  # of N_ii times a pivot's inverse, from which on rows are looked at
MOST = {wp.float64: 1e-9, wp.float32: 1e-6}  # of the size of a row's terms, by the precision that is promised


@cached
def make_digits(given: type, residual: str) -> SimpleNamespace:
    """loses(t, k, o): whether N of an island's bodies, the whole one (`motion/whole.py`), costs D digits."""
    dtype = WORK
    nt, whole = make_newton(given, residual), make_whole(given)
    env = nt.env
    ZERO, ONE, WHOLE = dtype(0.0), dtype(1.0), dtype(MOST[given])

    @wp.func
    def is_ill(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        worst = dtype(0.0)
        for place in range(o.start, o.end):
            b = k.block[place]
            f = wp.get_diag(k.mass_factor[t.mass_at[b] + b])
            own = wp.cw_mul(wp.cw_mul(f, f), wp.get_diag(k.mass[t.mass_at[b] + b]))
            worst = wp.max(worst, wp.max(own[0], wp.max(own[1], own[2])))
        return worst > dtype(wp.static(ILL))

    @wp.func
    def refined(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """J y + y (J' - N y) of row r; uses k.move and k.balance."""
        total = dtype(0.0)
        e = k.entry[r]
        end = k.entry[r + 1]
        at = k.pattern[r]
        while e < end:
            u = t.block_unit[t.row_block[at]]
            start = t.unit_start[u]
            last = t.unit_start[u + 1]
            e, at = gather(t, k, e, end, at, u)
            for j in range(start, last):
                k.balance[j] = k.move[j]
            env.solve(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, start, last)
            for i in range(start, last):
                y = k.move[i]
                total += wp.dot(y, k.balance[i])
                row = t.mass_at[i]
                k.balance[i] = k.balance[i] - k.mass[row + i] * y
                for j in range(t.mass_first[i], i):
                    m = k.mass[row + j]
                    k.balance[i] = k.balance[i] - m * k.move[j]
                    k.balance[j] = k.balance[j] - wp.transpose(m) * y
            for i in range(start, last):
                total += wp.dot(k.move[i], k.balance[i])
        return total

    @wp.func
    def lacks(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0 and k.lam[r] > ZERO:
                e = nt.smooth(k, r, k.z[r])
                lost = wp.abs(refined(t, k, r) - k.scale[r]) * k.lam[r] * wp.min(ONE, e[3] / e[2])
                if not (lost <= WHOLE * k.own[r]):
                    return True
        return False

    @wp.func(inline=False)
    def loses(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        if t.inertia_scaling == 0:
            return False
        other = whole.concerns(t, k, o)
        if other:
            whole.lend_all(t, k, o)
        out = is_ill(t, k, o)
        if out:
            out = lacks(t, k, o)
        if other:
            whole.take_all(t, k, o)
        return out

    return SimpleNamespace(loses=loses)
