"""A step of the backward pass of DDP by the lanes of a warp: entries shared out, found again in memory."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..solver_state import make_derivative_arrays, make_policy_arrays
from .riccati_parts import WEIGHED

LANES = 32  # of a warp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
""")
def together():
    """The lanes of a warp wait for each other, and see what they wrote."""
    ...


def room_of(nx, nu, nw):
    """Where a problem's numbers begin in its room: {name: place}, and "width", their number."""
    sizes = {
        "vx": nx, "vxx": nx * nx, "y": max(nw, 0), "product": nx * (nx + nu), "qx": nx, "qu": nu,
        "qxx": nx * nx, "qux": nu * nx, "quu": nu * nu, "ruu": nu * nu, "rux": nu * nx,
        "sizes": nu, "step": nu, "gain": nu * nx, "pull": nu, "gap": nx, "raised": 1,
    }  # fmt: skip
    out, end = {}, 0
    for name, size in sizes.items():
        out[name], end = end, end + size
    return out | {"width": end}


@cached
def make_shared_steps(nx, nu, nw, method, dtype, lanes):
    """Warp functions of a step that lanes share: `final_value`, `shifted`, `model` and `value`, of which (11)
    and the value function's equations stand in `riccati.py`; `read_x` and the like take out of a room, a row
    of (B, width), what is in it.
    """
    Derivatives, Policy = make_derivative_arrays(dtype), make_policy_arrays(dtype)
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    MUX, MUU = wp.types.matrix((nu, nx), dtype), wp.types.matrix((nu, nu), dtype)
    NZ = nx + nu
    ZERO, HALF = dtype(0.0), dtype(0.5)
    at = SimpleNamespace(**room_of(nx, nu, nw))
    curved, quadratic = method == "second-order", method != "first-order"
    Room = wp.array2d(dtype=dtype)

    @wp.func
    def jacobian(d: Derivatives, b: int, k: int, j: int, c: int):
        """f_z of a step: column c of (f_x, f_u)."""
        if c < nx:
            return d.fx[b, k, j, c]
        return d.fu[b, k, j, c - nx]

    @wp.func
    def prepare(d: Derivatives, room: Room, b: int, k: int, lane: int):
        """V_xx f_z, and what weighs the second derivatives."""
        if wp.static(quadratic):
            e = int(lane)
            while e < wp.static(nx * NZ):
                r = e // NZ
                c = e % NZ
                sum = ZERO
                for j in range(nx):
                    sum += room[b, wp.static(at.vxx) + r * nx + j] * jacobian(d, b, k, j, c)
                room[b, wp.static(at.product) + e] = sum
                e += lanes
        if wp.static(curved):
            i = int(lane)
            while i < nw:
                sum = ZERO
                for j in range(nx):
                    sum += d.lift[b, i, j] * room[b, wp.static(at.vx) + j]
                room[b, wp.static(at.y) + i] = sum
                i += lanes

    @wp.func
    def first_order(d: Derivatives, room: Room, b: int, k: int, c: int):
        """f_z' V_x, and the sizes of its terms."""
        sum = ZERO
        size = ZERO
        for j in range(nx):
            term = jacobian(d, b, k, j, c) * room[b, wp.static(at.vx) + j]
            sum += term
            size += wp.abs(term)
        return sum, size

    @wp.func
    def second_order(d: Derivatives, room: Room, b: int, k: int, r: int, c: int):
        """f_z' V_xx f_z + V_x.f_zz, an entry."""
        sum = ZERO
        if wp.static(quadratic):
            for j in range(nx):
                sum += jacobian(d, b, k, j, r) * room[b, wp.static(at.product) + j * NZ + c]
        if wp.static(curved):
            cell = b * d.fx.shape[1] + k
            high = wp.max(r, c)  # of z, by which second derivatives are symmetric
            low = wp.min(r, c)
            if wp.static(nw == WEIGHED):
                sum += d.second[cell, 0, high, low]
            for i in range(nw):
                sum += room[b, wp.static(at.y) + i] * d.second[cell, i, high, low]
        return sum

    @wp.func
    def regular(d: Derivatives, b: int, k: int, r: int, c: int, mu_x: dtype):
        """mu_x f_u' f_z, an entry."""
        sum = ZERO
        if wp.static(quadratic):
            if mu_x != ZERO:
                for j in range(nx):
                    sum += d.fu[b, k, j, r] * jacobian(d, b, k, j, c)
        return mu_x * sum

    @wp.func
    def model(d: Derivatives, room: Room, b: int, k: int, lane: int, mu_x: dtype, mu_u: dtype):
        """Unminimised value (11): Q_x, Q_u, Q_xx, Q_ux, Q_uu of step k, and R, S, into the room."""
        prepare(d, room, b, k, lane)
        together()
        e = int(lane)
        while e < wp.static(NZ + NZ * NZ):
            if e < NZ:
                sum, size = first_order(d, room, b, k, e)
                if e < nx:
                    room[b, wp.static(at.qx) + e] = d.lx[b, k, e] + sum
                else:
                    i = e - nx
                    room[b, wp.static(at.qu) + i] = d.lu[b, k, i] + sum
                    room[b, wp.static(at.sizes) + i] = wp.abs(d.lu[b, k, i]) + size
            else:
                r = (e - NZ) // NZ
                c = (e - NZ) % NZ
                if r < nx and c < nx:
                    entry = d.lxx[b, k, r, c] + second_order(d, room, b, k, r, c)
                    room[b, wp.static(at.qxx) + r * nx + c] = entry
                elif r >= nx and c < nx:
                    i = r - nx
                    entry = d.lux[b, k, i, c] + second_order(d, room, b, k, r, c)
                    room[b, wp.static(at.qux) + i * nx + c] = entry
                    room[b, wp.static(at.rux) + i * nx + c] = entry + regular(d, b, k, i, c, mu_x)
                elif r >= nx:
                    i = r - nx
                    j = c - nx
                    entry = d.luu[b, k, i, j] + second_order(d, room, b, k, r, c)
                    room[b, wp.static(at.quu) + i * nu + j] = entry
                    entry += regular(d, b, k, i, c, mu_x)
                    if i == j:
                        entry += mu_u
                    room[b, wp.static(at.ruu) + i * nu + j] = entry
            e += lanes
        together()

    @wp.func
    def read_x(room: Room, b: int, place: int):
        """A vector of states out of the room."""
        out = VX()
        for i in range(nx):
            out[i] = room[b, place + i]
        return out

    @wp.func
    def read_u(room: Room, b: int, place: int):
        """A vector of controls."""
        out = VU()
        for i in range(nu):
            out[i] = room[b, place + i]
        return out

    @wp.func
    def read_uu(room: Room, b: int, place: int):
        """Q_uu or R."""
        out = MUU()
        for i in range(nu):
            for j in range(nu):
                out[i, j] = room[b, place + i * nu + j]
        return out

    @wp.func
    def read_ux(room: Room, b: int, place: int):
        """Q_ux or S."""
        out = MUX()
        for i in range(nu):
            for j in range(nx):
                out[i, j] = room[b, place + i * nx + j]
        return out

    @wp.func
    def bent_entry(room: Room, b: int, r: int, c: int):
        """Q_xx + K' Q_uu K + K' Q_ux + Q_ux' K, an entry."""
        sum = room[b, wp.static(at.qxx) + r * nx + c]
        for i in range(nu):
            inner = room[b, wp.static(at.qux) + i * nx + c]
            for j in range(nu):
                inner += room[b, wp.static(at.quu) + i * nu + j] * room[b, wp.static(at.gain) + j * nx + c]
            sum += room[b, wp.static(at.gain) + i * nx + r] * inner
            sum += room[b, wp.static(at.qux) + i * nx + r] * room[b, wp.static(at.gain) + i * nx + c]
        return sum

    @wp.func
    def value(policy: Policy, room: Room, b: int, k: int, lane: int, qu: VU, bent: VU, step: VU, gain: MUX):
        """V_x and V_xx under the policy, and the policy, stored; of the first-order method V_xx stays."""
        if lane == 0:
            for i in range(nu):
                room[b, wp.static(at.pull) + i] = bent[i] + qu[i]
                room[b, wp.static(at.step) + i] = step[i]
                policy.k[b, k, i] = step[i]
                for j in range(nx):
                    room[b, wp.static(at.gain) + i * nx + j] = gain[i, j]
                    policy.K[b, k, i, j] = gain[i, j]
        together()
        e = int(lane)
        while e < wp.static(nx + nx * nx):
            if e < nx:
                sum = room[b, wp.static(at.qx) + e]
                if wp.static(quadratic):
                    for i in range(nu):
                        sum += room[b, wp.static(at.gain) + i * nx + e] * room[b, wp.static(at.pull) + i]
                        sum += room[b, wp.static(at.qux) + i * nx + e] * room[b, wp.static(at.step) + i]
                room[b, wp.static(at.vx) + e] = sum
                policy.Vx[b, k, e] = sum
            else:
                r = (e - nx) // nx
                c = (e - nx) % nx
                entry = room[b, wp.static(at.vxx) + e - nx]
                if wp.static(quadratic):
                    entry = HALF * (bent_entry(room, b, r, c) + bent_entry(room, b, c, r))
                    room[b, wp.static(at.vxx) + e - nx] = entry
                policy.Vxx[b, k, r, c] = entry
            e += lanes
        together()

    @wp.func
    def final_value(d: Derivatives, policy: Policy, room: Room, b: int, horizon: int, lane: int):
        """V_x and V_xx of the final cost."""
        e = int(lane)
        while e < wp.static(nx + nx * nx):
            if e < nx:
                room[b, wp.static(at.vx) + e] = d.lx[b, horizon, e]
                policy.Vx[b, horizon, e] = d.lx[b, horizon, e]
            else:
                r = (e - nx) // nx
                c = (e - nx) % nx
                room[b, wp.static(at.vxx) + e - nx] = d.lxx[b, horizon, r, c]
                policy.Vxx[b, horizon, r, c] = d.lxx[b, horizon, r, c]
            e += lanes
        together()

    @wp.func
    def shifted(policy: Policy, room: Room, b: int, k: int, lane: int):
        """V_x beyond the gap to x_{k+1}, into the room; the change of V on the way (M43), (M44)."""
        i = int(lane)
        while i < nx:
            sum = ZERO
            for j in range(nx):
                sum += room[b, wp.static(at.vxx) + i * nx + j] * policy.gaps[b, k, j]
            room[b, wp.static(at.gap) + i] = sum
            i += lanes
        together()
        change = wp.float64(0.0)
        for j in range(nx):
            gap = policy.gaps[b, k, j]
            half = wp.float64(gap) * wp.float64(HALF * room[b, wp.static(at.gap) + j])
            change += wp.float64(room[b, wp.static(at.vx) + j]) * wp.float64(gap) + half
        together()
        i = lane + 0
        while i < nx:
            room[b, wp.static(at.vx) + i] = room[b, wp.static(at.vx) + i] + room[b, wp.static(at.gap) + i]
            i += lanes
        together()
        return change

    return SimpleNamespace(
        model=model, value=value, final_value=final_value, shifted=shifted,
        read_x=read_x, read_u=read_u, read_uu=read_uu, read_ux=read_ux,
    )  # fmt: skip
