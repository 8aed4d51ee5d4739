"""A = df/dx and B = df/du of the generic step at its solution, for every step of every trajectory.

Second derivatives are central differences of them. The scheme is that of `derivatives/second_differences.py`,
(M30): of each of z = (q, v, u) in turn dv'/dz at +-e and +-2e, in 4 nz more steps with their derivatives. A
world with a perturbed step that is not solved gets zero second derivatives.
"""

from types import SimpleNamespace
from typing import Any

import warp as wp

from ...contact.problem import COLD
from ...device.compile import packed
from ...factories import cached
from ...residual.smoothing import HARD_LAYER, LARGEST_LAYER, REACH
from ...status import NOT_CONVERGED, SOLVED
from ...structure import Structure
from ..mechanism import COLUMN, make_mechanism
from ..topology import Topology, place
from ..work import LANES, ROWS, V2, WORK, Slot, Work, view
from .expansion import make_expansion
from .tables import Groups, Slopes


@wp.struct
class Stencil:
    """Workspaces, (slots, items)."""

    root: wp.array2d(dtype=WORK)  # (nr) z of the step itself: where perturbed ones start
    normal: wp.array2d(dtype=V2)  # (pairs)
    size: wp.array2d(dtype=WORK)  # (nz) e
    bend: wp.array3d(dtype=WORK)  # (slots, nv, nz) derivative of dv'/dz by one of z


def allocate_stencil(s: Structure, slots: int, device: Any) -> Stencil:
    """Workspaces of `slots` worlds."""
    out, nz = Stencil(), 2 * s.nv + s.nu
    for name, shape, kind in (
        ("root", (s.nr,), WORK),
        ("normal", (len(s.pairs),), V2),
        ("size", (nz,), WORK),
        ("bend", (s.nv, nz), WORK),
    ):
        setattr(out, name, wp.zeros((slots, *shape), dtype=kind, device=device))
    return out


def bytes_of_stencil(s: Structure) -> int:
    """Memory of one slot."""
    nz = 2 * s.nv + s.nu
    return 8 * (s.nr + 2 * len(s.pairs) + (s.nv + 1) * nz)


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
def make_differences(given: type, residual: str) -> SimpleNamespace:
    """measure(t, k, e, b): the size of the differences, and where perturbed steps start;
    stencil(kind): how far each is and its weight; start(t, k, e, b, c, far): such a step. add_slope(t, d, e,
    b, first, weight): LANES columns of its dv'/dz; add_second(fzz, e, b, c): the derivative by component c
    that they made. clear(fzz, item).
    """
    expansion = make_expansion(given, residual)
    real = WORK
    COUNT, GEAR, H = LANES, COLUMN["gear"], COLUMN["step_size"]
    UNUSED, ZERO, HALF, ONE, TWO = real(COLD), real(0.0), real(0.5), real(1.0), real(2.0)
    NEAR, FAR = real(8.0 / 12.0), real(-1.0 / 12.0)
    PART, LARGEST, LEAST = real(REACH), real(LARGEST_LAYER), real(1e-6)

    @wp.func
    def measure(t: wp.ref[Topology], k: wp.ref[Slot], e: Stencil, b: int):
        """e.size, e.root and e.normal; no slopes yet."""
        layer = ZERO + LARGEST
        for i in range(t.nr):
            e.root[b, i] = UNUSED
        if wp.static(residual == "hard"):
            layer = real(wp.static(HARD_LAYER))
        for r in range(k.count[wp.static(ROWS)]):
            e.root[b, k.row[r]] = k.z[r]
            if wp.static(residual != "hard"):
                if k.acting[r] > 0:
                    layer = wp.min(layer, k.sigma[r])
        for i in range(t.pairs):
            e.normal[b, i] = k.normal[i]
        h = expansion.number(t, k, H, 0)
        for j in range(t.nv):
            for c in range(e.bend.shape[2]):
                e.bend[b, j, c] = ZERO
            e.size[b, j] = PART * h * layer
            e.size[b, t.nv + j] = PART * layer
        for i in range(t.nu):
            own = expansion.inverse(t, k, t.actuator[i])
            reaction = wp.abs(expansion.number(t, k, GEAR, i)) * own * h
            e.size[b, 2 * t.nv + i] = PART * wp.min(layer / wp.max(reaction, LEAST), ONE)

    @wp.func
    def stencil(kind: int):
        """Of the points at +1, -1, +2, -2: how far in units of the size, and the weight."""
        times = wp.where(kind < 2, ONE, TWO)
        weight = wp.where(kind < 2, NEAR, FAR)
        if (kind & 1) == 1:
            times = -times
            weight = -weight
        return times, weight

    @wp.func
    def start(t: wp.ref[Topology], k: wp.ref[Slot], e: Stencil, b: int, c: int, far: real):
        """Roots and normals of the step itself; component c of its state moved by `far`."""
        for i in range(t.nr):
            k.warm[i] = e.root[b, i]
        for r in range(k.count[wp.static(ROWS)]):
            k.z[r] = k.warm[k.row[r]]
            k.warm[k.row[r]] = UNUSED
        for i in range(t.pairs):
            k.normal[i] = e.normal[b, i]
        if c < t.nv:
            k.q[c] = k.q[c] + far
        elif c < 2 * t.nv:
            k.v0[c - t.nv] = k.v0[c - t.nv] + far

    @wp.func
    def add_slope(t: wp.ref[Topology], d: Slopes, e: Stencil, b: int, first: int, weight: real):
        for j in range(t.nv):
            value = d.found[b, place(t, j)]
            for lane in range(COUNT):
                column = first + lane
                if column < 2 * t.nv + t.nu:
                    e.bend[b, j, column] = e.bend[b, j, column] + weight * value[lane]

    @wp.func
    def clear(fzz: wp.array4d(dtype=given), item: int):
        if fzz.shape[0] > 0:
            for i in range(fzz.shape[1]):
                for r in range(fzz.shape[2]):
                    for j in range(fzz.shape[3]):
                        fzz[item, i, r, j] = given(ZERO)

    @wp.func
    def add_second(fzz: wp.array3d(dtype=given), e: Stencil, b: int, c: int):
        """Half of the slopes by component c to row and half to column c; no slopes any more."""
        for i in range(fzz.shape[0]):
            for j in range(fzz.shape[1]):
                value = given(HALF * e.bend[b, i, j])
                fzz[i, c, j] = fzz[i, c, j] + value
                fzz[i, j, c] = fzz[i, j, c] + value
                e.bend[b, i, j] = ZERO

    return SimpleNamespace(
        measure=measure, stencil=stencil, start=start, add_slope=add_slope, add_second=add_second, clear=clear
    )


