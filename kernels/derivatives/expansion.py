"""Kernels for derivatives along trajectories: Jacobians and second derivatives in batch."""

import warp as wp

from ..device.compile import fitted
from ..device.relay import Relay, hand_on, taken
from ..device.seldom import seldom
from ..factories import cached
from ..specialisation import Specialisation
from ..status import NOT_CONVERGED, SOLVED
from ..step.rollout import make_batch
from .curvature import make_curvature
from .sensitivity import make_linearization


@cached
def make_linearize_kernel(spec: Specialisation, second: bool) -> wp.Kernel:
    """A = df/dx, B = df/du (and d2v'/d(x, u)2) at every step of every problem.

    Item i is step i mod N of problem i div N. A fast method leaves items whose step it does not solve, or
    whose derivatives ask for refinement, to the other kernel (`device/relay.py`).
    """
    s, dtype, method = spec
    linear = make_linearization(spec)
    step = linear.step
    batch = make_batch(spec, False)
    curvature = make_curvature(spec) if second else None
    NV, NX, NU, NZ = s.nv, 2 * s.nv, s.nu, linear.NZ
    VX, VU, DV = step.types.VX, step.types.VU, linear.DV
    ZERO, ONE = dtype(0.0), dtype(1.0)
    ONCE = not second and not method.trapezoidal
    linearize = linear.once if ONCE else linear.linearize

    @wp.func
    def write(
        fx: wp.array4d(dtype=dtype), fu: wp.array4d(dtype=dtype), b: int, k: int, h: dtype, dv: DV, drift: DV
    ):
        # x' = (q + h v*, v'), v* = v' but for the trapezoidal integrator
        for i in range(wp.static(NV)):
            for j in range(wp.static(NX)):
                fx[b, k, wp.static(NV + i), j] = dv[i, j]
                fx[b, k, i, j] = h * drift[i, j] + wp.where(wp.static(i == j), ONE, ZERO)
            for j in range(wp.static(NU)):
                fu[b, k, wp.static(NV + i), j] = dv[i, wp.static(NX + j)]
                fu[b, k, i, j] = h * drift[i, wp.static(NX + j)]

    @wp.func(inline=False)
    def refine(
        world: step.types.World, x: VX, sol: step.Solution,
        fx: wp.array4d(dtype=dtype), fu: wp.array4d(dtype=dtype), b: int, k: int,
    ):  # fmt: skip
        """Of a step whose derivatives ask for refinement. The status."""
        lin, drift = linear.linearize(world, x, sol)
        if not linear.exists(lin.dv, drift):
            return int(wp.static(NOT_CONVERGED))
        write(fx, fu, b, k, world.params[0], lin.dv, drift)
        return int(wp.static(SOLVED))

    @fitted(method.fast and not second, 1 if second else len(s.pairs))
    def linearize_kernel(
        first: int,
        slot: int,
        last: int,
        most: int,
        relay: Relay,
        params: wp.array2d(dtype=dtype),
        steps: int,
        xs: wp.array3d(dtype=dtype),  # (B, >= N, nx)
        us: wp.array3d(dtype=dtype),  # (B, N, nu)
        external: wp.array2d(dtype=dtype),
        active: wp.array(dtype=wp.int32),  # (0 or B,) zero: skip the problem
        fx: wp.array4d(dtype=dtype),  # out (B, N, nx, nx)
        fu: wp.array4d(dtype=dtype),  # out (B, N, nx, nu)
        fzz: wp.array4d(dtype=dtype),  # out (B N, nv, nz, nz) or empty
        status: wp.array2d(dtype=wp.int32),  # out (B, N)
    ):
        item = first + wp.tid()
        if wp.static(method.part != "whole"):
            item = taken(relay, slot, item)
            if item < 0:
                return
        b = item / steps
        k = item - b * steps
        if active.shape[0] > 0:
            if active[b] == 0:
                return
        world = step.types.world_at(params, external, b)
        x = VX()
        u = VU()
        for j in range(wp.static(NX)):
            x[j] = xs[b, k, j]
        for j in range(wp.static(NU)):
            u[j] = us[b, k, j]
        sol = step.solve_step(world, x, u, step.cold_carry())
        code = batch.status_of(sol, step.next_state(world, x, sol))
        if wp.static(method.fast):
            if code != wp.static(SOLVED):
                hand_on(relay, slot, item)
                return
        status[b, k] = code
        if code == wp.static(SOLVED):
            lin, drift = linearize(world, x, sol)
            if wp.static(ONCE):
                if seldom(lin.factor.near == 1):
                    if wp.static(method.fast):
                        hand_on(relay, slot, item)
                    else:
                        status[b, k] = refine(world, x, sol, fx, fu, b, k)
                    return
            elif not linear.exists(lin.dv, drift):
                status[b, k] = wp.static(NOT_CONVERGED)
                return
            write(fx, fu, b, k, world.params[0], lin.dv, drift)
            if wp.static(second):
                for output in range(NV):
                    hess = wp.static(curvature)(world, x, sol, lin, output)
                    for i in range(wp.static(NZ)):
                        for j in range(wp.static(NZ)):
                            fzz[item, output, i, j] = hess[i, j]

    return linearize_kernel
