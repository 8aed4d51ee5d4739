"""Rollouts of DDP with the generic step: a trajectory for every problem and step size, without its cost.

The dynamics are compiled once for all scenes; what a trajectory costs is another kernel's
(`candidate_costs.py`).
"""

import warp as wp

from ..device.compile import of_any_scene
from ..factories import cached
from ..generic.step import make_step
from ..generic.topology import Topology
from ..generic.work import WORK, Slot, Work, view
from ..status import NONFINITE, SOLVED
from .rollouts import make_candidate_arrays, make_limited
from .solver_state import make_policy_arrays

FOLLOW, SHOOT, GIVEN = range(3)  # what a trajectory's controls are


@cached
def make_candidates_kernel(given: type, residual: str) -> wp.Kernel:
    """As `rollouts.make_rollout_kernel`, of states, controls and status alone: item i, in slot i - base, is
    problem i mod B under step size i div B (FOLLOW), the steps from the states that the policy holds (SHOOT),
    or problem i mod B under the controls that candidate i div B holds (GIVEN).
    """
    step = make_step(given, residual)
    Policy, Candidates = make_policy_arrays(given), make_candidate_arrays(given)
    ONE, limited = WORK(1.0), make_limited(given)

    @wp.func
    def control(
        t: wp.ref[Topology], k: wp.ref[Slot], policy: Policy, out: Candidates, p: int, a: int, n: int, i: int
    ):
        """u_i = clamp(us + alpha k + K (x - xs))"""
        value = WORK(policy.us[p, n, i]) + WORK(out.step_sizes[a]) * WORK(policy.k[p, n, i])
        for j in range(t.nv):
            gain = WORK(policy.K[p, n, i, j])
            value += gain * (k.q[j] - WORK(policy.xs[p, n, j]))
            gain = WORK(policy.K[p, n, i, t.nv + j])
            value += gain * (k.v0[j] - WORK(policy.xs[p, n, t.nv + j]))
        row = wp.where(policy.lower.shape[0] == 1, 0, p)
        low, high = policy.lower[row, i], policy.upper[row, i]
        return limited(given(value), policy.us[p, n, i], low, high)

    @wp.func
    def take(t: wp.ref[Topology], k: wp.ref[Slot], x: wp.array(dtype=given)):
        for j in range(t.nv):
            k.q[j] = WORK(x[j])
            k.v0[j] = WORK(x[t.nv + j])

    @wp.func
    def leave_gap(t: wp.ref[Topology], k: wp.ref[Slot], gap: wp.array(dtype=given), left: WORK):
        """Less the share of a gap that stays open; 1 if the state is finite."""
        good = int(1)
        for j in range(t.nv):
            q = k.q[j] - left * WORK(gap[j])
            v = k.v0[j] - left * WORK(gap[t.nv + j])
            if not (wp.isfinite(q) and wp.isfinite(v)):
                good = 0
            k.q[j] = q
            k.v0[j] = v
        return good

    @of_any_scene(residual != "none")
    def generic_candidates_kernel(
        first: int,
        base: int,
        mode: int,
        t: Topology,
        work: Work,
        problems: int,
        x0: wp.array2d(dtype=given),
        policy: Policy,
        out: Candidates,
        params: wp.array2d(dtype=given),
        external: wp.array2d(dtype=given),
        active: wp.array(dtype=wp.int32),
    ):
        slot = first + wp.tid()
        a = (base + slot) / problems
        p = base + slot - a * problems
        if active[p] == 0:
            return
        left = WORK(0.0)
        if mode == wp.static(FOLLOW):
            left = ONE - WORK(out.step_sizes[a])
        k = view(work, slot)
        step.prepare(t, k, params, p)
        take(t, k, x0[p])
        for j in range(2 * t.nv):
            out.xs[p, a, 0, j] = x0[p, j]
        status = int(wp.static(SOLVED))
        for n in range(out.us.shape[2]):
            if mode == wp.static(SHOOT):
                take(t, k, policy.xs[p, n])
            if status == wp.static(SOLVED) or mode == wp.static(SHOOT):
                step.begin(t, k, external, p)
                for i in range(t.nu):
                    u = out.us[p, a, n, i]
                    if mode == wp.static(SHOOT):
                        u = policy.us[p, n, i]
                    if mode == wp.static(FOLLOW):
                        u = control(t, k, policy, out, p, a, n, i)
                    out.us[p, a, n, i] = u
                    step.control_force(t, k, i, WORK(u))
                code = step.solve_step(t, k)
                if code != wp.static(SOLVED):
                    status = code
                    step.forget(t, k)
                elif policy.gaps.shape[0] > 0 and mode == wp.static(FOLLOW):
                    if leave_gap(t, k, policy.gaps[p, n], left) == 0:
                        status = wp.static(NONFINITE)
            for j in range(t.nv):
                out.xs[p, a, n + 1, j] = given(k.q[j])
                out.xs[p, a, n + 1, t.nv + j] = given(k.v0[j])
        out.status[p, a] = status

    return generic_candidates_kernel
