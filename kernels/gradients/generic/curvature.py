"""Second derivatives of the generic step: of every output, or of the next state as it is weighed."""

import warp as wp

from ...device.compile import packed
from ...factories import cached
from ...generic.derivatives.expansion import make_expansion
from ...generic.derivatives.linearize import make_writer
from ...generic.derivatives.tables import Groups
from ...generic.topology import Topology
from ...generic.work import LANES, WORK, Slot, Work, view
from ...status import NOT_CONVERGED, SOLVED
from .curves import Curves
from .hessian import make_hessian
from .room import OLD, Room, View, view_of


@cached
def make_curvature_kernel(given: type, residual: str) -> wp.Kernel:
    """As `make_linearize_kernel`, with second derivatives of v' by its dofs or, where there are weights, of
    the next state weighed by them. A step whose second derivatives have no digits has none: zeros, and
    NOT_CONVERGED.
    """
    expansion, writer, of = make_expansion(given, residual), make_writer(given), make_hessian(given, residual)
    ZERO, ONE = WORK(0.0), WORK(1.0)

    @wp.func
    def remember(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        """q and v before the step."""
        for j in range(t.nv):
            w.q[j] = k.q[j]
            w.rates[wp.static(OLD) * t.nv + j] = k.v0[j]

    @wp.func
    def choose(t: wp.ref[Topology], w: wp.ref[View], output: int):
        """Weights of one v' alone."""
        for j in range(2 * t.nv):
            w.weight[j] = wp.where(j == t.nv + output, ONE, ZERO)

    @wp.func
    def write(e: Curves, b: int, out: wp.array2d(dtype=given), holds: int):
        for i in range(out.shape[0]):
            for j in range(out.shape[1]):
                out[i, j] = given(wp.where(holds == 1, e.found[b, i, j], ZERO))

    @wp.func
    def clear(
        fx: wp.array4d(dtype=given), fu: wp.array4d(dtype=given), second: wp.array4d(dtype=given), i: int,
        n: int, steps: int, weighed: bool,
    ):  # fmt: skip
        """No derivatives of a step some of which have no digits."""
        if not weighed:
            writer.clear(fx[i, n], fu[i, n])
        for output in range(second.shape[1]):
            for r in range(second.shape[2]):
                for c in range(second.shape[3]):
                    second[i * steps + n, output, r, c] = given(ZERO)

    @wp.func
    def first_order(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, room: wp.ref[Room], e: Curves, b: int, n: int,
        pairs: int, keeps: int, a: wp.array2d(dtype=given), c: wp.array2d(dtype=given),
    ):  # fmt: skip
        """A and B where there is room for them, kept in e; 1 if they hold."""
        width = 2 * t.nv + t.nu
        for part in range((width + LANES - 1) / LANES):
            first = part * LANES
            if expansion.columns(t, k, g, room.factor, b, n, pairs, first) == 0:
                writer.clear(a, c)
                return int(0)
            if a.shape[0] > 0:
                writer.write(t, room.factor, k, b, first, a, c)
            if keeps > 0:
                of.keep(t, k, g, room.factor, e, b, n, first)
        return int(1)

    @packed
    def generic_curvature_kernel(
        first: int,
        base: int,
        run: int,
        t: Topology,
        work: Work,
        g: Groups,
        room: Room,  # its factor is that of the first-order expansion, whole
        e: Curves,  # no slots where `second` has no outputs
        params: wp.array2d(dtype=given),
        steps: int,
        xs: wp.array3d(dtype=given),  # (B, >= N, nx)
        us: wp.array3d(dtype=given),  # (B, N, nu)
        external: wp.array2d(dtype=given),  # (0 or B, 3 nb)
        active: wp.array(dtype=wp.int32),  # (0 or B,) zero: skip the problem
        weights: wp.array3d(dtype=given),  # (0 or B, N+1, nx)
        fx: wp.array4d(dtype=given),  # out (B, N, nx, nx), empty with weights
        fu: wp.array4d(dtype=given),  # out (B, N, nx, nu), empty with weights
        second: wp.array4d(dtype=given),  # out (B N, nv, n_s, n_s), with weights (B N, 1, n_s, n_s)
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
        w = view_of(room, b)
        code = int(1)
        weighed = weights.shape[0] > 0
        at = wp.where(weighed, 0, 1)  # with weights there is room for one A and B, of no size
        for n in range(begin, wp.min(begin + run, steps)):
            if code != wp.static(SOLVED):
                expansion.start(t, k, params, i)
            writer.take(t, k, b, xs[i, n])
            remember(t, k, w)
            code = expansion.solve(t, k, room.factor, b, us[i, n], external, i)
            rows = int(0)
            if code == wp.static(SOLVED):
                acting, pairs = expansion.prepare(t, k, g, room.factor, b, external, i)
                rows = acting
                a, c = fx[at * i, at * n], fu[at * i, at * n]
                if first_order(t, k, g, room, e, b, rows, pairs, second.shape[1], a, c) == 0:
                    code = wp.static(NOT_CONVERGED)
            for output in range(second.shape[1]):
                if weighed:
                    for j in range(2 * t.nv):
                        w.weight[j] = WORK(weights[i, n + 1, j])
                else:
                    choose(t, w, output)
                holds = int(0)
                if code == wp.static(SOLVED):
                    holds = of.hessian(t, k, g, room, w, e, b, rows, external, i)
                    code = wp.where(holds == 1, code, wp.static(NOT_CONVERGED))
                write(e, b, second[i * steps + n, output], holds)
            if code == wp.static(NOT_CONVERGED) and second.shape[1] > 0:
                clear(fx, fu, second, i, n, steps, weighed)
            status[i, n] = code

    return generic_curvature_kernel
