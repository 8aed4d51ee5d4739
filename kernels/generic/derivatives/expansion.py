"""The first-order expansion of the generic step at its solution, by the implicit function theorem.

At the solution F1 = M (v' - v) - h (r + u) - J' lambda = 0 and F2 = J v' + d/h - w = 0. Their derivatives by
(q, v, u) are gathered by loops over what each degree of freedom moves, some columns (LANES) at a time
(`columns.py`), and solved with one factor (`system.py`). No iteration is differentiated.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..step import make_step
from ..topology import Topology
from ..work import GROUPS, LANES, WORK, Slot
from .bodies import make_bodies
from .columns import make_columns
from .leap import PREDICTED, WHOLE, make_leap
from .rows import make_row_slopes
from .springs import make_spring_slopes
from .system import make_system
from .tables import Groups, Slopes


@cached
def make_expansion(given: type, residual: str) -> SimpleNamespace:
    """start(t, k, params, world): numbers, no roots and no normals. solve(t, k, d, b, u, external, world) ->
    status: a step from the state (k.q, k.v0) under controls u. prepare(t, k, g, d, b, external, world) ->
    (acting rows, pairs): the parts of its derivatives and the factor; columns(t, k, g, d, b, n, pairs,
    first): d.found = dv' by LANES of (q, v, u), 1 if it holds.
    """
    dtype = WORK
    step = make_step(given, residual)
    bodies, springs, leap = make_bodies(given), make_spring_slopes(given), make_leap(given)
    contacts = residual != "none"
    rows = make_row_slopes(given, residual) if contacts else None
    columns, system = make_columns(given, residual), make_system(given, residual)

    @wp.func
    def solve(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        d: Slopes,
        b: int,
        u: wp.array(dtype=given),
        external: wp.array2d(dtype=given),
        world: int,
    ):
        for j in range(t.nv):
            d.change[b, j] = k.v0[j]
        step.begin(t, k, external, world)
        for i in range(t.nu):
            step.control_force(t, k, i, dtype(u[i]))
        return step.solve_step(t, k)

    @wp.func(inline=False)
    def predict(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, b: int, external: wp.array2d(dtype=given),
        world: int,
    ):  # fmt: skip
        """Of the leapfrog the derivatives of what it predicts, all columns."""
        leap.predict(t, k, d, b)
        bodies.prepare(t, k, d, b, external, world)
        springs.prepare(t, k, g, d, b)
        for part in range((2 * t.nv + t.nu + LANES - 1) / LANES):
            columns.fill(t, k, g, d, b, 0, 0, part * LANES, wp.static(PREDICTED))
            leap.keep(t, k, d, b, part)
        leap.restore(t, k, d, b)

    @wp.func
    def prepare(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        g: Groups,
        d: Slopes,
        b: int,
        external: wp.array2d(dtype=given),
        world: int,
    ):
        for j in range(t.nv):
            d.velocity[b, j] = k.v0[j]
            d.change[b, j] = k.v0[j] - d.change[b, j]
        if t.leapfrog == 1:
            predict(t, k, g, d, b, external, world)
        bodies.prepare(t, k, d, b, external, world)
        if t.leapfrog == 1:
            leap.bend(t, k, d, b)
        springs.prepare(t, k, g, d, b)
        n = int(0)
        pairs = int(0)
        if wp.static(contacts):
            bunches = int(0)
            for i in range(k.count[wp.static(GROUPS)]):
                before = n + 0
                for r in range(k.group[i], k.group[i + 1]):
                    if k.acting[r] > 0:
                        d.row[b, n] = r
                        n += 1
                if n > before:
                    d.bunch[b, bunches] = n
                    bunches += 1
        system.factor(t, k, d, b, n)
        if wp.static(contacts):
            pairs = rows.prepare(t, k, g, d, b, n)
        return n, pairs

    @wp.func
    def columns_of(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, b: int, n: int,
        pairs: int, first: int,
    ):  # fmt: skip
        columns.fill(t, k, g, d, b, n, pairs, first, wp.where(t.leapfrog == 1, wp.static(WHOLE), 0))
        return system.solve(t, k, d, b, n)

    return SimpleNamespace(
        start=step.prepare,
        solve=solve,
        prepare=prepare,
        columns=columns_of,
    )
