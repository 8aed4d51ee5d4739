"""The adjoint of a rollout: gradients by x0, controls or a tracking policy, and parameters."""

import warp as wp

from ..derivatives.sensitivity import make_linearization
from ..device.compile import specialised, whole
from ..factories import cached
from ..policies.pieces import make_wrap
from ..policies.tracking import make_tracking
from ..specialisation import Specialisation
from ..status import SOLVED
from .faded import FADED
from .parameters import make_parameter_gradient


@cached
def make_adjoint_kernel(spec: Specialisation, by_parameters: bool, feedback: bool) -> wp.Kernel:
    """Backward pass of rollouts, from gradients by the recorded states; open loop, or with `feedback` under
    u = us_k + K_k (x - xs_k).

    Every step is solved again at its recorded state and differentiated at the solution; nothing else is
    stored.
    """
    s, dtype, _ = spec
    linear = make_linearization(spec)
    step = linear.step
    NV, NX, NU = s.nv, 2 * s.nv, s.nu
    VX, VU = step.types.VX, step.types.VU
    parameters = make_parameter_gradient(spec) if by_parameters else None
    Tracking = make_tracking(NX, NU, dtype).Struct
    wrapped, free = make_wrap(dtype), make_free(NX, NU, dtype)
    LEAST = dtype(FADED[dtype])

    @wp.func
    def pulled(g: VX, dv: linear.DV, drift: linear.DV, h: dtype, recorded: VX):
        """Gradients by the state and the control before a step, from the one by the state after it."""
        total, by_control = recorded, VU()
        for i in range(wp.static(NV)):
            total[i] = total[i] + g[i]
            for j in range(wp.static(NX)):
                total[j] = total[j] + (g[wp.static(NV + i)] * dv[i, j] + h * g[i] * drift[i, j])
            for j in range(wp.static(NU)):
                c = wp.static(NX + j)
                by_control[j] = by_control[j] + g[wp.static(NV + i)] * dv[i, c] + h * g[i] * drift[i, c]
        return total, by_control

    @wp.func
    def through_policy(
        policy: Tracking,
        index: int,
        k: int,
        x: VX,
        by_control: VU,
        xs_grad: wp.array3d(dtype=dtype),
        gain_grad: wp.array4d(dtype=dtype),
    ):
        """The gradient by a state of what the policy gives there; adds those by gains and nominal states."""
        out = VX()
        tracked = wp.where(policy.gain.shape[0] == 1, 0, index)
        held = wp.min(k, policy.us.shape[1] - 1)
        for j in range(wp.static(NX)):
            slope = dtype(0.0)
            dx = wrapped(x[j] - policy.xs[tracked, held, j], policy.period[j])
            for i in range(wp.static(NU)):
                slope += by_control[i] * policy.gain[tracked, held, i, j]
                if gain_grad.shape[0] > 0:
                    gain_grad[index, held, i, j] = gain_grad[index, held, i, j] + by_control[i] * dx
            out[j] = slope
            if xs_grad.shape[0] > 0:
                xs_grad[index, held, j] = xs_grad[index, held, j] - slope
        return out

    @wp.func
    def say_none(
        index: int,
        steps: int,  # of the policy
        us_grad: wp.array3d(dtype=dtype),
        xs_grad: wp.array3d(dtype=dtype),
        gain_grad: wp.array4d(dtype=dtype),
        params_grad: wp.array2d(dtype=dtype),
    ):
        """No gradient exists of what a loss asks: not numbers instead of inventing one."""
        if us_grad.shape[0] > 0:
            for k in range(us_grad.shape[1]):
                for j in range(wp.static(NU)):
                    us_grad[index, k, j] = dtype(wp.NAN)
        if wp.static(by_parameters):
            for j in range(params_grad.shape[1]):
                params_grad[index, j] = dtype(wp.NAN)
        if wp.static(feedback):
            for k in range(steps):
                for j in range(wp.static(NX)):
                    if xs_grad.shape[0] > 0:
                        xs_grad[index, k, j] = dtype(wp.NAN)
                    if gain_grad.shape[0] > 0:
                        for i in range(wp.static(NU)):
                            gain_grad[index, k, i, j] = dtype(wp.NAN)

    @wp.func
    def asked(states_grad: wp.array3d(dtype=dtype), index: int, k: int):
        """Slopes by a recorded state."""
        out = VX()
        for j in range(wp.static(NX)):
            out[j] = states_grad[index, k, j]
        return out

    @wp.func
    def size_of(g: VX):
        """The sum of all sizes: NaN where one is."""
        out = dtype(0.0)
        for j in range(wp.static(NX)):
            out += wp.abs(g[j])
        return out

    @whole(len(s.pairs))
    def adjoint_kernel(
        first: int,
        params: wp.array2d(dtype=dtype),
        us: wp.array3d(dtype=dtype),  # (B, N, nu), as applied
        policy: Tracking,  # of N' steps, the last of which is held
        external: wp.array2d(dtype=dtype),
        states: wp.array3d(dtype=dtype),  # (B, N+1, nx)
        status: wp.array(dtype=wp.int32),  # (B,)
        states_grad: wp.array3d(dtype=dtype),  # (B, N+1, nx)
        x0_grad: wp.array2d(dtype=dtype),  # accumulated (0 or B, nx)
        us_grad: wp.array3d(dtype=dtype),  # accumulated (0 or B, N or N', nu)
        xs_grad: wp.array3d(dtype=dtype),  # accumulated (0 or B, >= N', nx)
        gain_grad: wp.array4d(dtype=dtype),  # accumulated (0 or B, N', nu, nx)
        params_grad: wp.array2d(dtype=dtype),  # accumulated (0 or B, width)
    ):
        index = first + wp.tid()
        world = step.types.world_at(params, external, index)
        steps = us.shape[1]
        h = world.params[0]
        g = asked(states_grad, index, steps)
        carry = step.cold_carry()
        most = dtype(0.0)
        for back in range(steps):
            k = steps - 1 - back
            size = size_of(g)
            most = wp.max(most, size)
            if size <= LEAST * most:  # nothing, or nothing any more, comes from later
                g = asked(states_grad, index, k)
                continue
            x = VX()
            u = VU()
            recorded = asked(states_grad, index, k)
            for j in range(wp.static(NX)):
                x[j] = states[index, k, j]
            for j in range(wp.static(NU)):
                u[j] = us[index, k, j]
            sol = step.solve_step(world, x, u, carry)
            carry.z = sol.z
            carry.normal = sol.normal
            lin, drift = linear.linearize(world, x, sol)
            if wp.static(by_parameters):
                wp.static(parameters)(world, x, u, sol, lin, g, params_grad[index])
            total, by_control = pulled(g, lin.dv, drift, h, recorded)
            if wp.static(feedback):
                for j in range(wp.static(NU)):
                    by_control[j] = by_control[j] * free(policy, index, j, u[j])
            if us_grad.shape[0] > 0:
                at = wp.min(k, us_grad.shape[1] - 1)
                for j in range(wp.static(NU)):
                    us_grad[index, at, j] = us_grad[index, at, j] + by_control[j]
            if wp.static(feedback):
                total = total + through_policy(policy, index, k, x, by_control, xs_grad, gain_grad)
            g = total
        if status[index] != wp.static(SOLVED) and not (most + size_of(g) == dtype(0.0)):
            for j in range(wp.static(NX)):
                g[j] = dtype(wp.NAN)
            say_none(index, policy.us.shape[1], us_grad, xs_grad, gain_grad, params_grad)
        if x0_grad.shape[0] > 0:
            for j in range(wp.static(NX)):
                x0_grad[index, j] = x0_grad[index, j] + g[j]

    return adjoint_kernel


