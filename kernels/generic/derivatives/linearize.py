"""A = df/dx and B = df/du of the generic step at its solution, by the implicit function theorem.

At the solution F1 = M (v' - v) - h (r + u) - J' lambda = 0 and F2 = J v' + d/h - w = 0. Their derivatives by (q, v, u)
are gathered by loops over what each degree of freedom moves, eight columns at a time (`columns.py`), and solved
with one factor (`system.py`). No iteration is differentiated.
"""

from types import SimpleNamespace

import warp as wp

from ...contact.problem import COLD
from ...device.compile import specialised
from ...factories import cached
from ...status import NONFINITE, SOLVED
from ..mechanism import COLUMN, make_mechanism
from ..step import make_step
from ..topology import Topology
from ..work import WORK, Work
from .bodies import make_bodies
from .columns import make_columns
from .rows import make_row_slopes
from .springs import make_spring_slopes
from .system import make_system
from .tables import LANES, Groups, Slopes


@cached
def make_expansion(given: type, residual: str) -> SimpleNamespace:
    """solve(t, k, params, row, b, xs, us, external, world) -> status: a step from the states and controls at hand;
    prepare(t, k, g, d, params, row, b, x, external, world) -> (acting rows, pairs): its derivatives' parts and factor;
    columns(t, k, g, d, params, row, b, n, pairs, first): d.found = dv' by eight of (q, v, u).
    """
    dtype = WORK
    step = make_step(given, residual)
    number = make_mechanism(given).number
    bodies, springs = make_bodies(given), make_spring_slopes(given)
    contacts = residual != "none"
    rows = make_row_slopes(given, residual) if contacts else None
    columns, system = make_columns(given, residual), make_system(given, residual)
    UNUSED, ZERO = dtype(COLD), dtype(0.0)

    @wp.func
    def cold(t: Topology, k: Work, b: int):
        """No roots and normals to start from."""
        for i in range(t.nr):
            k.z[i, b] = UNUSED
        for i in range(2 * t.pairs):
            k.normal[i, b] = ZERO

    @wp.func
    def solve(
        t: Topology,
        k: Work,
        params: wp.array2d(dtype=given),
        row: int,
        b: int,
        x: wp.array(dtype=given),
        u: wp.array(dtype=given),
        external: wp.array2d(dtype=given),
        world: int,
    ):
        for j in range(t.nv):
            k.q[j, b] = dtype(x[j])
            k.v0[j, b] = dtype(x[t.nv + j])
        step.begin(t, k, params, row, b, external, world)
        for i in range(t.nu):
            step.control_force(t, k, params, row, b, i, dtype(u[i]))
        return step.solve_step(t, k, params, row, b, 0)

    @wp.func
    def prepare(
        t: Topology,
        k: Work,
        g: Groups,
        d: Slopes,
        params: wp.array2d(dtype=given),
        row: int,
        b: int,
        x: wp.array(dtype=given),
        external: wp.array2d(dtype=given),
        world: int,
    ):
        for j in range(t.nv):
            d.velocity[b, j] = k.v0[j, b]
            d.change[b, j] = k.v0[j, b] - dtype(x[t.nv + j])
        bodies.prepare(t, k, d, params, row, b, external, world)
        springs.prepare(t, k, g, d, params, row, b)
        n = int(0)
        pairs = int(0)
        if wp.static(contacts):
            for i in range(t.nr):
                n += wp.where(k.acting[i, b] > 0, 1, 0)
        system.factor(t, k, d, params, row, b, n)
        if wp.static(contacts):
            pairs = rows.prepare(t, k, g, d, params, row, b, n)
        return n, pairs

    @wp.func
    def columns_of(
        t: Topology, k: Work, g: Groups, d: Slopes, params: wp.array2d(dtype=given), row: int, b: int, n: int,
        pairs: int, first: int,
    ):  # fmt: skip
        columns.fill(t, k, g, d, params, row, b, n, pairs, first)
        system.solve(t, k, d, b, n)

    return SimpleNamespace(cold=cold, solve=solve, prepare=prepare, columns=columns_of, number=number)


@cached
def make_linearize_kernel(given: type, residual: str) -> wp.Kernel:
    """A and B at every step of every problem, as `derivatives/expansion.py` has them: item i is step i mod N of
    problem i div N; item - base is the slot.
    """
    expansion = make_expansion(given, residual)
    H = COLUMN["step_size"]
    COUNT = LANES

    @wp.func
    def write(t: Topology, d: Slopes, b: int, h: WORK, first: int, a: wp.array2d(dtype=given),
              c: wp.array2d(dtype=given)):  # fmt: skip
        """Eight columns of x' = (q + h v', v')."""
        for j in range(t.nv):
            value = d.found[b, t.place[j]]
            for lane in range(COUNT):
                column = first + lane
                if column < 2 * t.nv:
                    a[t.nv + j, column] = given(value[lane])
                    moved = h * value[lane]
                    if column == j:
                        moved += WORK(1.0)
                    a[j, column] = given(moved)
                elif column < 2 * t.nv + t.nu:
                    c[t.nv + j, column - 2 * t.nv] = given(value[lane])
                    c[j, column - 2 * t.nv] = given(h * value[lane])

    @specialised
    def generic_linearize_kernel(
        first: int,
        base: int,
        t: Topology,
        k: Work,
        g: Groups,
        d: Slopes,
        params: wp.array2d(dtype=given),
        steps: int,
        xs: wp.array3d(dtype=given),  # (B, >= N, nx)
        us: wp.array3d(dtype=given),  # (B, N, nu)
        external: wp.array2d(dtype=given),  # (0 or B, 3 nb)
        active: wp.array(dtype=wp.int32),  # (0 or B,) zero: skip the problem
        fx: wp.array4d(dtype=given),  # out (B, N, nx, nx)
        fu: wp.array4d(dtype=given),  # out (B, N, nx, nu)
        status: wp.array2d(dtype=wp.int32),  # out (B, N)
    ):
        b = first + wp.tid()
        problem = (base + b) / steps
        step = base + b - problem * steps
        if active.shape[0] > 0:
            if active[problem] == 0:
                return
        row = wp.where(params.shape[0] == 1, 0, problem)
        expansion.cold(t, k, b)
        code = expansion.solve(t, k, params, row, b, xs[problem, step], us[problem, step], external, problem)
        status[problem, step] = code
        if code == wp.static(SOLVED):
            n, pairs = expansion.prepare(t, k, g, d, params, row, b, xs[problem, step], external, problem)
            h = expansion.number(t, params, row, H, 0)
            for part in range((2 * t.nv + t.nu + COUNT - 1) / COUNT):
                expansion.columns(t, k, g, d, params, row, b, n, pairs, part * COUNT)
                write(t, d, b, h, part * COUNT, fx[problem, step], fu[problem, step])

    return generic_linearize_kernel
