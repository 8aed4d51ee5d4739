"""A step of the backward pass of DDP by the lanes of a warp: entries shared out, found again in memory."""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from .solver_state import make_derivative_arrays, make_policy_arrays

WARP = 32  # lanes


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    unsigned first = threadIdx.x & 31u & ~unsigned(lanes - 1);
    __syncwarp((0xffffffffu >> (32 - lanes)) << first);
#endif
""")
def together(lanes: int):
    """So many lanes of a warp, a power of two, wait for each other, and see what they wrote."""
    ...


@wp.func_native("""
    int next = i + lanes;
#if defined(__CUDA_ARCH__)
    asm volatile("" : "+r"(next));
#endif
    return next;
""")
def onward(i: int, lanes: int) -> int:
    """i + lanes, which the compiler does not know: it unrolls no loop that goes on so."""
    ...


def room_of(nx, nu, nw):
    """Where a problem's numbers begin in its room, {name: place}; "width" is their number."""
    nz = nx + nu
    sizes = {
        "vx": nx, "vxx": nx * nx, "y": nw, "f": nx * nz, "product": nx * nz, "q": nz, "qxx": nx * nx,
        "qux": nu * nx, "quu": nu * nu, "ruu": nu * nu, "rux": nu * nx, "sizes": nz, "step": nu,
        "gain": nu * nx, "slope": nu, "gap": nx, "raised": 1,
    }  # fmt: skip
    out, end = {}, 0
    for name, size in sizes.items():
        out[name], end = end, end + size
    return out | {"width": end}


