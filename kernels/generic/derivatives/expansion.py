"""The first-order expansion of the generic step at its solution, by the implicit function theorem.

At the solution F1 = M (v' - v) - h (r + u) - J' lambda = 0 and F2 = J v' + d/h - w = 0. Their derivatives by
(q, v, u) are gathered by loops over what each degree of freedom moves, some columns (LANES) at a time
(`columns.py`), and solved with one factor (`system.py`). No iteration is differentiated.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...status import NOT_CONVERGED, SOLVED
from ..step import make_step
from ..topology import Topology
from ..work import GROUPS, LANES, WORK, Slot
from .bodies import make_bodies
from .columns import make_columns
from .rows import make_row_slopes
from .springs import make_spring_slopes
from .system import make_system
from .tables import Groups, Slopes


@cached
def make_expansion(given: type, residual: str) -> SimpleNamespace:
    """start(t, k, params, world): numbers, no roots and no normals. solve(t, k, g, d, b, u, external, world)
    -> status: a step from the state (k.q, k.v0) under controls u, a leapfrog's with d.ahead; euler(t, k, u,
    external, world): Euler's part of it alone. prepare(t, k, g, d, b, external, world, leaps) -> (acting
    rows, pairs): the parts of the derivatives of what is solved and the factor; columns(t, k, g, d, b, n,
    pairs, first, leaps): d.found = dv' by LANES of (q, v, u), 1 if it holds. `leaps`: 1 of a leapfrog's
    whole step.
    """
    dtype = WORK
    step = make_step(given, residual)
    bodies, springs = make_bodies(given), make_spring_slopes(given)
    contacts = residual != "none"
    rows = make_row_slopes(given, residual) if contacts else None
    columns, system = make_columns(given, residual), make_system(given, residual)

    @wp.func(inline=False)
    def ready(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        g: Groups,
        d: Slopes,
        b: int,
        external: wp.array2d(dtype=given),
        world: int,
        leaps: int,
    ):
        for j in range(t.nv):
            d.velocity[b, j] = k.v0[j]
            d.change[b, j] = k.v0[j] - k.before[t.dof_block[j]][t.dof_part[j]]
        bodies.prepare(t, k, d, b, external, world)
        if leaps == 1:
            bodies.bend(t, k, d, b)
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

    @wp.func(inline=False)
    def columns_of(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, b: int, n: int,
        pairs: int, first: int, leaps: int,
    ):  # fmt: skip
        columns.fill(t, k, g, d, b, n, pairs, first, leaps)
        return system.solve(t, k, d, b, n)

    @wp.func(inline=False)
    def predicted(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, b: int, external: wp.array2d(dtype=given),
        world: int,
    ):  # fmt: skip
        """The derivatives of Euler's part of a leapfrog's step into d.ahead, all columns; 1 if they hold."""
        n, pairs = ready(t, k, g, d, b, external, world, 0)
        for part in range((2 * t.nv + t.nu + LANES - 1) / LANES):
            if columns_of(t, k, g, d, b, n, pairs, part * LANES, 0) == 0:
                return int(0)
            for i in range(3 * t.blocks):
                d.ahead[b, part * 3 * t.blocks + i] = d.found[b, i]
        return int(1)

    @wp.func
    def ended(t: wp.ref[Topology], k: wp.ref[Slot], back: int):
        """k.v0 = v' of a part that is solved, or v again, of a step that goes on."""
        for j in range(t.nv):
            b = t.dof_block[j]
            k.v0[j] = wp.where(back == 1, k.before[b][t.dof_part[j]], k.v[b][t.dof_part[j]])

    @wp.func(inline=False)
    def leapt(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, b: int, external: wp.array2d(dtype=given),
        world: int,
    ):  # fmt: skip
        """A leapfrog's step, part by part."""
        status = step.solve(t, k, 0, 0)
        if status == wp.static(SOLVED):
            ended(t, k, 0)
            if predicted(t, k, g, d, b, external, world) == 0:
                status = int(wp.static(NOT_CONVERGED))
            ended(t, k, 1)
        if status == wp.static(SOLVED):
            status = step.solve(t, k, 1, 1)
            ended(t, k, 0)
        return status

    @wp.func
    def begin(
        t: wp.ref[Topology], k: wp.ref[Slot], u: wp.array(dtype=given), external: wp.array2d(dtype=given),
        world: int,
    ):  # fmt: skip
        step.begin(t, k, external, world)
        for i in range(t.nu):
            step.control_force(t, k, i, dtype(u[i]))

    @wp.func
    def solve(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        g: Groups,
        d: Slopes,
        b: int,
        u: wp.array(dtype=given),
        external: wp.array2d(dtype=given),
        world: int,
    ):
        begin(t, k, u, external, world)
        if t.leapfrog == 1:
            return leapt(t, k, g, d, b, external, world)
        return step.solve_step(t, k)

    @wp.func
    def euler(
        t: wp.ref[Topology], k: wp.ref[Slot], u: wp.array(dtype=given), external: wp.array2d(dtype=given),
        world: int,
    ):  # fmt: skip
        begin(t, k, u, external, world)
        status = step.solve(t, k, 0, 0)
        ended(t, k, 0)
        return status

    return SimpleNamespace(
        start=step.prepare,
        solve=solve,
        euler=euler,
        prepare=ready,
        columns=columns_of,
    )