@cached
def make_differentiate(given: type, residual: str) -> wp.Function:
    """differentiate(t, k, g, d, e, b, second, x, u, external, world, a, c, fzz, item) -> status: A and B of a
    step into a and c and, with `second` = 1, its second derivatives into fzz[item].
    """
    expansion, writer = make_expansion(given, residual), make_writer(given)
    diff = make_differences(given, residual)
    COUNT, ZERO = LANES, WORK(0.0)

    @wp.func
    def differentiate(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        g: Groups,
        d: Slopes,
        e: Stencil,
        b: int,
        second: int,
        x: wp.array(dtype=given),
        u: wp.array(dtype=given),
        external: wp.array2d(dtype=given),
        world: int,
        a: wp.array2d(dtype=given),
        c: wp.array2d(dtype=given),
        fzz: wp.array4d(dtype=given),
        item: int,
    ):
        width = 2 * t.nv + t.nu
        diff.clear(fzz, item)
        status = int(wp.static(SOLVED))
        move = int(0)
        while move <= 4 * second * width:  # 0: the step itself; then one of (x, u) at +1, -1, +2, -2
            one = (move - 1) / 4
            kind = move - 1 - 4 * one
            times, weight = diff.stencil(kind)
            far = ZERO
            writer.take(t, k, b, x)
            if move > 0:
                far = times * e.size[b, one]
                weight = weight / e.size[b, one]
                diff.start(t, k, e, b, one, far)
            code = expansion.solve(t, k, d, b, u, one - 2 * t.nv, far, external, world)
            if move == 0:
                status = code
                if second == 1:
                    diff.measure(t, k, e, b)
            if code != wp.static(SOLVED):
                diff.clear(fzz, item)
                return status
            n, pairs = expansion.prepare(t, k, g, d, b, external, world)
            for part in range((width + COUNT - 1) / COUNT):
                if expansion.columns(t, k, g, d, b, n, pairs, part * COUNT) == 0:
                    diff.clear(fzz, item)
                    if move > 0:
                        return status
                    writer.clear(a, c)
                    return int(wp.static(NOT_CONVERGED))
                if move == 0:
                    writer.write(t, d, k, b, part * COUNT, a, c)
                else:
                    diff.add_slope(t, d, e, b, part * COUNT, weight)
            if kind == 3 and move > 0:
                diff.add_second(fzz[item], e, b, one)
            move += 1
        return status

    return differentiate


@cached
def make_linearize_kernel(given: type, residual: str) -> wp.Kernel:
    """As `derivatives/expansion.py` has it, with second derivatives where asked for. Item i is part i mod P
    of problem i div P, `run` consecutive steps (P of them make up N), each of which starts from the roots of
    the one before; item - base is the slot.
    """
    expansion, differentiate = make_expansion(given, residual), make_differentiate(given, residual)

    @packed
    def generic_linearize_kernel(
        first: int,
        base: int,
        second: int,  # 1: second derivatives, too
        run: int,
        t: Topology,
        work: Work,
        g: Groups,
        d: Slopes,
        e: Stencil,
        params: wp.array2d(dtype=given),
        steps: int,
        xs: wp.array3d(dtype=given),  # (B, >= N, nx)
        us: wp.array3d(dtype=given),  # (B, N, nu)
        external: wp.array2d(dtype=given),  # (0 or B, 3 nb)
        active: wp.array(dtype=wp.int32),  # (0 or B,) zero: skip the problem
        fx: wp.array4d(dtype=given),  # out (B, N, nx, nx)
        fu: wp.array4d(dtype=given),  # out (B, N, nx, nu)
        fzz: wp.array4d(dtype=given),  # out (B N, nv, nz, nz) or empty
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
                e,
                b,
                second,
                xs[i, n],
                us[i, n],
                external,
                i,
                fx[i, n],
                fu[i, n],
                fzz,
                i * steps + n,
            )
            status[i, n] = code

    return generic_linearize_kernel