@cached
def make_shared_steps(nx, nu, nw, method, dtype, lanes):
    """Warp functions of a step that lanes share: `model`, `value`, `final_value`, `shifted`; `read_x` and the
    like take out of a room what is in it.

    A room is a row, so that its numbers are found by one product each, and loops have bounds that the
    compiler does not know: unrolled, a step is more code than a multiprocessor keeps.
    """
    Derivatives, Policy = make_derivative_arrays(dtype), make_policy_arrays(dtype)
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    MUX, MUU = wp.types.matrix((nu, nx), dtype), wp.types.matrix((nu, nu), dtype)
    Row = wp.array(dtype=dtype)
    NZ = nx + nu
    ZERO, HALF = dtype(0.0), dtype(0.5)
    at = SimpleNamespace(**room_of(nx, nu, nw))
    curved, quadratic = method == "second-order", method != "first-order"

    @wp.func
    def product(row: Row, left: int, stride: int, right: int, count: int):
        """Sum of row[left + j stride] row[right + j NZ] over j."""
        sum = ZERO
        for j in range(count):
            sum += row[left + j * stride] * row[right + j * NZ]
        return sum

    @wp.func
    def prepare(d: Derivatives, row: Row, b: int, k: int, lane: int):
        """f_z = (f_x, f_u), V_xx f_z, and what weighs the second derivatives."""
        count = d.fx.shape[2]
        fx, fu = d.fx[b, k], d.fu[b, k]
        e = int(lane)
        while e < count * NZ:
            j = e / NZ
            c = e - j * NZ
            if c < nx:
                row[wp.static(at.f) + e] = fx[j, c]
            else:
                row[wp.static(at.f) + e] = fu[j, c - nx]
            e = onward(e, lanes)
        together(lanes)
        if wp.static(quadratic):
            e = lane + 0
            while e < count * NZ:
                r = e / NZ
                c = e - r * NZ
                row[wp.static(at.product) + e] = product(
                    row, wp.static(at.vxx) + r * nx, 1, wp.static(at.f) + c, count
                )
                e = onward(e, lanes)
        if wp.static(curved):
            lift = d.lift[b]
            i = int(lane)
            while i < lift.shape[0]:
                sum = ZERO
                for j in range(count):
                    sum += lift[i, j] * row[wp.static(at.vx) + j]
                row[wp.static(at.y) + i] = sum
                i = onward(i, lanes)
        together(lanes)

    @wp.func
    def first_order(d: Derivatives, row: Row, b: int, k: int, lane: int):
        """Q_z = l_z + f_z' V_x, and the sizes of its terms."""
        lx, lu = d.lx[b, k], d.lu[b, k]
        count = d.fx.shape[2]
        c = int(lane)
        while c < NZ:
            sum = ZERO
            if c < nx:
                sum = lx[c]
            else:
                sum = lu[c - nx]
            size = wp.abs(sum)
            for j in range(count):
                term = row[wp.static(at.f) + j * NZ + c] * row[wp.static(at.vx) + j]
                sum += term
                size += wp.abs(term)
            row[wp.static(at.q) + c] = sum
            row[wp.static(at.sizes) + c] = size
            c = onward(c, lanes)

    @wp.func
    def second_order(d: Derivatives, row: Row, b: int, k: int, lane: int, mu_x: dtype, mu_u: dtype):
        """Q_zz = l_zz + f_z' V_xx f_z + V_x.f_zz, but for Q_xu, and R, S."""
        lxx, lux, luu = d.lxx[b, k], d.lux[b, k], d.luu[b, k]
        count = d.fx.shape[2]
        e = int(lane)
        while e < wp.static(NZ * NZ):
            r = e / NZ
            c = e - r * NZ
            if r >= nx or c < nx:
                sum = ZERO
                if wp.static(quadratic):
                    sum = product(row, wp.static(at.f) + r, NZ, wp.static(at.product) + c, count)
                if wp.static(curved):
                    second = d.second[b * d.fx.shape[1] + k]
                    high = wp.max(r, c)  # of z, by which second derivatives are symmetric
                    low = wp.min(r, c)
                    i = int(0)
                    while i < second.shape[0]:
                        sum += row[wp.static(at.y) + i] * second[i, high, low]
                        i = onward(i, 1)
                if r < nx:
                    row[wp.static(at.qxx) + r * nx + c] = lxx[r, c] + sum
                else:
                    i = r - nx + 0
                    regular = ZERO
                    if wp.static(quadratic):
                        if mu_x != ZERO:
                            regular = mu_x * product(row, wp.static(at.f) + r, NZ, wp.static(at.f) + c, count)
                    if c < nx:
                        sum += lux[i, c]
                        row[wp.static(at.qux) + i * nx + c] = sum
                        row[wp.static(at.rux) + i * nx + c] = sum + regular
                    else:
                        j = c - nx
                        sum += luu[i, j]
                        row[wp.static(at.quu) + i * nu + j] = sum
                        if i == j:
                            regular += mu_u
                        row[wp.static(at.ruu) + i * nu + j] = sum + regular
            e = onward(e, lanes)

    @wp.func
    def model(d: Derivatives, row: Row, b: int, k: int, lane: int, mu_x: dtype, mu_u: dtype):
        """Unminimised value (11): Q_x, Q_u, Q_xx, Q_ux, Q_uu of step k, and R, S, into the room."""
        prepare(d, row, b, k, lane)
        first_order(d, row, b, k, lane)
        second_order(d, row, b, k, lane, mu_x, mu_u)
        together(lanes)

    @wp.func
    def read_x(row: Row, place: int):
        """A vector of states out of the room."""
        out = VX()
        for i in range(nx):
            out[i] = row[place + i]
        return out

    @wp.func
    def read_u(row: Row, place: int):
        """A vector of controls."""
        out = VU()
        for i in range(nu):
            out[i] = row[place + i]
        return out

    @wp.func
    def read_uu(row: Row, place: int):
        """Q_uu or R."""
        out = MUU()
        for i in range(nu):
            for j in range(nu):
                out[i, j] = row[place + i * nu + j]
        return out

    @wp.func
    def read_ux(row: Row, place: int):
        """S."""
        out = MUX()
        for i in range(nu):
            for j in range(nx):
                out[i, j] = row[place + i * nx + j]
        return out

    @wp.func
    def keep(policy: Policy, row: Row, b: int, k: int, qu: VU, bent: VU, step: VU, gain: MUX):
        """A step's policy, stored and in the room."""
        for i in range(nu):
            row[wp.static(at.slope) + i] = bent[i] + qu[i]
            row[wp.static(at.step) + i] = step[i]
            policy.k[b, k, i] = step[i]
            for j in range(nx):
                row[wp.static(at.gain) + i * nx + j] = gain[i, j]

    @wp.func
    def bent_entry(row: Row, r: int, c: int, controls: int):
        """Q_xx + K' Q_uu K + K' Q_ux + Q_ux' K, an entry."""
        sum = row[wp.static(at.qxx) + r * nx + c]
        i = int(0)
        while i < controls:
            inner = row[wp.static(at.qux) + i * nx + c]
            j = int(0)
            while j < controls:
                inner += row[wp.static(at.quu) + i * nu + j] * row[wp.static(at.gain) + j * nx + c]
                j = onward(j, 1)
            sum += row[wp.static(at.gain) + i * nx + r] * inner
            sum += row[wp.static(at.qux) + i * nx + r] * row[wp.static(at.gain) + i * nx + c]
            i = onward(i, 1)
        return sum

    @wp.func
    def value(policy: Policy, row: Row, b: int, k: int, lane: int, qu: VU, bent: VU, step: VU, gain: MUX):
        """V_x and V_xx under the policy, and the policy, stored; of the first-order method V_xx stays."""
        if lane == 0:
            keep(policy, row, b, k, qu, bent, step, gain)
        together(lanes)
        controls = policy.us.shape[2]
        gains, slopes, curves = policy.K[b, k], policy.Vx[b, k], policy.Vxx[b, k]
        e = int(lane)
        while e < wp.static(nx * nx):
            r = e / nx
            c = e - r * nx
            entry = row[wp.static(at.vxx) + e]
            if wp.static(quadratic):
                entry = HALF * (bent_entry(row, r, c, controls) + bent_entry(row, c, r, controls))
                row[wp.static(at.vxx) + e] = entry
            curves[r, c] = entry
            e = onward(e, lanes)
        c = lane + 0
        while c < nx:
            sum = row[wp.static(at.q) + c]
            i = int(0)
            while i < controls:
                own = row[wp.static(at.gain) + i * nx + c]
                gains[i, c] = own
                if wp.static(quadratic):
                    sum += own * row[wp.static(at.slope) + i]
                    sum += row[wp.static(at.qux) + i * nx + c] * row[wp.static(at.step) + i]
                i = onward(i, 1)
            row[wp.static(at.vx) + c] = sum
            slopes[c] = sum
            c = onward(c, lanes)
        together(lanes)

    @wp.func
    def final_value(d: Derivatives, policy: Policy, row: Row, b: int, horizon: int, lane: int):
        """V_x and V_xx of the final cost."""
        e = int(lane)
        while e < wp.static(nx * nx):
            r = e / nx
            c = e - r * nx
            row[wp.static(at.vxx) + e] = d.lxx[b, horizon, r, c]
            policy.Vxx[b, horizon, r, c] = d.lxx[b, horizon, r, c]
            if r == 0:
                row[wp.static(at.vx) + c] = d.lx[b, horizon, c]
                policy.Vx[b, horizon, c] = d.lx[b, horizon, c]
            e = onward(e, lanes)
        together(lanes)

    @wp.func
    def shifted(policy: Policy, row: Row, b: int, k: int, lane: int):
        """V_x beyond the gap to x_{k+1}, into the room; the change of V on the way (M43), (M44)."""
        gaps = policy.gaps[b, k]
        count = policy.xs.shape[2]
        i = int(lane)
        while i < nx:
            sum = ZERO
            for j in range(count):
                sum += row[wp.static(at.vxx) + i * nx + j] * gaps[j]
            row[wp.static(at.gap) + i] = sum
            i = onward(i, lanes)
        together(lanes)
        change = wp.float64(0.0)
        for j in range(count):
            gap = wp.float64(gaps[j])
            change += wp.float64(row[wp.static(at.vx) + j]) * gap
            change += wp.float64(HALF * row[wp.static(at.gap) + j]) * gap
        together(lanes)
        i = lane + 0
        while i < nx:
            row[wp.static(at.vx) + i] = row[wp.static(at.vx) + i] + row[wp.static(at.gap) + i]
            i = onward(i, lanes)
        together(lanes)
        return change

    return SimpleNamespace(
        model=model, value=value, final_value=final_value, shifted=shifted,
        read_x=read_x, read_u=read_u, read_uu=read_uu, read_ux=read_ux,
    )  # fmt: skip
