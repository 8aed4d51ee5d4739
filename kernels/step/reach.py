"""Which rows a velocity brings within reach: a pass over limits and pairs.

A pair's distance and rows are computed when its lower bound of the distance no longer says that it cannot
act, and then kept for the step.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.acting import make_acting, rows_of_pairs
from ..contact.apart import LARGE
from ..contact.rows import make_pair_jacobian, make_rows
from ..contact.shapes import make_pair
from ..factories import cached
from ..residual.noise import make_noise
from ..solvers.law import law_of
from ..specialisation import Specialisation
from ..structure import layout
from .solution import make_solution

AFTER = 2  # of `exact_gap`: distances are completed once a step is solved, which they change no bit of


@cached
def make_reach(spec: Specialisation, exact_gap: int) -> SimpleNamespace:
    """The struct `Reach`; begin(world, q, normal) -> Reach, no pairs; look(world, fr, v, reach)
    -> Reach with the rows that v brings within reach in its mask; complete(world, fr, reach)
    -> Reach with the distances of the other pairs.
    """
    s, dtype, method = spec
    rows, noise, law = make_rows(spec), make_noise(spec), law_of(method, s.nr)
    acting = make_acting(spec, exact_gap == 1 or law.whole)
    solution = make_solution(s, dtype)
    t, VN = solution.types, solution.VN
    VQ, VR, JR, V2 = t.VQ, t.VR, t.JR, t.V2
    NR, NP = s.nr, len(s.pairs)
    ALL = (1 << NR) - 1
    ONE = dtype(1.0)
    H, FRICTION = layout(s).offset("step_size"), layout(s).offset("friction")
    judged = tuple(k for k in range(NP) if law.hides and s.pairs[k].friction)  # by `contact/apart.py`
    pairs = tuple(make_pair(s, k, dtype) for k in range(NP))
    geometries = tuple(pair.local_geometry if method.fast else pair.geometry for pair in pairs)
    pair_jacobians = tuple(make_pair_jacobian(s, k, dtype) for k in range(NP))
    pair_rows = rows_of_pairs(s)
    pair_bit = tuple(1 << k for k in range(NP))

    @wp.struct
    class Reach:
        mask: int  # bit i: row i is in the system
        known: int  # bit k: pair k has its rows
        wanted: int  # bit k: pair k gets its rows whatever its bound says
        jac: JR
        rate: VR  # d/h
        bent: VR  # what a row has beside it (`end_gap.py`)
        sigma: VR  # noise levels, where they depend on the state
        normal: VN
        lost: int  # 1: a pair's distance takes a search, or its friction a judge, that others have

    def make_deviation(i: int) -> wp.Function:
        @wp.func
        def deviation(world: t.World, jac: JR):
            # sigma_i, eq. (18)
            j = wp.static(rows.adds[i])(VQ(), jac, ONE)
            return noise.deviation(wp.dot(j, noise.spread(world, j)))

        return deviation

    deviations = tuple(make_deviation(i) for i in range(NR))

    @wp.func
    def begin(world: t.World, q: VQ, normal: VN):
        out = Reach()
        out.rate = wp.static(rows.limit_rates)(world, q)
        out.normal = normal
        if wp.static(method.state_noise):
            for i in range(wp.static(NR)):
                if wp.static(rows.limit[i]):
                    out.sigma[i] = wp.static(deviations[i])(world, out.jac)
        return out

    @wp.func
    def rates(rate: VR, bent: VR):
        # d/h as the rows have it
        out = rate
        if wp.static(method.end_gap):
            out += bent
        return out

    @wp.func
    def look(world: t.World, fr: t.FRAMES, v: VQ, reach: Reach):
        out = reach
        rate = rates(reach.rate, reach.bent)
        out.mask = wp.static(acting.limits)(world, rate, out.jac, out.sigma, v, out.mask)
        for k in range(wp.static(NP)):
            if (out.known & wp.static(pair_bit[k])) == 0:
                wanted = (out.wanted & wp.static(pair_bit[k])) != 0
                if wanted or wp.static(acting.near[k])(world, fr, v):
                    warm = V2(out.normal[wp.static(2 * k)], out.normal[wp.static(2 * k + 1)])
                    g = wp.static(geometries[k])(world, fr, warm)
                    if wp.static(method.fast):
                        if g[0] == dtype(0.0) and g[1] == dtype(0.0):
                            out.lost = 1
                        if wp.static(k in judged):
                            if world.params[wp.static(FRICTION + k)] > dtype(LARGE):
                                out.lost = 1
                    out.known = out.known | wp.static(pair_bit[k])
                    out.normal[wp.static(2 * k)] = g[0]
                    out.normal[wp.static(2 * k + 1)] = g[1]
                    pair_jac = wp.static(pair_jacobians[k])(world, fr, g)
                    out.jac = wp.static(rows.put_pairs[k])(world, pair_jac, out.jac)
                    for i in range(wp.static(NR)):
                        if wp.static(i in pair_rows[k] and not rows.tangent[i]):
                            rate[i] = g[2] / world.params[wp.static(H)]
                            out.rate[i] = rate[i]
                            if wp.static(method.state_noise):
                                out.sigma[i] = wp.static(deviations[i])(world, out.jac)
            if (out.known & wp.static(pair_bit[k])) != 0:
                out.mask = wp.static(acting.contacts[k])(world, rate, out.jac, out.sigma, v, out.mask)
        if wp.static(law.whole):
            if out.mask != 0:
                out.mask = wp.static(ALL)
        return out

    @wp.func
    def complete(world: t.World, fr: t.FRAMES, reach: Reach):
        out = reach
        for k in range(wp.static(NP)):
            if (out.known & wp.static(pair_bit[k])) == 0:
                warm = V2(out.normal[wp.static(2 * k)], out.normal[wp.static(2 * k + 1)])
                g = wp.static(geometries[k])(world, fr, warm)
                if wp.static(method.fast):
                    if g[0] == dtype(0.0) and g[1] == dtype(0.0):
                        out.lost = 1
                for i in range(wp.static(NR)):
                    if wp.static(i in pair_rows[k] and not rows.tangent[i]):
                        out.rate[i] = g[2] / world.params[wp.static(H)]
        return out

    return SimpleNamespace(
        Reach=Reach, begin=begin, look=look, complete=complete, rates=rates, ALL=ALL, PAIRS=(1 << NP) - 1
    )