@cached
def make_free(nx: int, nu: int, dtype: type) -> wp.Function:
    """free(policy, world, i, u): slope of control i by what the policy asks for, 0 at a limit, else 1."""
    Tracking = make_tracking(nx, nu, dtype).Struct

    @wp.func
    def free(policy: Tracking, world: int, i: int, u: dtype):
        if policy.lower.shape[0] > 0:
            row = wp.where(policy.lower.shape[0] == 1, 0, world)
            if u <= policy.lower[row, i] or u >= policy.upper[row, i]:
                return dtype(0.0)
        return dtype(1.0)

    return free


@cached
def make_control_kernel(nx: int, nu: int, dtype: type) -> wp.Kernel:
    """What gradients by the controls u = us_k + K_k (x - xs_k) themselves add to those by the policy and the
    states, before the adjoint.
    """
    Tracking = make_tracking(nx, nu, dtype).Struct
    wrapped, free = make_wrap(dtype), make_free(nx, nu, dtype)

    @specialised
    def control_kernel(
        first: int,
        policy: Tracking,
        us: wp.array3d(dtype=dtype),  # (B, N, nu), as applied
        states: wp.array3d(dtype=dtype),  # (B, N+1, nx)
        controls_grad: wp.array3d(dtype=dtype),  # (B, N, nu)
        states_grad: wp.array3d(dtype=dtype),  # accumulated (B, N+1, nx)
        us_grad: wp.array3d(dtype=dtype),  # accumulated (0 or B, N', nu)
        xs_grad: wp.array3d(dtype=dtype),  # accumulated (0 or B, >= N', nx)
        gain_grad: wp.array4d(dtype=dtype),  # accumulated (0 or B, N', nu, nx)
    ):
        world = first + wp.tid()
        row = wp.where(policy.gain.shape[0] == 1, 0, world)
        for k in range(controls_grad.shape[1]):
            at = wp.min(k, policy.us.shape[1] - 1)
            for i in range(wp.static(nu)):
                by_control = controls_grad[world, k, i] * free(policy, world, i, us[world, k, i])
                if us_grad.shape[0] > 0:
                    us_grad[world, at, i] = us_grad[world, at, i] + by_control
                for j in range(wp.static(nx)):
                    slope = by_control * policy.gain[row, at, i, j]
                    states_grad[world, k, j] = states_grad[world, k, j] + slope
                    if xs_grad.shape[0] > 0:
                        xs_grad[world, at, j] = xs_grad[world, at, j] - slope
                    if gain_grad.shape[0] > 0:
                        dx = wrapped(states[world, k, j] - policy.xs[row, at, j], policy.period[j])
                        gain_grad[world, at, i, j] = gain_grad[world, at, i, j] + by_control * dx

    return control_kernel
