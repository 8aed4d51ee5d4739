"""Step and rollout kernels that serve any scene by tables: compiled once per precision and residual.

The same inputs, outputs and meaning as the kernels of `step/rollout.py` (specialised on a scene), with the
scene in tables and a world's state in a workspace.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import COLD
from ..device.compile import specialised
from ..factories import cached
from ..method import Method
from ..status import INFEASIBLE, JAMMED, NONFINITE, NOT_CONVERGED, SOLVED
from .contact import make_contact
from .coulomb import COULOMB_PASSES, RETREATS, make_coulomb
from .envelope import make_envelope
from .interior import make_solver
from .jam import make_jam
from .mechanism import COLUMN, make_mechanism
from .topology import CONTACT, Topology
from .work import WORK, Work


def residual_of(method: Method, rows: int) -> str:
    """What the kernels are specialised on: the residual, or that there is no contact to solve."""
    return method.residual if rows else "none"


@cached
def make_step(given: type, residual: str) -> SimpleNamespace:
    """Warp functions of a step on a world's workspace; residual "none" leaves the solver out."""
    dtype = WORK
    mech = make_mechanism(given)
    env = make_envelope(dtype)
    contact = make_contact(given, residual) if residual != "none" else None
    solver = make_solver(given, residual) if residual != "none" else None
    friction = make_coulomb(given) if residual == "hard" else None
    jammed = make_jam(given) if residual == "hard" else None
    PASSES = COULOMB_PASSES
    H, FRICTION = COLUMN["step_size"], COLUMN["friction"]
    UNUSED, HALF, ZERO, ONE = dtype(COLD), dtype(0.5), dtype(0.0), dtype(1.0)
    NOWHERE = dtype(-1e30)
    number = mech.number

    @wp.func
    def begin(
        t: Topology,
        k: Work,
        params: wp.array2d(dtype=given),
        row: int,
        b: int,
        external: wp.array2d(dtype=given),
        world: int,
    ):
        """Kinematics, M and the forces but the controls' of the state (k.q, k.v0)."""
        mech.frames(t, k, params, row, b)
        mech.dynamics(t, k, params, row, b, external, world)
        mech.springs(t, k, params, row, b)

    @wp.func
    def free_motion(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int):
        """v_free = v + h M^-1 (r + u)."""
        for i in range(k.mass.shape[0]):
            k.mass_factor[i, b] = k.mass[i, b]
        env.factor(k.mass_factor, t.mass_first, t.mass_at, t.nv, b)
        env.solve(k.mass_factor, t.mass_first, t.mass_at, k.move, t.nv, b)
        h = number(t, params, row, H, 0)
        for j in range(t.nv):
            p = t.place[j]
            k.vfree[p, b] = k.v0[j, b] + h * k.move[p, b]
            k.v[p, b] = k.vfree[p, b]

    @wp.func
    def list_rows(t: Topology, k: Work, b: int):
        """List the acting rows in k.active; rows that are new start from k.v."""
        n = int(0)
        for i in range(t.nr):
            if k.acting[i, b] > 0:
                k.active[n, b] = i
                n += 1
                if k.acting[i, b] == 1:
                    if not (wp.abs(k.z[i, b]) < HALF * UNUSED):
                        k.z[i, b] = -k.rate[i, b] - contact.velocity(t, k, b, i)
                    k.acting[i, b] = 2
        return n

    @wp.func
    def contacts(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, exact_gap: int):
        """Add rows until none is missing, solve after every addition. The first time also those within reach
        of the largest approach are added: in a heap they act next. Where Coulomb's friction shuts the rows,
        the problem without friction tells whether they can open, and gives a lift to start from; where
        that ends at shut rows again the lift is taken back.
        """
        contact.start(t, k, params, row, b)
        status = int(wp.static(SOLVED))
        margin = ZERO + NOWHERE
        looking = int(1)
        rounded = int(0)
        more = int(1)
        passes = int(0)  # of the fixed point; negative: go back
        rub = dtype(1.0)
        freed = int(0)  # rows in the system when friction was last left out
        n = int(0)
        while more == 1:  # the first pass only looks how large the approach is
            added, approach = contact.grow(t, k, params, row, b, exact_gap, margin, rub)
            if looking == 1:
                looking = 0
                margin = approach
            else:
                n = list_rows(t, k, b)
                more = wp.where(added > 0 or rub < ONE, 1, 0)
                if wp.static(residual == "hard"):
                    if t.coulomb == 1 and n > 0:
                        more = wp.max(more, friction.lift(t, k, b, n, passes))
                        passes = wp.abs(passes) + 1
                if more == 1:
                    if rounded == 0:
                        solver.rounding(t, k, b)
                        rounded = 1
                    status = solver.solve(t, k, params, row, b, n)
                    margin = dtype(0.0)
                    if passes > PASSES and status == wp.static(SOLVED):
                        status = int(wp.static(NOT_CONVERGED))
                    if wp.static(residual == "hard"):
                        if rub < ONE and status == wp.static(SOLVED):
                            rub = dtype(1.0)
                            passes = 0
                            contact.set_friction(t, k, params, row, b, rub)
                        elif t.coulomb == 1 and rub == ONE and status != wp.static(SOLVED):
                            if n > freed and status != wp.static(NONFINITE):
                                freed = n
                                margin = -NOWHERE  # rows that press may free what is jammed without them
                                rub = dtype(0.0)
                                status = int(wp.static(SOLVED))
                                contact.set_friction(t, k, params, row, b, rub)
                            elif jammed(t, k, b, n, number(t, params, row, H, 0)) == 1:
                                status = int(wp.static(JAMMED))
                            elif status == wp.static(INFEASIBLE):
                                status = int(wp.static(SOLVED))
                                passes = -passes - wp.static(COULOMB_PASSES // RETREATS)
                                if passes < -PASSES:
                                    status = int(wp.static(NOT_CONVERGED))
                            if status == wp.static(SOLVED):
                                for j in range(t.nv):
                                    k.v[j, b] = k.vfree[j, b]
                    if status != wp.static(SOLVED):
                        more = 0
        for i in range(t.nr):
            if k.acting[i, b] == 0:
                k.z[i, b] = UNUSED
        return status

    @wp.func
    def impulse(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, i: int):
        """What row i reports: lambda, and with Coulomb friction the normal, then the tangential impulse."""
        if t.coulomb == 0 or t.row_sign[i] == 0 or t.row_kind[i] != CONTACT:
            return k.lam[i, b]
        pair = t.row_index[i]
        plus = k.lam[t.pair_row[pair], b]
        minus = k.lam[t.pair_row[pair] + 1, b]
        if t.row_sign[i] > 0:
            return plus + minus
        return number(t, params, row, FRICTION, pair) * (plus - minus)

    @wp.func
    def solve_step(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, exact_gap: int):
        """k.v = v' and, on success, the next state in (k.q, k.v0); the status."""
        free_motion(t, k, params, row, b)
        status = int(wp.static(SOLVED))
        if wp.static(residual != "none"):
            status = contacts(t, k, params, row, b, exact_gap)
        if status == wp.static(SOLVED):
            h = number(t, params, row, H, 0)
            for j in range(t.nv):
                v = k.v[t.place[j], b]
                if not (wp.isfinite(v) and wp.isfinite(k.q[j, b] + h * v)):
                    status = wp.static(NONFINITE)
            if status == wp.static(SOLVED):
                for j in range(t.nv):
                    k.v0[j, b] = k.v[t.place[j], b]
                    k.q[j, b] = k.q[j, b] + h * k.v0[j, b]
        return status

    return SimpleNamespace(
        begin=begin, solve_step=solve_step, impulse=impulse, control_force=mech.control_force
    )


@cached
def make_step_kernel(given: type, residual: str) -> wp.Kernel:
    """One step of every world with all of its outputs (gaps exact); world - base is the slot."""
    step = make_step(given, residual)
    UNUSED, ZERO = WORK(COLD), WORK(0.0)
    H = COLUMN["step_size"]

    @specialised
    def generic_step_kernel(
        first: int,
        base: int,
        t: Topology,
        k: Work,
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
        row = wp.where(params.shape[0] == 1, 0, world)
        for j in range(t.nv):
            k.q[j, b] = WORK(x[world, j])
            k.v0[j, b] = WORK(x[world, t.nv + j])
        for i in range(t.nr):
            k.z[i, b] = UNUSED
            if warm.shape[0] > 0:
                k.z[i, b] = WORK(warm[world, i])
        for i in range(t.pairs):
            nx = ZERO
            ny = ZERO
            if warm.shape[0] > 0:
                nx = WORK(warm[world, t.nr + 2 * i])
                ny = WORK(warm[world, t.nr + 2 * i + 1])
                norm = wp.sqrt(nx * nx + ny * ny)
                if norm > ZERO:
                    nx = nx / norm
                    ny = ny / norm
            k.normal[2 * i, b] = nx
            k.normal[2 * i + 1, b] = ny
        step.begin(t, k, params, row, b, external, world)
        for i in range(t.nu):
            step.control_force(t, k, params, row, b, i, WORK(u[world, i]))
        code = step.solve_step(t, k, params, row, b, 1)
        for j in range(t.nv):
            state[world, j] = given(k.q[j, b])
            state[world, t.nv + j] = given(k.v0[j, b])
        solved = code == wp.static(SOLVED)
        for i in range(t.nr):
            impulse[world, i] = given(wp.where(solved, step.impulse(t, k, params, row, b, i), ZERO))
            gap[world, i] = given(k.gap[i, b] * WORK(params[row, t.columns[H]]))
            multiplier[world, i] = given(wp.where(solved, k.z[i, b], UNUSED))
        for i in range(2 * t.pairs):
            multiplier[world, t.nr + i] = given(wp.where(solved, k.normal[i, b], ZERO))
        status[world] = code

    return generic_step_kernel


@cached
def make_rollout_kernel(given: type, residual: str) -> wp.Kernel:
    """Roll every world out under its controls, as `rollout.make_rollout_kernel` does under an open loop."""
    step = make_step(given, residual)
    UNUSED, ZERO = WORK(COLD), WORK(0.0)
    H = COLUMN["step_size"]

    @specialised
    def generic_rollout_kernel(
        first: int,
        base: int,
        exact_gap: int,
        t: Topology,
        k: Work,
        params: wp.array2d(dtype=given),
        x0: wp.array2d(dtype=given),  # (B, nx)
        us: wp.array3d(dtype=given),  # (B, N, nu)
        external: wp.array2d(dtype=given),  # (0 or B, 3 nb), constant over the rollout
        states: wp.array3d(dtype=given),  # out (B, N+1, nx)
        controls: wp.array3d(dtype=given),  # out (0 or B, N, nu)
        impulse: wp.array3d(dtype=given),  # out (0 or B, N, nr)
        gap: wp.array3d(dtype=given),  # out (0 or B, N, nr)
        status: wp.array(dtype=wp.int32),  # out (B,)
    ):
        b = first + wp.tid()
        world = base + b
        row = wp.where(params.shape[0] == 1, 0, world)
        for j in range(t.nv):
            k.q[j, b] = WORK(x0[world, j])
            k.v0[j, b] = WORK(x0[world, t.nv + j])
            states[world, 0, j] = x0[world, j]
            states[world, 0, t.nv + j] = x0[world, t.nv + j]
        for i in range(t.nr):
            k.z[i, b] = UNUSED
        for i in range(2 * t.pairs):
            k.normal[i, b] = ZERO
        code = int(wp.static(SOLVED))
        for n in range(states.shape[1] - 1):
            if code == wp.static(SOLVED):
                step.begin(t, k, params, row, b, external, world)
                for i in range(t.nu):
                    step.control_force(t, k, params, row, b, i, WORK(us[world, n, i]))
                code = step.solve_step(t, k, params, row, b, exact_gap)
                if code == wp.static(SOLVED):
                    if controls.shape[0] > 0:
                        for i in range(t.nu):
                            controls[world, n, i] = us[world, n, i]
                    if impulse.shape[0] > 0:
                        for i in range(t.nr):
                            impulse[world, n, i] = given(step.impulse(t, k, params, row, b, i))
                    if gap.shape[0] > 0:
                        for i in range(t.nr):
                            gap[world, n, i] = given(k.gap[i, b] * WORK(params[row, t.columns[H]]))
            for j in range(t.nv):
                states[world, n + 1, j] = given(k.q[j, b])
                states[world, n + 1, t.nv + j] = given(k.v0[j, b])
        status[world] = code

    return generic_rollout_kernel
