"""Step and rollout kernels that serve any scene by tables: compiled once per precision and residual.

The same inputs, outputs and meaning as the kernels of `step/rollout.py` (specialised on a scene), with the
scene in tables and a world's state in a workspace.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import COLD
from ..device.compile import of_any_scene
from ..factories import cached
from ..method import Method
from ..status import INFEASIBLE, NONFINITE, NOT_CONVERGED, SOLVED
from .contact import AFRESH, AGAIN, ALL, JOINING, make_contact
from .friction.direct import MOST_LOOKS
from .island import make_island
from .judge.beside import MOST_BESIDE, MOST_RUBBING, make_beside
from .motion.free_motion import make_free_motion
from .motion.mechanism import COLUMN, make_mechanism
from .motion.tendons import make_tendons
from .motion.whole import make_whole
from .newton import make_newton
from .order import make_order
from .rows.recorded import make_recorded
from .topology import Topology
from .work import BESIDE, ISLANDS, LED, LOOKS, ROUNDED, ROWS, V2, WORK, Slot, Work, island, view


def residual_of(method: Method, rows: int) -> str:
    """What the kernels are specialised on: the residual, or that there is no contact to solve."""
    return method.residual if rows else "none"


@cached
def make_step(given: type, residual: str) -> SimpleNamespace:
    """Warp functions of a step on a world's workspace; residual "none" leaves the solver out."""
    dtype = WORK
    mech = make_mechanism(given)
    motion, tendons, whole = make_free_motion(given), make_tendons(given), make_whole(given)
    contact = make_contact(given, residual) if residual != "none" else None
    beside = make_beside(given)
    settle = make_island(given, residual) if residual != "none" else None
    rounding = make_newton(given, residual).rounding if residual != "none" else None
    rearrange = make_order().rearrange
    recorded = make_recorded(given, residual)
    H = COLUMN["step_size"]
    LOWER, UPPER = COLUMN["lower"], COLUMN["upper"]
    UNUSED = dtype(COLD)
    number = mech.number

    @wp.func
    def forget(t: wp.ref[Topology], k: wp.ref[Slot]):
        """No z and no normals to start from."""
        for i in range(t.nr):
            k.warm[i] = UNUSED
        for r in range(k.count[wp.static(ROWS)]):
            k.z[r] = UNUSED
        for i in range(t.pairs):
            k.normal[i] = V2()
        k.count[wp.static(LED)] = 0

    @wp.func
    def prepare(t: wp.ref[Topology], k: wp.ref[Slot], params: wp.array2d(dtype=given), world: int):
        """What does not change from step to step; nothing to start from."""
        row = wp.where(params.shape[0] == 1, 0, world)
        for i in range(params.shape[1]):
            k.numbers[i] = dtype(params[row, i])
        forget(t, k)
        if wp.static(residual != "none"):
            contact.place_shapes(t, k)

    @wp.func
    def recall(t: wp.ref[Topology], k: wp.ref[Slot], warm: wp.array2d(dtype=given), world: int):
        """z and normals to start from, of (B, nr + 2 pairs)."""
        for i in range(t.nr):
            k.warm[i] = dtype(warm[world, i])
        for r in range(k.count[wp.static(ROWS)]):
            k.z[r] = k.warm[k.row[r]]
            k.warm[k.row[r]] = UNUSED
        for i in range(t.pairs):
            n = V2(dtype(warm[world, t.nr + 2 * i]), dtype(warm[world, t.nr + 2 * i + 1]))
            k.normal[i] = wp.normalize(n)
        k.count[wp.static(LED)] = 1

    @wp.func
    def begin(t: wp.ref[Topology], k: wp.ref[Slot], external: wp.array2d(dtype=given), world: int):
        """Kinematics, M and the forces but the controls' of the state (k.q, k.v0)."""
        mech.frames(t, k)
        mech.dynamics(t, k, external, world)
        mech.springs(t, k)
        tendons.act(t, k)

    @wp.func
    def excluded(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Whether a degree of freedom has limits that exclude each other: no velocity opens both, however
        little they cross.
        """
        for n in range(1, t.limits):
            j = t.row_index[t.limit_row[n]]
            if t.row_index[t.limit_row[n - 1]] == j:
                if number(t, k, LOWER, j) > number(t, k, UPPER, j):
                    return True
        return False

    @wp.func(inline=False)
    def contacts(t: wp.ref[Topology], k: wp.ref[Slot], patient: int):
        """Solve the islands of the near pairs until no pair joins them. What did not converge under Coulomb's
        friction is solved again, from where that ended and with more patience. Rows that press may free what
        is jammed without them, with what bodies of other islands bring: before it is given up, all pairs
        join, and at once where no more than the rounding of impulses is too much, which more rows may allow.
        Rows that no velocity opens stay INFEASIBLE whatever joins them.
        """
        contact.move_shapes(t, k)
        if t.bounces == 1:
            contact.forget_bounces(t, k)
        if t.overlaps == 1:
            contact.overlaps.forget(t, k)
        rounding(t, k)
        status = int(wp.static(SOLVED))
        which = int(wp.static(AFRESH))
        k.count[wp.static(LOOKS)] = patient
        more = int(1)
        while more == 1:
            changed = contact.look(t, k, which)
            more = int(changed)
            if changed == 1:
                rearrange(t, k)
            if changed == 1 or which == wp.static(AFRESH) or which == wp.static(AGAIN):
                more = int(1)
                status = int(wp.static(SOLVED))
                for i in range(k.count[wp.static(ISLANDS)]):
                    code = settle(t, k, island(k, i))  # of all: their gaps are given back
                    if status == wp.static(SOLVED):
                        status = code
            if status == wp.static(SOLVED):
                which = wp.where(which == wp.static(ALL), which, wp.static(JOINING))
            elif t.coulomb == 0 or status == wp.static(NONFINITE) or status == wp.static(INFEASIBLE):
                more = int(0)
            elif k.count[wp.static(ROUNDED)] == 1:
                k.count[wp.static(ROUNDED)] = 2
                which = int(wp.static(ALL))
            elif which == wp.static(ALL) or (patient == 0 and status == wp.static(NOT_CONVERGED)):
                more = int(0)
            else:
                looks = k.count[wp.static(LOOKS)]
                again = status == wp.static(NOT_CONVERGED) and looks < MOST_LOOKS
                which = wp.where(again, wp.static(AGAIN), wp.static(ALL))
                k.count[wp.static(LOOKS)] = wp.where(again, looks + 1, 0)
                more = int(1)
        if status != wp.static(NONFINITE) and t.overlaps == 0 and excluded(t, k):
            status = int(wp.static(INFEASIBLE))
        return status

    @wp.func
    def set_out(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.v = v_free; where pairs may bounce that by which they do, whatever yields in this solution."""
        start = wp.where(t.limited > 0 and t.bounces == 1, t.blocks, 0)
        for i in range(t.blocks):
            k.v[i] = k.vfree[start + i]

    @wp.func
    def afresh(t: wp.ref[Topology], k: wp.ref[Slot], patient: int):
        """`contacts` from nothing."""
        forget(t, k)
        set_out(t, k)
        return contacts(t, k, patient)

    @wp.func
    def contacts_or_afresh(t: wp.ref[Topology], k: wp.ref[Slot]):
        """`contacts`, and once more from nothing what does not converge from where the last step led: what
        fails in a rollout fails by itself, too. What fails so is solved a rounding beside its gaps: where
        many touch exactly, and nothing presses, no set of rows is better than the next. Patience, which only
        Coulomb's friction asks for, is dearer than that, and comes last.
        """
        led = k.count[wp.static(LED)]
        k.count[wp.static(ROUNDED)] = wp.where(t.overlaps == 1, 2, 0)
        beside.forget(t, k)
        status = contacts(t, k, 0)
        k.count[wp.static(ROUNDED)] = 2
        if status == wp.static(NOT_CONVERGED) and led == 1:
            beside.forget(t, k)
            status = afresh(t, k, 0)
        rubs = t.coulomb == 1 and t.nr > t.pairs + t.limits
        most = wp.where(rubs, wp.static(MOST_RUBBING), wp.static(MOST_BESIDE))
        while status == wp.static(NOT_CONVERGED) and k.count[wp.static(BESIDE)] < most:
            k.count[wp.static(BESIDE)] = k.count[wp.static(BESIDE)] + 1
            status = afresh(t, k, 0)
        if status == wp.static(NOT_CONVERGED) and t.coulomb == 1:
            beside.forget(t, k)
            status = afresh(t, k, 1)
        k.count[wp.static(LED)] = 1
        return status

    @wp.func
    def given_numbers(t: wp.ref[Topology], k: wp.ref[Slot]):
        """NONFINITE where q or v_free is: gaps or momenta of such worlds are no problem to solve."""
        for j in range(t.nv):
            if not (wp.isfinite(k.q[j]) and wp.isfinite(k.vfree[t.dof_block[j]][t.dof_part[j]])):
                return int(wp.static(NONFINITE))
        return int(wp.static(SOLVED))

    @wp.func
    def touching(t: wp.ref[Topology], k: wp.ref[Slot], first: int, last: int):
        """Euler's part (0) of a step and the leapfrog's (1), from one to another; k.v = v', the status."""
        status = int(wp.static(SOLVED))
        for part in range(first, last + 1):
            changed = int(1)
            if part == 0:
                motion.euler(t, k)
                set_out(t, k)
            elif status == wp.static(SOLVED):
                changed = motion.leap_on(t, k)
            if changed == 1 and status == wp.static(SOLVED):
                status = given_numbers(t, k)
                if status == wp.static(SOLVED):
                    status = contacts_or_afresh(t, k)
        return status

    # `solve_step` repeats it: called there it takes 209 registers on sm_90, where 208 are allowed
    @wp.func
    def free(t: wp.ref[Topology], k: wp.ref[Slot], first: int, last: int):
        """The same where nothing touches."""
        if first == 0:
            motion.euler(t, k)
        if last == 1:
            motion.leap(t, k)
        for i in range(t.blocks):
            k.v[i] = k.vfree[i]
        return int(wp.static(SOLVED))

    solve = touching if residual != "none" else free

    @wp.func
    def solve_step(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.v = v' and, on success, the next state in (k.q, k.v0); the status."""
        status = int(wp.static(SOLVED))
        if wp.static(residual != "none"):
            whole.keep(t, k)
        if t.limited > 0:
            tendons.loosen(t, k)
        if wp.static(residual != "none"):
            if t.limited > 0:
                tendons.prepare(t, k)
            more = int(1)
            while more == 1:
                status = touching(t, k, 0, t.leapfrog)
                more = int(0)
                if t.limited > 0 and status == wp.static(SOLVED):
                    more = tendons.settle(t, k, 0)
        else:
            motion.euler(t, k)
            if t.leapfrog == 1:
                motion.leap(t, k)
            for i in range(t.blocks):
                k.v[i] = k.vfree[i]
        if status == wp.static(SOLVED):
            h = number(t, k, H, 0)
            for j in range(t.nv):
                v = k.v[t.dof_block[j]][t.dof_part[j]]
                if not (wp.isfinite(v) and wp.isfinite(k.q[j] + h * v)):
                    status = wp.static(NONFINITE)
            if t.limited > 0:  # looked at here, for 208 registers on sm_90
                if tendons.is_settled(t, k) == 0:
                    status = wp.static(NOT_CONVERGED)
            if status == wp.static(SOLVED):
                for j in range(t.nv):
                    k.v0[j] = k.v[t.dof_block[j]][t.dof_part[j]]
                    k.q[j] = k.q[j] + h * k.v0[j]
        return status

    return SimpleNamespace(
        prepare=prepare,
        record=recorded.record,
        forget=forget,
        recall=recall,
        begin=begin,
        solve=solve,
        solve_step=solve_step,
        impulse=recorded.reported,
        far_gap=recorded.far_gap,
        row_gap=recorded.row_gap,
        control_force=tendons.control_force,
    )


@cached
def make_step_kernel(given: type, residual: str) -> wp.Kernel:
    """One step of every world with all of its outputs (gaps exact); world - base is the slot."""
    step = make_step(given, residual)
    UNUSED, ZERO = WORK(COLD), WORK(0.0)

    @of_any_scene(residual != "none")
    def generic_step_kernel(
        first: int,
        base: int,
        t: Topology,
        work: Work,
        params: wp.array2d(dtype=given),
        x: wp.array2d(dtype=given),  # (B, nx)
        u: wp.array2d(dtype=given),  # (B, nu)
        external: wp.array2d(dtype=given),  # (0 or B, 3 nb)
        warm: wp.array2d(dtype=given),  # (0 or B, nr + 2 pairs)
        state: wp.array2d(dtype=given),  # out (B, nx)
        impulse: wp.array2d(dtype=given),  # out (B, nr)
        gap: wp.array2d(dtype=given),  # out (B, nr)
        multiplier: wp.array2d(dtype=given),  # out (B, nr + 2 pairs)
        status: wp.array(dtype=wp.int32),  # out (B,)
    ):
        b = first + wp.tid()
        world = base + b
        k = view(work, b)
        for j in range(t.nv):
            k.q[j] = WORK(x[world, j])
            k.v0[j] = WORK(x[world, t.nv + j])
        step.prepare(t, k, params, world)
        if warm.shape[0] > 0:
            step.recall(t, k, warm, world)
        step.begin(t, k, external, world)
        for i in range(t.nu):
            step.control_force(t, k, i, WORK(u[world, i]))
        code = step.solve_step(t, k)
        for j in range(t.nv):
            state[world, j] = given(k.q[j])
            state[world, t.nv + j] = given(k.v0[j])
        solved = code == wp.static(SOLVED)
        if wp.static(residual != "none"):
            for i in range(t.nr):
                impulse[world, i] = given(ZERO)
                multiplier[world, i] = given(UNUSED)
            for pair in range(t.pairs):
                if k.known[pair] == 0:
                    far = given(step.far_gap(t, k, pair))
                    for i in range(t.pair_row[pair], t.pair_row[pair + 1]):
                        gap[world, i] = far
            for r in range(k.count[wp.static(ROWS)]):
                i = k.row[r]
                gap[world, i] = given(step.row_gap(t, k, r))
                if solved:
                    impulse[world, i] = given(step.impulse(t, k, r))
                    multiplier[world, i] = given(k.z[r])
            for i in range(t.pairs):
                for j in range(2):
                    multiplier[world, t.nr + 2 * i + j] = given(wp.where(solved, k.normal[i][j], ZERO))
        status[world] = code

    return generic_step_kernel


@cached
def make_rollout_kernel(given: type, residual: str) -> wp.Kernel:
    """Roll every world out under its controls, as `rollout.make_rollout_kernel` does under an open loop."""
    step = make_step(given, residual)

    @of_any_scene(residual != "none")
    def generic_rollout_kernel(
        first: int,
        base: int,
        exact_gap: int,
        t: Topology,
        work: Work,
        params: wp.array2d(dtype=given),
        x0: wp.array2d(dtype=given),  # (B, nx)
        us: wp.array3d(dtype=given),  # (B, N, nu)
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
            k.v0[j] = WORK(x0[world, t.nv + j])
            states[world, 0, j] = x0[world, j]
            states[world, 0, t.nv + j] = x0[world, t.nv + j]
        step.prepare(t, k, params, world)
        code = status[world]
        for n in range(states.shape[1] - 1):
            if code == wp.static(SOLVED):
                step.begin(t, k, external, world)
                for i in range(t.nu):
                    step.control_force(t, k, i, WORK(us[world, n, i]))
                code = step.solve_step(t, k)
                if code == wp.static(SOLVED):
                    if controls.shape[0] > 0:
                        for i in range(t.nu):
                            controls[world, n, i] = us[world, n, i]
                    if wp.static(residual != "none"):
                        step.record(t, k, world, n, impulse, gap)
            for j in range(t.nv):
                states[world, n + 1, j] = given(k.q[j])
                states[world, n + 1, t.nv + j] = given(k.v0[j])
        status[world] = code

    return generic_rollout_kernel
