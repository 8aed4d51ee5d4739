"""What a large coefficient hides from the solvers of rows J_n +- mu J_t.

Their residuals are relative to terms with mu v_t in them, and in single precision J_n itself may be a
rounding of mu J_t. What is missed of w_n, the rows' mean, is then as nothing, though bodies go through each
other. So w_n of a contact whose coefficient is large is judged once more, by terms without it.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..residual.noise import make_noise
from ..specialisation import Specialisation
from ..structure import layout
from .problem import make_problem
from .rows import make_rows

LARGE = 10.0  # of a coefficient: below, what a row may miss is little of w_n, too
CLOSED = {wp.float64: 1e-8, wp.float32: 2e-5}  # of w_n, by a gap or speeds without mu
ROUNDING = {wp.float64: 1.1e-16, wp.float32: 6e-8}  # of the entries of rows


@cached
def make_apart(spec: Specialisation) -> SimpleNamespace:
    """Of a convex law's problem: large(world, p), whether a row in the mask has a large coefficient;
    keeps_apart(world, p, v) -> whether no contact with one closes at v', but those of which a row that is not
    in the mask yet is violated. None both without friction.
    """
    s, dtype, method = spec
    frictional = tuple(i for i, row in enumerate(s.rows) if row.kind == "contact" and row.sign > 0)
    if not frictional:
        return SimpleNamespace(large=None, keeps_apart=None)
    rows, noise, Problem = make_rows(spec), make_noise(spec), make_problem(s, dtype)
    World, VQ = rows.types.World, rows.types.VQ
    MOST, SHARE, ROUND = dtype(LARGE), dtype(CLOSED[dtype]), dtype(ROUNDING[dtype])
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    FRICTION = layout(s).offset("friction")
    pair = tuple(row.index if row.kind == "contact" and row.sign != 0 else 0 for row in s.rows)
    rubs = tuple(row.kind == "contact" and row.sign != 0 for row in s.rows)

    @wp.func
    def large(world: World, p: Problem):
        out = bool(False)
        for i in range(wp.static(s.nr)):
            if wp.static(i in frictional):
                if (p.mask & wp.static(3 << i)) != 0:
                    out = out or world.params[wp.static(FRICTION + pair[i])] > MOST
        return out

    @wp.func
    def size_of(world: World, p: Problem):
        """The largest speed of a row in the mask, what friction scales divided by 1 + mu, and overlap."""
        size = ZERO
        for i in range(wp.static(s.nr)):
            if (p.mask & wp.static(1 << i)) != 0:
                moves = wp.dot(wp.abs(wp.static(rows.adds[i])(VQ(), p.jac, ONE)), wp.abs(p.vfree))
                if wp.static(rubs[i]):
                    moves = moves / (ONE + world.params[wp.static(FRICTION + pair[i])])
                if wp.static(not method.hard):
                    moves += wp.static(noise.level[i])(world, p.sigma)
                size = wp.max(size, wp.max(-p.rate[i], ZERO) + moves)
        return size

    def make_closes(i: int) -> wp.Function:
        @wp.func
        def closes(p: Problem, v: VQ, size: dtype):
            first = wp.dot(p.jac[wp.static(i)], v)
            second = wp.dot(p.jac[wp.static(i + 1)], v)
            rate = p.rate[wp.static(i)]
            joins = bool(False)
            if (p.mask & wp.static(1 << i)) == 0:
                joins = rate + first < ZERO
            if (p.mask & wp.static(2 << i)) == 0:
                joins = rate + second < ZERO
            entries = wp.max(wp.abs(p.jac[wp.static(i)]), wp.abs(p.jac[wp.static(i + 1)]))
            lost = ROUND * wp.dot(entries, wp.abs(v))
            least = lost - SHARE * wp.max(size, wp.abs(rate))
            return not joins and not (rate + HALF * (first + second) >= least)

        return closes

    closing = tuple(make_closes(i) if i in frictional else None for i in range(s.nr))

    @wp.func(inline=False)
    def keeps_apart(world: World, p: Problem, v: VQ):
        size = size_of(world, p)
        good = bool(True)
        for i in range(wp.static(s.nr)):
            if wp.static(i in frictional):
                if (p.mask & wp.static(3 << i)) != 0:
                    if world.params[wp.static(FRICTION + pair[i])] > MOST:
                        good = good and not wp.static(closing[i])(p, v, size)
        return good

    return SimpleNamespace(large=large, keeps_apart=keeps_apart)
