"""Whether D = diag(J N^-1 J') of a smoothed law with inertia scaling has the digits that a row is judged by.

With y = N^-1 J_i' a rounding of the entries of N moves D_i = J_i y by up to epsilon |y|' |N| |y|, to first
order, which no refinement takes back. The law is then another row's: D lambda is off by that times lambda,
and w by s'(-z)/s'(z) times as much, next to nothing of a row that presses by many sigma. Hard contact does
not ask for D, and without inertia scaling it is 1. `generic/judge/digits.py` asks the same of D's
solution.
"""

import warp as wp

from ..contact.rows import make_rows
from ..factories import cached
from ..residual.noise import make_noise
from ..residual.smoothing import make_smoothing
from ..specialisation import Specialisation
from .solution import make_solution

EPSILON = {wp.float64: 1.1e-16, wp.float32: 6e-8}
SHARE = 0.5  # of the bound: roundings do not all go one way


@cached
def make_scale_digits(spec: Specialisation) -> wp.Function:
    """loses(world, n, fast, solution, most): whether D lacks more than `most` of a row's terms at velocities
    of size `fast`.
    """
    s, dtype, method = spec
    rows, noise, solution = make_rows(spec), make_noise(spec), make_solution(s, dtype)
    smooth = make_smoothing(dtype, method.residual).smooth
    t, Solution = solution.types, solution.Solution
    ONE, ROUNDING = dtype(1.0), dtype(SHARE * EPSILON[dtype])
    index = tuple(row.index if row.kind == "limit" else 0 for row in s.rows)

    @wp.func
    def loses(world: t.World, n: t.MQ, fast: t.VQ, sol: Solution, most: dtype):
        lost = bool(False)
        for i in range(wp.static(s.nr)):
            if (sol.mask & wp.static(1 << i)) != 0:
                level = wp.static(noise.level[i])(world, sol.sigma)
                terms = wp.abs(sol.rate[i]) + level
                if wp.static(rows.limit[i]):
                    terms += fast[wp.static(index[i])]
                else:
                    terms += wp.dot(wp.abs(sol.jac[i]), fast)
                y = wp.abs(wp.static(rows.applies[i])(sol.minv, sol.jac))
                off = dtype(0.0)
                for j in range(wp.static(s.nv)):
                    for k in range(wp.static(s.nv)):
                        off += y[j] * wp.abs(n[j, k]) * y[k]
                e = smooth(sol.z[i], level, ONE / level)
                hangs = wp.min(ONE, e[3] / e[2])
                lost = lost or ROUNDING * off * sol.lam[i] * hangs > most * terms
        return lost

    return loses
