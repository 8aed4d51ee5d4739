"""The adjoint of a rollout with generic kernels: gradients by x0, controls or a tracking policy, and
parameters. What `gradients/adjoint.py` gives of specialised ones.
"""

import warp as wp

from ...device.compile import of_any_scene
from ...factories import cached
from ...generic.derivatives.tables import Groups
from ...generic.topology import Topology
from ...generic.work import WORK, Slot, Work, view
from ...policies.pieces import make_wrap
from ...status import SOLVED
from ..faded import FADED
from .room import Room, View, view_of
from .step import make_step_adjoint

# relative to a world's speeds: what tells another solution from rounding of the recorded state, which contact
# amplifies
OTHER = {wp.float64: 1e-5, wp.float32: 1e-2}


@wp.func
def sum_of(a: wp.array(dtype=wp.float64)):
    """Of the sizes of all entries: NaN where one is."""
    out = wp.float64(0.0)
    for i in range(a.shape[0]):
        out += wp.abs(a[i])
    return out


@wp.func
def fill(a: wp.array(dtype=wp.float64), n: int, value: wp.float64):
    """The first n entries."""
    for i in range(n):
        a[i] = value


@cached
def make_policy_adjoint(given: type) -> wp.Function:
    """through(...): adds the slopes that the state before a step has through the policy's controls, and
    those by its nominal states and gains.
    """
    wrapped = make_wrap(given)

    @wp.func
    def through(
        tracked: int,
        index: int,
        at: int,
        i: int,
        by: WORK,
        x: wp.array(dtype=given),
        xs: wp.array3d(dtype=given),
        gain: wp.array4d(dtype=given),
        period: wp.array(dtype=given),
        weight: wp.array(dtype=WORK),
        xs_grad: wp.array3d(dtype=given),
        gain_grad: wp.array4d(dtype=given),
    ):
        """Control i of one step; `weight` collects the slopes by the state."""
        for j in range(x.shape[0]):
            slope = by * WORK(gain[tracked, at, i, j])
            weight[j] = weight[j] + slope
            if xs_grad.shape[0] > 0:
                xs_grad[index, at, j] = xs_grad[index, at, j] - given(slope)
            if gain_grad.shape[0] > 0:
                dx = wrapped(x[j] - xs[tracked, at, j], period[j])
                gain_grad[index, at, i, j] = gain_grad[index, at, i, j] + given(by) * dx

    return through


