"""Rollouts of any scene under a policy, in one launch; made for the policy and the scene's sizes."""

from types import SimpleNamespace

import warp as wp

from ..device.compile import of_any_scene
from ..factories import cached
from ..generic.step import make_step
from ..generic.topology import Topology
from ..generic.work import WORK, Slot, Work, view
from ..policies.contract import PolicyKernel, make_policy
from ..status import SOLVED


@cached
def make_world(given: type, residual: str, nv: int, nu: int) -> SimpleNamespace:
    """A world that is asked and stepped: put(t, k, x), state(t, k) -> x, advance(t, k, external, world, u)
    -> status; `prepare`, `recall`, `impulse` and `far_gap` of `make_step`.
    """
    step = make_step(given, residual)
    VX, VU = wp.types.vector(2 * nv, given), wp.types.vector(max(nu, 1), given)

    @wp.func
    def put(t: wp.ref[Topology], k: wp.ref[Slot], x: VX):
        for j in range(t.nv):
            k.q[j] = WORK(x[j])
            k.v0[j] = WORK(x[nv + j])

    @wp.func
    def state(t: wp.ref[Topology], k: wp.ref[Slot]):
        x = VX()
        for j in range(t.nv):
            x[j] = given(k.q[j])
            x[nv + j] = given(k.v0[j])
        return x

    @wp.func
    def advance(t: wp.ref[Topology], k: wp.ref[Slot], external: wp.array2d(dtype=given), world: int, u: VU):
        step.begin(t, k, external, world)
        for i in range(t.nu):
            step.control_force(t, k, i, WORK(u[i]))
        return step.solve_step(t, k)

    return SimpleNamespace(step=step, put=put, state=state, advance=advance)


@cached
def make_policy_rollout_kernel(
    given: type, residual: str, nv: int, nu: int, policy: PolicyKernel
) -> wp.Kernel:
    """Roll every world out under a policy, as `step/rollout.py` does with specialised kernels."""
    one = make_world(given, residual, nv, nu)
    asked = make_policy(policy, 2 * nv, nu, given)
    Policy = asked.Struct

    @of_any_scene(residual != "none")
    def generic_policy_kernel(
        first: int,
        base: int,
        exact_gap: int,
        t: Topology,
        work: Work,
        params: wp.array2d(dtype=given),
        x0: wp.array2d(dtype=given),  # (B, nx)
        control: Policy,
        external: wp.array2d(dtype=given),  # (0 or B, 3 nb), constant over the rollout
        states: wp.array3d(dtype=given),  # out (B, N+1, nx)
        controls: wp.array3d(dtype=given),  # out (0 or B, N, nu)
        impulse: wp.array3d(dtype=given),  # out (0 or B, N, nr)
        gap: wp.array3d(dtype=given),  # out (0 or B, N, nr)
        status: wp.array(dtype=wp.int32),  # in and out (B,): a world that comes in unsolved stays where it is
    ):
        b = first + wp.tid()
        world = base + b
        k = view(work, b)
        for j in range(t.nv):
            k.q[j] = WORK(x0[world, j])
            k.v0[j] = WORK(x0[world, nv + j])
        one.step.prepare(t, k, params, world)
        x = one.state(t, k)
        memory = asked.begin(control, world, x)
        code = status[world]
        for j in range(2 * t.nv):
            states[world, 0, j] = x[j]
        for n in range(states.shape[1] - 1):
            if code == wp.static(SOLVED):
                u, memory = asked.ask(control, world, n, x, memory)
                code = one.advance(t, k, external, world, u)
                if code == wp.static(SOLVED):
                    x = one.state(t, k)
                    if controls.shape[0] > 0:
                        for i in range(t.nu):
                            controls[world, n, i] = u[i]
                    if wp.static(residual != "none"):
                        one.step.record(t, k, world, n, impulse, gap)
            for j in range(2 * t.nv):
                states[world, n + 1, j] = x[j]
        status[world] = code

    return generic_policy_kernel
