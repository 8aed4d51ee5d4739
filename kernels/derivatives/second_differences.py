"""Second derivatives of the step as central differences of its exact first derivatives, in double precision.

For every method without closed second derivatives (`in_closed_form`). Of each of z = (q, v, u) in turn the
Jacobian is taken at +-e and +-2e, (8 (J(e) - J(-e)) - (J(2e) - J(-2e))) / 12e (M30), an error of e^4. What
limits e is the smoothing, which a velocity w of the size of sigma passes: e is a part REACH of sigma for
velocities, of h sigma for positions, and for controls of what changes a velocity by sigma. A world with a
perturbed step that is not solved gets zero second derivatives (a Gauss-Newton step there).

Cost: 1 + 4 nz steps with their first derivatives, in float64 whatever the dtype of the arrays.
"""

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from ..mechanism.tendons import make_drive
from ..residual.smoothing import HARD_LAYER, LARGEST_LAYER, REACH
from ..specialisation import Specialisation
from ..status import NOT_CONVERGED, SOLVED
from ..step.rollout import make_batch
from ..structure import layout
from .sensitivity import make_linearization


@cached
def make_difference_kernel(spec: Specialisation) -> wp.Kernel:
    """As `expansion.make_linearize_kernel` with second derivatives, but params and external in float64.

    fzz holds the curved outputs: those of v', or (v*, v') where positions move with another velocity v*.
    """
    s, dtype, method = spec
    real = wp.float64
    exact = spec._replace(dtype=real)
    linear = make_linearization(exact)
    step = linear.step
    batch = make_batch(exact, False)
    NV, NX, NU, NR, NZ = s.nv, 2 * s.nv, s.nu, s.nr, linear.NZ
    NW = 2 * NV if method.trapezoidal else NV
    drives, VQ = tuple(make_drive(s, j, real) for j in range(s.nu)), step.types.VQ
    VX, VU, VZ = step.types.VX, step.types.VU, wp.types.vector(linear.NZ, real)
    DV, DW = linear.DV, wp.types.matrix((NW, NZ), real)
    ZERO, HALF, ONE, TWO, EIGHT, TWELVE = (real(x) for x in (0.0, 0.5, 1.0, 2.0, 8.0, 12.0))
    PART, LARGEST = real(REACH), real(LARGEST_LAYER)
    H, GEAR = layout(s).offset("step_size"), layout(s).offset("gear")

    @wp.func
    def steps_of(world: step.types.World, sol: step.Solution):
        """Size of the differences in every component of z."""
        layer = LARGEST
        if wp.static(method.hard):
            layer = real(wp.static(HARD_LAYER))
        else:
            for i in range(wp.static(NR)):
                if (sol.mask & wp.static(1 << i)) != 0:
                    layer = wp.min(layer, wp.static(step.noise.level[i])(world, sol.sigma))
        out = VZ()
        h = world.params[wp.static(H)]
        for j in range(wp.static(NV)):
            out[j] = PART * h * layer
            out[wp.static(NV + j)] = PART * layer
        for j in range(wp.static(NU)):
            push = wp.static(drives[j].push)(world, world.params[wp.static(GEAR + j)] * h, VQ())
            reaction = real(0.0)
            for a in range(wp.static(NV)):
                if wp.static(a in s.driven(j)):
                    reaction += wp.abs(push[a]) * sol.minv[a, a]
            out[wp.static(NX + j)] = PART * wp.min(layer / wp.max(reaction, real(1e-6)), ONE)
        return out

    @wp.func
    def outputs(dv: DV, drift: DV):
        out = DW()
        for i in range(wp.static(NV)):
            for j in range(wp.static(NZ)):
                if wp.static(method.trapezoidal):
                    out[i, j] = drift[i, j]
                out[wp.static(NW - NV + i), j] = dv[i, j]
        return out

    @wp.func
    def stencil(kind: int):
        """Of the points at +1, -1, +2, -2: how far in units of the size, and 12 times the weight."""
        times = wp.where(kind < 2, ONE, TWO)
        weight = wp.where(kind < 2, EIGHT, -ONE)
        if (kind & 1) == 1:
            times = -times
            weight = -weight
        return times, weight

    @wp.func
    def point(xs: wp.array3d(dtype=dtype), us: wp.array3d(dtype=dtype), b: int, k: int, c: int, far: real):
        """State and control of step k, component c of both moved by `far`."""
        x, u = VX(), VU()
        for j in range(wp.static(NX)):
            x[j] = real(xs[b, k, j])
            if j == c:
                x[j] = x[j] + far
        for j in range(wp.static(NU)):
            u[j] = real(us[b, k, j])
            if wp.static(NX) + j == c:
                u[j] = u[j] + far
        return x, u

    @wp.func
    def clear(fzz: wp.array4d(dtype=dtype), item: int):
        for i in range(wp.static(NW)):
            for r in range(NZ):
                for j in range(NZ):
                    fzz[item, i, r, j] = dtype(ZERO)

    @wp.func
    def add(fzz: wp.array4d(dtype=dtype), item: int, c: int, column: DW):
        """Half of a column's slopes to row and half to column c: symmetric."""
        for i in range(wp.static(NW)):
            for j in range(wp.static(NZ)):
                value = dtype(HALF * column[i, j])
                fzz[item, i, c, j] = fzz[item, i, c, j] + value
                fzz[item, i, j, c] = fzz[item, i, j, c] + value

    @wp.func
    def store(
        fx: wp.array4d(dtype=dtype), fu: wp.array4d(dtype=dtype), b: int, k: int, dv: DV, drift: DV, h: real
    ):
        """First derivatives of the step."""
        for i in range(wp.static(NV)):
            for j in range(wp.static(NX)):
                fx[b, k, wp.static(NV + i), j] = dtype(dv[i, j])
                fx[b, k, i, j] = dtype(h * drift[i, j] + wp.where(wp.static(i == j), ONE, ZERO))
            for j in range(wp.static(NU)):
                fu[b, k, wp.static(NV + i), j] = dtype(dv[i, wp.static(NX + j)])
                fu[b, k, i, j] = dtype(h * drift[i, wp.static(NX + j)])

    @specialised
    def difference_kernel(
        first: int,
        params: wp.array2d(dtype=real),
        steps: int,
        xs: wp.array3d(dtype=dtype),  # (B, >= N, nx)
        us: wp.array3d(dtype=dtype),  # (B, N, nu)
        external: wp.array2d(dtype=real),
        active: wp.array(dtype=wp.int32),  # (0 or B,) zero: skip the problem
        fx: wp.array4d(dtype=dtype),  # out (B, N, nx, nx)
        fu: wp.array4d(dtype=dtype),  # out (B, N, nx, nu)
        fzz: wp.array4d(dtype=dtype),  # out (B N, nw, nz, nz)
        status: wp.array2d(dtype=wp.int32),  # out (B, N)
    ):
        item = first + wp.tid()
        b = item / steps
        k = item - b * steps
        if active.shape[0] > 0:
            if active[b] == 0:
                return
        world = step.types.world_at(params, external, b)
        h = world.params[wp.static(H)]
        carry = step.cold_carry()
        size = VZ()
        column = DW()
        good = int(1)
        move = int(0)
        while move <= wp.static(4 * NZ):  # 0: the point itself; then component c at +1, -1, +2, -2
            c = (move - 1) / 4
            kind = move - 1 - 4 * c
            times, weight = stencil(kind)
            if move == 0:
                times = ZERO
            x, u = point(xs, us, b, k, c, times * size[c])
            sol = step.solve_step(world, x, u, carry)
            code = batch.status_of(sol, step.next_state(world, x, sol))
            lin, drift = linear.linearize(world, x, sol)
            if code == wp.static(SOLVED) and not linear.exists(lin.dv, drift):
                code = wp.static(NOT_CONVERGED)
            if code != wp.static(SOLVED):
                good = 0
                if move == 0:
                    status[b, k] = code
                    return
            out = outputs(lin.dv, drift)
            if move == 0:
                status[b, k] = code
                carry.z = sol.z
                carry.normal = sol.normal
                size = steps_of(world, sol)
                store(fx, fu, b, k, lin.dv, drift, h)
                clear(fzz, item)
            else:
                if kind == 0:
                    column = DW()
                column += weight / (TWELVE * size[c]) * out
                if kind == 3:
                    add(fzz, item, c, column)
            move += 1
        if good == 0:
            clear(fzz, item)

    return difference_kernel
