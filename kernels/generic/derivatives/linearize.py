"""A = df/dx and B = df/du of the generic step at its solution, for every step of every trajectory."""

from types import SimpleNamespace

import warp as wp

from ...device.compile import of_any_scene
from ...factories import cached
from ...status import NOT_CONVERGED, SOLVED
from ..motion.mechanism import COLUMN, make_mechanism
from ..topology import Topology, place
from ..work import LANES, WORK, Slot, Work, view
from .expansion import make_expansion
from .tables import Groups, Slopes


@cached
def make_writer(given: type) -> SimpleNamespace:
    """take(t, k, b, x): the state of a step. write(t, d, k, b, first, a, c): LANES columns of x' =
    (q + h v', v'), from `first` on of (x, u), into A and B. clear(a, c): zeros of both.
    """
    COUNT, ONE, H = LANES, WORK(1.0), COLUMN["step_size"]
    number = make_mechanism(given).number

    @wp.func
    def take(t: wp.ref[Topology], k: wp.ref[Slot], b: int, x: wp.array(dtype=given)):
        for j in range(t.nv):
            k.q[j] = WORK(x[j])
            k.v0[j] = WORK(x[t.nv + j])

    @wp.func
    def write(
        t: wp.ref[Topology],
        d: Slopes,
        k: wp.ref[Slot],
        b: int,
        first: int,
        a: wp.array2d(dtype=given),
        c: wp.array2d(dtype=given),
    ):
        h = number(t, k, H, 0)
        for j in range(t.nv):
            value = d.found[b, place(t, j)]
            for lane in range(COUNT):
                column = first + lane
                if column < 2 * t.nv:
                    a[t.nv + j, column] = given(value[lane])
                    a[j, column] = given(h * value[lane] + wp.where(column == j, ONE, WORK(0.0)))
                elif column < 2 * t.nv + t.nu:
                    c[t.nv + j, column - 2 * t.nv] = given(value[lane])
                    c[j, column - 2 * t.nv] = given(h * value[lane])

    @wp.func
    def clear(a: wp.array2d(dtype=given), c: wp.array2d(dtype=given)):
        for i in range(a.shape[0]):
            for j in range(a.shape[1]):
                a[i, j] = given(0.0)
            for j in range(c.shape[1]):
                c[i, j] = given(0.0)

    return SimpleNamespace(take=take, write=write, clear=clear)


@cached
def make_differentiate(given: type, residual: str) -> wp.Function:
    """differentiate(t, k, g, d, b, x, u, external, world, a, c) -> status: A and B of a step into a and c."""
    expansion, writer = make_expansion(given, residual), make_writer(given)
    COUNT = LANES

    @wp.func
    def differentiate(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        g: Groups,
        d: Slopes,
        b: int,
        x: wp.array(dtype=given),
        u: wp.array(dtype=given),
        external: wp.array2d(dtype=given),
        world: int,
        a: wp.array2d(dtype=given),
        c: wp.array2d(dtype=given),
    ):
        width = 2 * t.nv + t.nu
        writer.take(t, k, b, x)
        status = expansion.solve(t, k, g, d, b, u, external, world)
        if status != wp.static(SOLVED):
            return status
        n, pairs = expansion.prepare(t, k, g, d, b, external, world, t.leapfrog)
        for part in range((width + COUNT - 1) / COUNT):
            if expansion.columns(t, k, g, d, b, n, pairs, part * COUNT, t.leapfrog) == 0:
                writer.clear(a, c)
                return int(wp.static(NOT_CONVERGED))
            writer.write(t, d, k, b, part * COUNT, a, c)
        return status

    return differentiate


@cached
def make_linearize_kernel(given: type, residual: str) -> wp.Kernel:
    """As `derivatives/expansion.py` has it. Item i is part i mod P of problem i div P, `run` consecutive
    steps (P of them make up N), each of which starts from the roots of the one before; item - base is the
    slot.
    """
    expansion, differentiate = make_expansion(given, residual), make_differentiate(given, residual)

    @of_any_scene(residual != "none")
    def generic_linearize_kernel(
        first: int,
        base: int,
        run: int,
        t: Topology,
        work: Work,
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
        parts = (steps + run - 1) / run
        i = (base + b) / parts
        begin = (base + b - i * parts) * run
        if active.shape[0] > 0:
            if active[i] == 0:
                return
        k = view(work, b)
        code = int(1)
        for n in range(begin, wp.min(begin + run, steps)):
            if code != wp.static(SOLVED):
                expansion.start(t, k, params, i)
            code = differentiate(
                t,
                k,
                g,
                d,
                b,
                xs[i, n],
                us[i, n],
                external,
                i,
                fx[i, n],
                fu[i, n],
            )
            status[i, n] = code

    return generic_linearize_kernel
