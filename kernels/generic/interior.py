"""Primal and dual interior-point method of the generic kernels.

a = D lambda > 0 and w > 0, a w = m(a - w) + mu, as in `solvers/interior.py`, but v' is an unknown too and
need not balance the impulses before the end. Warm it starts where Newton's method came nearest, with one a w
for all rows; cold with a as large as all momentum of the scene on one row could make it (a hundredth of
that): from small impulses a heap of unequal masses took several times the iterations. A step is aimed at the
mean of a w that the straight one suggests, with what that leaves of a w (Mehrotra).
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from .motion.mechanism import COLUMN
from .newton import law_of, make_newton
from .rows.passes import make_passes
from .topology import CONTACT, Topology
from .work import V3, WORK, Island, Slot

MAX_ITERATIONS = 80
MOMENTUM = 0.01
CENTRE = {
    True: 0.1,
    False: 0.03,
}  # sqrt(a w) of a warm start (hard or not), relative to the size of the problem


@cached
def make_interior(given: type, residual: str) -> SimpleNamespace:
    """Warp functions of an island's iteration: enter, curve, aim, advance, and proves_infeasible."""
    dtype = WORK
    nt = make_newton(given, residual)
    hard = residual == "hard"
    rows = make_passes(law_of(residual))
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    SHARE = dtype(MOMENTUM)
    POSITIVE = dtype(0.01)  # smallest weight, relative to that of the hard problem
    TRUSTED = dtype(0.8)  # length of a straight step whose second order is believed
    MEAN = dtype(CENTRE[hard])
    FARTHEST_Z = dtype(10.0)  # of a warm start, relative to the size of the problem
    NEAREST, CLOSE = dtype(1e-6), dtype(0.005)  # kept of the way to the boundary
    CAREFUL, FARTHEST = dtype(1e-3), dtype(0.1)  # where that failed
    TINY = dtype(1e-30)
    HALF_ULP, LENGTHS = dtype(2.0**-24), dtype(6.0)  # of float32; of two centres, and of two sizes twice
    RADIUS, H = COLUMN["radius"], COLUMN["step_size"]
    DIVERGED = dtype(1e12)
    FASTEST = dtype(1e6)  # V, relative to the size of the problem and to v_free

    @wp.func(inline=False)
    def curve(k: wp.ref[Slot], o: Island, n: dtype):
        """Excess and weights of every acting row; mean |excess|."""
        sum = wp.static(rows.curve)(
            o.row, o.last_row, k.acting, POSITIVE, k.sigma, k.a, k.w, k.excess, k.cross, k.p, k.slack, k.total
        )
        return sum / n

    @wp.func(inline=False)
    def mean_after(k: wp.ref[Slot], o: Island, n: dtype, step: dtype, cold: int):
        """Mean |excess| after the straight step (mu = 0); k.cross: the excess after all of it."""
        kept = dtype(0.0)
        if cold == 0:
            kept = wp.where(step > TRUSTED, ONE, step * step)
        sum = wp.static(rows.look_ahead)(
            o.row, o.last_row, k.acting, step, kept, k.sigma, k.dz, k.aimed, k.a, k.w, k.cross, k.p, k.slack
        )
        return sum / n

    @wp.func
    def rounding(t: wp.ref[Topology], k: wp.ref[Slot]):
        """What `told` of `contact/shapes.py` may have taken of any d/h, at most."""
        largest = dtype(0.0)
        for i in range(t.shapes):
            p = k.shape[i]
            at = t.columns[RADIUS] + 2 * i
            largest = wp.max(largest, wp.abs(p[0]) + wp.abs(p[1]))
            largest = wp.max(largest, wp.max(k.numbers[at], k.numbers[at + 1]))
        return HALF_ULP * LENGTHS * largest / k.numbers[t.columns[H]]

    @wp.func(inline=False)
    def proves_infeasible(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype):
        """Farkas: lambda >= 0 and -lambda . d/h > |J' lambda| . V prove that no |v'| <= V opens the rows,
        whatever the gaps are within rounding.
        """
        rounds = dtype(0.0)
        if wp.static(given is wp.float32):
            rounds = rounding(t, k)
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        work = dtype(0.0)
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
            if k.acting[r] > 0:
                work -= k.lam[r] * k.rate[r]
                if t.row_kind[k.row[r]] == CONTACT:
                    work -= k.lam[r] * rounds
                k.weight[r] = k.lam[r]
        nt.add_pushes(t, k, o)
        most = dtype(0.0)
        for place in range(o.start, o.end):
            i = k.block[place]
            free = wp.abs(k.vfree[i])
            most += wp.dot(wp.abs(k.move[i]), wp.max(V3(size, size, size), free))
        return work > most * FASTEST

    @wp.func
    def centre(k: wp.ref[Slot], o: Island, size: dtype):
        """a and w to start from where Newton's method came nearest: a - w = z, a w the same of all rows
        beyond what the curve asks for. The largest a.
        """
        largest = dtype(0.0)
        mu = MEAN * size * MEAN * size
        for r in range(o.row, o.last_row):
            k.least[r] = ZERO
            if k.acting[r] > 0:
                z = wp.clamp(k.z[r], -FARTHEST_Z * size, FARTHEST_Z * size)
                on = nt.smooth(k, r, z)
                tail = wp.min(on[0], on[1])
                big = HALF * (wp.abs(z) + wp.sqrt(z * z + (ONE + ONE) * (ONE + ONE) * mu))
                small = mu / big + tail
                big += tail
                k.a[r] = wp.where(z > ZERO, big, small)
                k.w[r] = wp.where(z > ZERO, small, big)
                largest = wp.max(largest, big)
        return largest

    @wp.func
    def from_afar(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype, yielding: dtype):
        """v', a and w to start from where nothing is known; the largest a."""
        momentum = dtype(0.0)
        for place in range(o.start, o.end):
            i = k.block[place]
            k.v[i] = k.vfree[i]
            momentum += wp.dot(wp.get_diag(k.mass[t.mass_at[i] + i]), wp.abs(k.vfree[i]))
        largest = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                w = k.rate[r] - yielding * k.diag[r] * k.least[r] + nt.dot(t, k, k.v, r)
                alone = nt.smooth(k, r, -w)
                k.a[r] = alone[0] + size + SHARE * k.scale[r] * momentum
                k.w[r] = alone[1] + size
                largest = wp.max(largest, k.a[r])
        return largest

    @wp.func(inline=False)
    def enter(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype, yielding: dtype, cold: int):
        """v', and a, w > 0 to start from; the largest a that does not count as diverged."""
        if cold == 0:
            return DIVERGED * (centre(k, o, size) + size)
        return DIVERGED * (from_afar(t, k, o, size, yielding) + size)

    @wp.func
    def aim(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        o: Island,
        inside: int,
        n: dtype,
        size: dtype,
        yielding: dtype,
        mean: dtype,
        cold: int,
    ):
        """The step from here; of the interior-point method straight first, then towards the mu that this
        suggests: warm, with what is left of the second order (Mehrotra's corrector is bold in a heap of very
        unequal masses). The step's length.
        """
        mu = dtype(0.0)
        kept = dtype(0.0)
        step = dtype(1.0)
        looking = int(inside)
        more = int(1)
        while more == 1:
            fall = nt.direction(t, k, o, mu, inside, yielding)
            more = int(0)
            if inside == 1:
                step = wp.min((ONE - kept) / wp.max(fall, TINY), ONE)
            if looking == 1:
                looking = 0
                more = 1
                part = mean_after(k, o, n, step, cold) / mean
                mu = wp.min(part * part * part, HALF) * mean  # never all of it, or short steps stall
                kept = wp.sqrt(mean) / size
                if cold == 1:
                    kept = wp.clamp(kept, CAREFUL, FARTHEST)
                else:
                    kept = wp.clamp(kept, NEAREST, CLOSE)
        return step

    @wp.func(inline=False)
    def advance(k: wp.ref[Slot], o: Island, n: dtype, inside: int, step: dtype):
        """Make the step; inside with what `curve` finds there, whose mean is given back."""
        for place in range(o.start, o.end):
            i = k.block[place]
            k.v[i] = k.v[i] + step * k.move[i]
        if inside == 1:
            sum = wp.static(rows.advance)(
                o.row, o.last_row, k.acting, step, POSITIVE, k.sigma, k.dz, k.aimed, k.a, k.w, k.excess,
                k.cross, k.p, k.slack, k.total,
            )  # fmt: skip
            return sum / n
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.z[r] = k.z[r] + k.dz[r]
        return ZERO

    return SimpleNamespace(
        enter=enter, curve=curve, aim=aim, advance=advance, proves_infeasible=proves_infeasible
    )
