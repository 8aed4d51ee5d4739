"""Hard contact with Coulomb's friction where a single limit or a single pair acts, in closed form.

A row without friction: lambda = max(-w/A, 0) at w = J v_free + d/h. A frictional pair (n, t), A = J M^-1 J':
it sticks where the impulses of w_n = v_t = 0 lie in the cone |lambda_t| <= mu lambda_n, else it slides with
lambda_t = +-mu lambda_n against v_t (the paper's [8] in the plane). A pair whose rows are parallel (a guide
that leaves one direction only) can but slide: no two velocities are to be had from one.
"""

import warp as wp

from ..contact.problem import make_problem
from ..contact.rows import make_rows
from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout
from .few_rows import LARGEST

ACCEPT = {wp.float64: 3e-12, wp.float32: 1e-5}  # of the natural map, relative to J v_free and d/h


@cached
def make_cone(dtype: type) -> wp.Function:
    """cone(mu, A_nn, A_nt, A_tt, w_n, w_t) -> (lambda_n, lambda_t) of a pair alone."""
    V2 = wp.types.vector(2, dtype)
    ZERO = dtype(0.0)
    RANK = dtype(1e-14 if dtype is wp.float64 else 1e-6)

    @wp.func
    def cone(mu: dtype, ann: dtype, ant: dtype, att: dtype, bn: dtype, bt: dtype):
        """(lambda_n, lambda_t) of a pair."""
        out = V2()
        if bn < ZERO:
            det = ann * att - ant * ant
            along = ant * bn - ann * bt
            out[0] = (ant * bt - att * bn) / det
            out[1] = along / det
            sticks = det > RANK * ann * att and out[0] > ZERO and wp.abs(out[1]) <= mu * out[0]
            if not sticks:
                slide = wp.where(along > ZERO, mu, -mu)
                if not (ann + slide * ant > ZERO):
                    slide = -slide
                out[0] = -bn / (ann + slide * ant)
                out[1] = slide * out[0]
        return out

    return cone


@cached
def make_alone(spec: Specialisation) -> wp.Function:
    """alone(world, problem) -> v', z, lambda, found: 1 where the mask is a single limit or pair and the
    natural map of what is returned vanishes, on the scale of J v_free and d/h. Painleve's cases, impulses
    that are large against each other and rows that no impulse moves are left to others.
    """
    s, dtype, _ = spec
    r = make_rows(spec)
    VR, World, Problem = r.types.VR, r.types.World, make_problem(s, dtype)
    cone = make_cone(dtype)
    ZERO, SMALLEST = dtype(0.0), dtype(1e-30)
    ENOUGH, CANCEL = dtype(ACCEPT[dtype]), dtype(LARGEST)
    FRICTION = layout(s).offset("friction")
    frictional = tuple(row.kind == "contact" and row.sign > 0 for row in s.rows)
    pair = tuple(row.index if row.kind == "contact" else 0 for row in s.rows)

    def make_pair(i: int) -> wp.Function:
        @wp.func
        def of_pair(world: World, p: Problem):
            # found: 1 where it sticks or slides against v_t, or separates
            size_n = wp.abs(p.rate[wp.static(i)])
            size_t = ZERO
            for j in range(wp.static(s.nv)):
                size_n += wp.abs(p.jac[wp.static(i), j] * p.vfree[j])
                size_t += wp.abs(p.jac[wp.static(i + 1), j] * p.vfree[j])
            size = wp.max(size_n, size_t)
            gn = wp.static(r.applies[i])(p.minv, p.jac)
            gt = wp.static(r.applies[i + 1])(p.minv, p.jac)
            ann = wp.max(wp.static(r.dots[i])(p.jac, gn), SMALLEST)
            att = wp.max(wp.static(r.dots[i + 1])(p.jac, gt), SMALLEST)
            ant = wp.static(r.dots[i])(p.jac, gt)
            bn = wp.static(r.dots[i])(p.jac, p.vfree) + p.rate[wp.static(i)]
            bt = wp.static(r.dots[i + 1])(p.jac, p.vfree)
            mu = world.params[wp.static(FRICTION + pair[i])]
            lam = cone(mu, ann, ant, att, bn, bt)
            wn = bn + ann * lam[0] + ant * lam[1]
            vt = bt + ant * lam[0] + att * lam[1]
            lam_out = VR()
            z_out = VR()
            lam_out[wp.static(i)] = lam[0]
            lam_out[wp.static(i + 1)] = lam[1]
            z_out[wp.static(i)] = ann * lam[0] - wn
            z_out[wp.static(i + 1)] = att * lam[1] - vt
            bound = att * mu * lam[0]
            miss = wp.abs(wp.min(ann * lam[0], wn))
            miss = wp.max(miss, wp.abs(att * lam[1] - wp.clamp(att * lam[1] - vt, -bound, bound)))
            total = wp.max(ann * lam[0] + wp.abs(ant * lam[1]), wp.abs(ant) * lam[0] + att * wp.abs(lam[1]))
            finite = wp.isfinite(bn) and wp.isfinite(wn) and wp.isfinite(vt)  # a max drops a NaN
            holds = miss <= ENOUGH * size and total <= CANCEL * size
            found = wp.where(finite and ann > SMALLEST and holds, 1, 0)
            return p.vfree + lam[0] * gn + lam[1] * gt, z_out, lam_out, found

        return of_pair

    def make_row(i: int) -> wp.Function:
        @wp.func
        def of_row(world: World, p: Problem):
            g = wp.static(r.applies[i])(p.minv, p.jac)
            a = wp.max(wp.static(r.dots[i])(p.jac, g), SMALLEST)
            b = wp.static(r.dots[i])(p.jac, p.vfree) + p.rate[wp.static(i)]
            lam_out = VR()
            z_out = VR()
            lam_out[wp.static(i)] = wp.max(-b / a, ZERO)
            z_out[wp.static(i)] = -b
            found = wp.where(wp.isfinite(b) and a > SMALLEST, 1, 0)
            return p.vfree + lam_out[wp.static(i)] * g, z_out, lam_out, found

        return of_row

    single = tuple(
        None if r.tangent[i] else (make_pair if frictional[i] else make_row)(i) for i in range(s.nr)
    )
    bits = tuple((3 if frictional[i] else 1) << i for i in range(s.nr))

    @wp.func
    def alone(world: World, p: Problem):
        v = p.vfree
        z = VR()
        lam = VR()
        found = int(0)
        for i in range(wp.static(s.nr)):
            if wp.static(single[i] is not None):
                if p.mask == wp.static(bits[i]):
                    v, z, lam, found = wp.static(single[i])(world, p)
        return v, z, lam, found

    return alone
