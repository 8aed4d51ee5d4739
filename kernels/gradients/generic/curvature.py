"""Second derivatives of the generic step: of every output, or of the next state as it is weighed."""

import warp as wp

from ...device.compile import of_any_scene
from ...factories import cached
from ...generic.derivatives.expansion import make_expansion
from ...generic.derivatives.linearize import make_writer
from ...generic.derivatives.tables import Groups
from ...generic.topology import Topology
from ...generic.work import LANES, WORK, Slot, Work, view
from ...status import NOT_CONVERGED, SOLVED
from .curves import Curves
from .hessian import make_hessian
from .leap import make_leap
from .room import OLD, Room, View, view_of


@cached
def make_curvature_kernel(given: type, residual: str) -> wp.Kernel:
    """As `make_linearize_kernel`, with second derivatives of v' by its dofs or, where there are weights, of
    the next state weighed by them. A step whose second derivatives have no digits has none: zeros, and
    NOT_CONVERGED.
    """
    expansion, writer, of = make_expansion(given, residual), make_writer(given), make_hessian(given, residual)
    leap = make_leap(given, False)
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
    def write(e: Curves, b: int, out: wp.array2d(dtype=given), holds: int, more: int):
        """e.found, or nothing where it does not hold; `more`: added to what is there."""
        for i in range(out.shape[0]):
            for j in range(out.shape[1]):
                before = wp.where(more == 1 and holds == 1, out[i, j], given(ZERO))
                out[i, j] = before + given(wp.where(holds == 1, e.found[b, i, j], ZERO))

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
        pairs: int, keeps: int, leaps: int, writes: int, a: wp.array2d(dtype=given),
        c: wp.array2d(dtype=given),
    ):  # fmt: skip
        """A and B where there is room for them, kept in e; 1 if they hold."""
        width = 2 * t.nv + t.nu
        for part in range((width + LANES - 1) / LANES):
            first = part * LANES
            if expansion.columns(t, k, g, room.factor, b, n, pairs, first, leaps) == 0:
                writer.clear(a, c)
                return int(0)
            if a.shape[0] > 0 and writes == 1:
                writer.write(t, room.factor, k, b, first, a, c)
            if keeps > 0:
                of.keep(t, k, g, room.factor, e, b, n, first)
        return int(1)

    @wp.func
    def weigh(
        t: wp.ref[Topology], w: wp.ref[View], weights: wp.array3d(dtype=given), i: int, n: int, output: int
    ):
        """Of the next state, or of one v' alone."""
        if weights.shape[0] == 0:
            choose(t, w, output)
        else:
            for j in range(2 * t.nv):
                w.weight[j] = WORK(weights[i, n + 1, j])

    @wp.func
    def of_output(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, room: wp.ref[Room], w: wp.ref[View], e: Curves,
        b: int, n: int, external: wp.array2d(dtype=given), i: int, output: int,
        second: wp.array3d(dtype=given), code: int,
    ):  # fmt: skip
        """Those of an output that is weighed, of a leapfrog without its prediction's; the status."""
        holds = int(0)
        if code == wp.static(SOLVED):
            holds = of.hessian(t, k, g, room, w, e, b, n, external, i, t.leapfrog)
        write(e, b, second[output], holds, 0)
        if t.leapfrog == 1:
            for j in range(t.nv):
                e.lead[b, output, j] = w.by_lead[j]
        return wp.where(holds == 1 or code != wp.static(SOLVED), code, wp.static(NOT_CONVERGED))

    @wp.func
    def lead(t: wp.ref[Topology], w: wp.ref[View], e: Curves, b: int, output: int):
        """Of what the leapfrog predicts, by the slopes that an output has by it."""
        for j in range(t.nv):
            w.weight[j] = ZERO
            w.weight[t.nv + j] = e.lead[b, output, j]

    @wp.func(inline=False)
    def of_predicted(
        t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, room: wp.ref[Room], w: wp.ref[View], e: Curves,
        b: int, u: wp.array(dtype=given), external: wp.array2d(dtype=given), i: int,
        a: wp.array2d(dtype=given), c: wp.array2d(dtype=given), second: wp.array3d(dtype=given),
    ):  # fmt: skip
        """Adds what second derivatives of the leapfrog's prediction bring to all outputs; the status."""
        for j in range(t.nv):
            k.q[j] = w.q[j]
            k.v0[j] = w.rates[wp.static(OLD) * t.nv + j]
        if expansion.euler(t, k, u, external, i) != wp.static(SOLVED):
            return int(wp.static(NOT_CONVERGED))
        if leap.same(t, k) == 0:
            return int(wp.static(NOT_CONVERGED))
        n, pairs = expansion.prepare(t, k, g, room.factor, b, external, i, 0)
        if first_order(t, k, g, room, e, b, n, pairs, 1, 0, 0, a, c) == 0:
            return int(wp.static(NOT_CONVERGED))
        for output in range(second.shape[0]):
            lead(t, w, e, b, output)
            if of.hessian(t, k, g, room, w, e, b, n, external, i, 0) == 0:
                return int(wp.static(NOT_CONVERGED))
            write(e, b, second[output], 1, 1)
        return int(wp.static(SOLVED))

    @of_any_scene(residual != "none")
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
            code = expansion.solve(t, k, g, room.factor, b, us[i, n], external, i)
            rows = int(0)
            if code == wp.static(SOLVED):
                acting, pairs = expansion.prepare(t, k, g, room.factor, b, external, i, t.leapfrog)
                rows = acting
                a, c = fx[at * i, at * n], fu[at * i, at * n]
                if first_order(t, k, g, room, e, b, rows, pairs, second.shape[1], t.leapfrog, 1, a, c) == 0:
                    code = wp.static(NOT_CONVERGED)
            for output in range(second.shape[1]):
                weigh(t, w, weights, i, n, output)
                code = of_output(
                    t, k, g, room, w, e, b, rows, external, i, output, second[i * steps + n], code
                )
            if t.leapfrog == 1 and code == wp.static(SOLVED) and second.shape[1] > 0:
                a, c = fx[at * i, at * n], fu[at * i, at * n]
                code = of_predicted(
                    t, k, g, room, w, e, b, us[i, n], external, i, a, c, second[i * steps + n]
                )
            if code == wp.static(NOT_CONVERGED) and second.shape[1] > 0:
                clear(fx, fu, second, i, n, steps, weighed)
            status[i, n] = code

    return generic_curvature_kernel