@cached
def make_generic_adjoint_kernel(given: type, residual: str) -> wp.Kernel:
    """Backward pass of rollouts, from gradients by the recorded states; open loop, or with a `gain` under
    u = us_k + K_k (x - xs_k), held at limits.

    Every step is solved again at its recorded state, warm from the step after it, and differentiated at the
    solution; nothing else is stored. A world whose rollout or whose step now is not solved gets NaN if slopes
    by a state of it are given; so does one that solves to other velocities now than in the rollout, as
    Coulomb's friction may, and one whose derivatives have no digits left.
    """
    back = make_step_adjoint(given, residual, True)
    through = make_policy_adjoint(given)
    ZERO, ONE, APART, LEAST = WORK(0.0), WORK(1.0), WORK(OTHER[given]), WORK(FADED[wp.float64])

    @wp.func
    def say_none(
        t: wp.ref[Topology],
        world: int,
        x0_grad: wp.array2d(dtype=given),
        us_grad: wp.array3d(dtype=given),
        xs_grad: wp.array3d(dtype=given),
        gain_grad: wp.array4d(dtype=given),
        params_grad: wp.array2d(dtype=given),
    ):
        """No gradient exists: not numbers instead of inventing one."""
        if x0_grad.shape[0] > 0:
            for j in range(x0_grad.shape[1]):
                x0_grad[world, j] = given(wp.NAN)
        if us_grad.shape[0] > 0:
            for n in range(us_grad.shape[1]):
                for j in range(t.nu):
                    us_grad[world, n, j] = given(wp.NAN)
        if xs_grad.shape[0] > 0:
            for n in range(xs_grad.shape[1]):
                for j in range(2 * t.nv):
                    xs_grad[world, n, j] = given(wp.NAN)
        if gain_grad.shape[0] > 0:
            for n in range(gain_grad.shape[1]):
                for i in range(t.nu):
                    for j in range(2 * t.nv):
                        gain_grad[world, n, i, j] = given(wp.NAN)
        if params_grad.shape[0] > 0:
            for j in range(params_grad.shape[1]):
                params_grad[world, j] = given(wp.NAN)

    @wp.func
    def enter(t: wp.ref[Topology], w: wp.ref[View], after: wp.array(dtype=given)):
        """The slopes by the last state."""
        fill(w.grad, w.grad.shape[0], ZERO)
        for j in range(2 * t.nv):
            w.weight[j] = WORK(after[j])

    @wp.func
    def is_the_step(t: wp.ref[Topology], k: wp.ref[Slot], after: wp.array(dtype=given)):
        """Whether the step just solved ends at the recorded velocities."""
        same = int(1)
        largest = ZERO + ONE
        for j in range(t.nv):
            largest = wp.max(largest, wp.abs(k.v0[j]))
        for j in range(t.nv):
            if not (wp.abs(k.v0[j] - WORK(after[t.nv + j])) <= APART * largest):
                same = 0
        return same

    @wp.func
    def hand_back(t: wp.ref[Topology], w: wp.ref[View], asked: wp.array(dtype=given)):
        """The slopes by the state before a step: through it, and of its own."""
        for j in range(t.nv):
            w.weight[j] = w.by_q[j] + WORK(asked[j])
            w.weight[t.nv + j] = w.by_v[j] + WORK(asked[t.nv + j])

    @wp.func
    def skip(w: wp.ref[View], asked: wp.array2d(dtype=given), n: int, most: WORK):
        """The step before n, or n, that something comes back to, and the most that came."""
        at = int(n)
        largest = wp.max(most, sum_of(w.weight))
        while at >= 0 and sum_of(w.weight) <= LEAST * largest:  # nothing, or nothing any more
            for j in range(asked.shape[1]):
                w.weight[j] = WORK(asked[at, j])
            at -= 1
            largest = wp.max(largest, sum_of(w.weight))
        return at, largest

    @wp.func
    def leave(
        t: wp.ref[Topology],
        w: wp.ref[View],
        world: int,
        x0_grad: wp.array2d(dtype=given),
        params_grad: wp.array2d(dtype=given),
    ):
        if x0_grad.shape[0] > 0:
            for j in range(2 * t.nv):
                x0_grad[world, j] = x0_grad[world, j] + given(w.weight[j])
        if params_grad.shape[0] > 0:
            for j in range(w.grad.shape[0]):
                params_grad[world, j] = params_grad[world, j] + given(w.grad[j])

    @of_any_scene(residual != "none")
    def generic_adjoint_kernel(
        first: int,
        base: int,
        t: Topology,
        work: Work,
        s: Groups,
        room: Room,
        params: wp.array2d(dtype=given),
        us: wp.array3d(dtype=given),  # (B, N, nu), as applied
        xs: wp.array3d(dtype=given),  # (0, 1 or B, >= N', nx) of the policy, whose last step is held
        gain: wp.array4d(dtype=given),  # (0, 1 or B, N', nu, nx)
        period: wp.array(dtype=given),  # (nx,)
        lower: wp.array2d(dtype=given),  # (0, 1 or B, nu) limits of the controls
        upper: wp.array2d(dtype=given),
        external: wp.array2d(dtype=given),  # (0 or B, 3 nb)
        states: wp.array3d(dtype=given),  # (B, N+1, nx)
        status: wp.array(dtype=wp.int32),  # (B,)
        states_grad: wp.array3d(dtype=given),  # (B, N+1, nx)
        x0_grad: wp.array2d(dtype=given),  # accumulated (0 or B, nx)
        us_grad: wp.array3d(dtype=given),  # accumulated (0 or B, N or N', nu)
        xs_grad: wp.array3d(dtype=given),  # accumulated (0 or B, >= N', nx)
        gain_grad: wp.array4d(dtype=given),  # accumulated (0 or B, N', nu, nx)
        params_grad: wp.array2d(dtype=given),  # accumulated (0 or B, width)
    ):
        b = first + wp.tid()
        world = base + b
        tracked = wp.where(gain.shape[0] == 1, 0, world)
        bounds = wp.where(lower.shape[0] == 1, 0, world)
        k = view(work, b)
        w = view_of(room, b)
        back.prepare(t, k, params, world)
        enter(t, w, states_grad[world, us.shape[1]])
        n, most = skip(w, states_grad[world], us.shape[1] - 1, ZERO)
        solved = wp.where(status[world] == wp.static(SOLVED), 1, 0)
        while n >= 0 and solved == 1:
            x = states[world, n]
            u = us[world, n]
            solved = back.solve(t, k, w, external, world, x, u) * is_the_step(t, k, states[world, n + 1])
            if solved == 1:
                solved = back.pull(t, s, k, room, w, b, external, world, u)
            if solved == 1:
                hand_back(t, w, states_grad[world, n])
                for i in range(t.nu):
                    by = back.control(t, k, w, i, WORK(u[i]))
                    if lower.shape[0] > 0:
                        if u[i] <= lower[bounds, i] or u[i] >= upper[bounds, i]:
                            by = ZERO
                    if us_grad.shape[0] > 0:
                        at = wp.min(n, us_grad.shape[1] - 1)
                        us_grad[world, at, i] = us_grad[world, at, i] + given(by)
                    if gain.shape[0] > 0:
                        at = wp.min(n, gain.shape[1] - 1)
                        through(tracked, world, at, i, by, x, xs, gain, period, w.weight, xs_grad, gain_grad)
                n, most = skip(w, states_grad[world], n - 1, most)
        if solved == 0 and not (most + sum_of(w.weight) == ZERO):
            say_none(t, world, x0_grad, us_grad, xs_grad, gain_grad, params_grad)
        else:
            leave(t, w, world, x0_grad, params_grad)

    return generic_adjoint_kernel
