"""What a row's residual is relative to.

Where all rows are alike, the largest of their terms, |d/h| + |w_0| + |J| |v_free| + sigma: a row that others
press is rounded as they are. Where they are not, what is far away is no measure, nor is the speed of grams on
tonnes: a row is then judged by its own terms, or by what a row does to it that shuts and is stopped by
itself, |J_i M^-1 J_j'| r_j/A_jj, be it on the way over others.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..residual.noise import make_noise
from ..specialisation import Specialisation
from .problem import SMALLEST, make_problem
from .rows import make_rows

# rows whose terms differ by no more are one another's measure: in float64 rounding is far below what counts
ALIKE = {wp.float64: 1e3, wp.float32: 8.0}
ROUNDS = 4  # over all rows; what a row does reaches all later ones in one


@cached
def make_row_sizes(spec: Specialisation) -> SimpleNamespace:
    """Of a measured problem: `uneven`, whether rows may differ, None where they cannot, being of one pair;
    then the `sizes` of rows; whether they are `unlike`, and the size that all are solved relative to.
    """
    s, dtype, method = spec
    r, noise = make_rows(spec), make_noise(spec)
    World, VQ, VR = r.types.World, r.types.VQ, r.types.VR
    Problem = make_problem(s, dtype)
    ZERO, ONE, FLOOR = dtype(0.0), dtype(1.0), dtype(SMALLEST)
    # a tolerance asked for makes float64's acceptance as coarse as float32's
    RANGE = dtype(ALIKE[wp.float32] if method.tolerance else ALIKE[dtype])
    index = tuple(row.index for row in s.rows)

    @wp.func
    def uneven(p: Problem):
        return RANGE * p.least < p.size

    @wp.func
    def terms(world: World, p: Problem):
        out = VR()
        for i in range(wp.static(s.nr)):
            if (p.mask & wp.static(1 << i)) != 0:
                out[i] = wp.abs(p.rate[i]) + wp.abs(p.w0[i])
                if wp.static(not method.hard):
                    out[i] = out[i] + wp.static(noise.level[i])(world, p.sigma)
                if wp.static(r.limit[i]):
                    out[i] = out[i] + wp.abs(p.vfree[wp.static(index[i])])
                else:
                    for j in range(wp.static(s.nv)):
                        out[i] = out[i] + wp.abs(p.jac[i, j] * p.vfree[j])
        return out

    @wp.func(inline=False)
    def sizes(world: World, p: Problem):
        size = terms(world, p)
        reach = VQ()
        left = int(ROUNDS)
        while left > 0:
            left -= 1
            grows = bool(False)
            for i in range(wp.static(s.nr)):
                if (p.mask & wp.static(1 << i)) != 0:
                    moved = wp.dot(wp.abs(wp.static(r.adds[i])(VQ(), p.jac, ONE)), reach)
                    now = wp.min(wp.max(size[i], moved), p.size)
                    grows = grows or now > size[i]
                    size[i] = now
                    shut = moved - p.w0[i]
                    if wp.static(not method.hard):
                        shut = wp.max(shut, ZERO) + wp.static(noise.level[i])(world, p.sigma)
                    if p.diag[i] > FLOOR and shut > ZERO:
                        response = wp.abs(wp.static(r.applies[i])(p.minv, p.jac))
                        reach = wp.max(reach, (wp.min(shut, p.size) * p.inverse_diag[i]) * response)
            if left < wp.static(ROUNDS - 1) and not grows:
                left = int(0)
        return size

    @wp.func(inline=False)
    def unlike(world: World, p: Problem):
        size = sizes(world, p)
        least = p.size
        for i in range(wp.static(s.nr)):
            if (p.mask & wp.static(1 << i)) != 0:
                least = wp.min(least, size[i])
        if RANGE * least < p.size:
            return True, least
        return False, p.size

    differ = len({(row.kind, row.index) for row in s.rows}) > 1
    return SimpleNamespace(uneven=uneven if differ else None, sizes=sizes, unlike=unlike)
