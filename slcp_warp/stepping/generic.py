"""Launches of the generic kernels, which serve any scene by tables; a workspace keeps a world's state."""

import contextlib
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Generic, TypeVar

import warp as wp

from slcp_warp.kernels.control.generic_rollouts import make_candidates_kernel
from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.ensembles.generic_rollout import make_policy_rollout_kernel
from slcp_warp.kernels.generic import step as generic_step
from slcp_warp.kernels.generic.derivatives import linearize, tables
from slcp_warp.kernels.generic.topology import make_topology
from slcp_warp.kernels.generic.work import allocate_work, bytes_per_world
from slcp_warp.kernels.gradients.generic import curves, room
from slcp_warp.kernels.gradients.generic.adjoint import make_generic_adjoint_kernel
from slcp_warp.kernels.gradients.generic.curvature import make_curvature_kernel
from slcp_warp.kernels.policies.tracking import make_tracking
from slcp_warp.kernels.specialisation import Specialisation

from ..gradients import tape
from ..gradients.checkpoint import checkpointed
from .arrays import Controls, RolloutArrays, StepArrays
from .host import Asked
from .single import rollout_by_steps
from .specialised import taped_policy
from .taped import record_rollout, record_step

RUN = 8  # steps that one thread of a CPU linearises, each from the roots of the one before
WORKSPACE_BYTES = 256 * 2**20  # worlds are stepped in chunks whose workspaces fit in here
WORKSPACE_SHARE = 16  # or in one of so many parts of a GPU's memory: there all worlds of a chunk step at once


Space = TypeVar("Space")


class Workspaces(Generic[Space]):
    """Workspaces of one scene on one device, each lent to one call at a time; some are kept for later calls.

    On a GPU they belong to the stream that they were used on, whose order keeps calls apart.

    Args:
        allocate: makes one of so many slots.
        size: bytes of a slot.
    """

    def __init__(self, allocate: Callable[[int], Space], size: int, device: Any) -> None:
        self._allocate, self.device = allocate, wp.get_device(device)
        self.most = max(1, workspace_bytes(self.device) // size)  # slots of a workspace, and of those kept
        self._lock = threading.Lock()
        self._kept: dict[int, tuple[Any, list[tuple[int, Space]]]] = {}  # by stream, which it keeps alive

    @contextlib.contextmanager
    def lend(self, slots: int) -> Iterator[Space]:
        """A workspace of at least that many slots that no other call has."""
        stream = self.device.stream if self.device.is_cuda else None
        with self._lock:
            _, kept = self._kept.setdefault(stream.cuda_stream if stream else 0, (stream, []))
            size, work = kept.pop() if kept else (0, None)
        if work is None or size < slots:
            size, work = slots, self._allocate(slots)
        try:
            yield work
        finally:
            with self._lock:
                if size + sum(other for other, _ in kept) <= self.most:
                    kept.append((size, work))


def workspace_bytes(device: Any) -> int:
    """Memory for the workspaces of a chunk of worlds: as little as fits a CPU's, or what fills a GPU."""
    return WORKSPACE_BYTES if device.is_cpu else max(WORKSPACE_BYTES, device.total_memory // WORKSPACE_SHARE)


class GenericKernels:
    """The generic kernels for one scene on one device; any number of threads may call them."""

    def __init__(self, spec: Specialisation, device: Any) -> None:
        s, dtype, method = spec
        self.spec, self.structure, self.dtype, self.device = spec, s, dtype, device
        self.residual = generic_step.residual_of(method, s.nr)
        coulomb, speed = method.coulomb, method.depenetration_speed
        self.topology = make_topology(
            s, method.inertia_scaling, coulomb, speed, device, method.leapfrog, method.hard
        )
        self.groups = tables.make_groups(s, device)
        self.workspaces = Workspaces(lambda n: allocate_work(s, n, device), bytes_per_world(s), device)
        self.chunk = self.workspaces.most  # worlds of a launch
        leaps = method.leapfrog
        size = tables.bytes_per_world(s, leaps)
        self.slopes = Workspaces(lambda n: tables.allocate_slopes(s, leaps, n, device), size, device)
        size = curves.bytes_per_world(s)
        self.curves = Workspaces(lambda n: curves.allocate_curves(s, n, device), size, device)
        self.rooms = Workspaces(lambda n: room.allocate_room(s, n, device), room.bytes_per_world(s), device)

    def launch(self, kernel: wp.Kernel, worlds: int, flags: list[Any], arrays: list[Any], grain: int) -> None:
        """A kernel over worlds, chunk by chunk: its arguments are the chunk's first world, `flags`, the
        tables, a workspace and `arrays`.
        """
        with self.workspaces.lend(min(worlds, self.chunk)) as space:
            for base in range(0, worlds, self.chunk):
                count = min(self.chunk, worlds - base)
                inputs = [base, *flags, self.topology, space, *arrays]
                launch(kernel, count, inputs, self.device, grain=grain)

    def step(self, a: StepArrays) -> None:
        """One step of every world."""
        self._step(a)
        record_step(self, a)

    def _step(self, a: StepArrays) -> None:
        kernel = generic_step.make_step_kernel(self.dtype, self.residual)
        self.launch(kernel, a.worlds, [], a.in_order(), 8)

    def rollout(self, a: RolloutArrays, controls: Controls, record: tuple[str, ...]) -> None:
        """All steps of every world, in one launch unless the policy is asked on the host."""
        if isinstance(controls.policy, Asked):
            rollout_by_steps(self._step, self.structure, a, controls.policy, controls.steps)
            return
        if controls.us is None:
            s = self.structure
            of = self.dtype, self.residual, s.nv, s.nu
            kernel, source = make_policy_rollout_kernel(*of, controls.policy), controls.struct
        else:
            kernel, source = generic_step.make_rollout_kernel(self.dtype, self.residual), controls.us
        self.launch(kernel, a.worlds, [int("gap" in record)], a.in_order(source), 1)
        if controls.us is not None or taped_policy(controls, a.x0, a.table):
            record_rollout(self, a, controls, record)

    def roll_out(
        self,
        table: wp.array,
        x0: wp.array,
        us: wp.array,
        external: wp.array,
        states: wp.array,
        status: wp.array,
    ) -> None:
        """See `tape.Differentiable`."""
        none: wp.array = wp.zeros((0, us.shape[1], 1), dtype=self.dtype, device=self.device)
        a = RolloutArrays(table, x0, external, states, none, none, none, status)
        kernel = generic_step.make_rollout_kernel(self.dtype, self.residual)
        self.launch(kernel, a.worlds, [0], a.in_order(us), 1)

    def checkpointed(
        self, table: wp.array, x0: wp.array, us: wp.array, external: wp.array, status: wp.array, every: int
    ) -> wp.array:
        """States of steps 0, every, 2 every, ..., N of an open-loop rollout, (B, S+1, nx)."""
        return checkpointed(self, table, x0, us, external, status, every)

    def pull_back(self, run: tape.Recorded, states_grad: wp.array, found: tape.Found) -> None:
        """See `tape.Differentiable`."""
        worlds, policy = run.x0.shape[0], run.policy
        if policy is None:  # of no worlds: open loop
            policy = make_tracking(run.x0.shape[1], self.structure.nu, self.dtype).Struct()
        inputs = [run.table, run.us, policy.xs, policy.gain, policy.period, policy.lower, policy.upper]
        inputs += [run.external, run.states, run.status, states_grad]
        inputs += [found.x0, found.us, found.xs, found.gain, found.table]
        kernel = make_generic_adjoint_kernel(self.dtype, self.residual)
        chunk = min(self.chunk, self.rooms.most)
        slots = min(worlds, chunk)
        with self.workspaces.lend(slots) as space, self.rooms.lend(slots) as of_adjoint:
            for base in range(0, worlds, chunk):
                whole = [base, self.topology, space, self.groups, of_adjoint, *inputs]
                launch(kernel, min(chunk, worlds - base), whole, self.device, grain=1)

    def prepare_linearize(
        self,
        params: wp.array,
        xs: wp.array,
        us: wp.array,
        external: wp.array,
        active: wp.array,
        outputs: tuple[wp.array, wp.array, wp.array, wp.array],
        second: bool,
    ) -> Callable[[], None]:
        """As `gradients.launches.prepare`."""
        if second:
            none: wp.array = wp.zeros((0, 0, 0), dtype=self.dtype, device=self.device)
            return self.prepare_curvature(params, xs, us, external, active, none, outputs)
        fx, fu, _, status = outputs
        items, length = self._runs(us)
        given = [params, us.shape[1], xs, us, external, active, fx, fu, status]
        slots = max(min(self.chunk, self.slopes.most, items), 1)
        kernel = linearize.make_linearize_kernel(self.dtype, self.residual)

        def run() -> None:
            with self.workspaces.lend(slots) as work, self.slopes.lend(slots) as slopes:
                for base in range(0, items, slots):
                    inputs = [base, length, self.topology, work, self.groups, slopes, *given]
                    launch(kernel, min(slots, items - base), inputs, self.device, grain=1)

        return run

    def _runs(self, us: wp.array) -> tuple[int, int]:
        """Threads that differentiate along trajectories, and the steps of each."""
        steps = us.shape[1]
        length = min(steps, RUN) if wp.get_device(self.device).is_cpu else 1
        return us.shape[0] * -(-steps // length), length

    def prepare_curvature(
        self,
        params: wp.array,
        xs: wp.array,
        us: wp.array,
        external: wp.array,
        active: wp.array,
        weights: wp.array,
        outputs: tuple[wp.array, wp.array, wp.array, wp.array],
    ) -> Callable[[], None]:
        """As `gradients.launches.prepare`, by `kernels/gradients/generic/curvature.py`.

        Args:
            weights: (B, N+1, nx): second derivatives (B N, 1, nz, nz) of the next state weighed by these
                alone, no others; or (0, 0, 0).
        """
        items, length = self._runs(us)
        given = [params, us.shape[1], xs, us, external, active, weights, *outputs]
        second = outputs[2].shape[1] > 0
        most = (self.chunk, self.slopes.most, self.rooms.most, self.curves.most if second else items)
        slots = max(min(*most, items), 1)
        kernel = make_curvature_kernel(self.dtype, self.residual)

        def run() -> None:
            with (
                self.workspaces.lend(slots) as work,
                self.slopes.lend(slots) as slopes,
                self.rooms.lend(slots) as of_adjoint,
                self.curves.lend(slots if second else 0) as curves,
            ):
                whole = room.with_factor(of_adjoint, slopes)
                for base in range(0, items, slots):
                    inputs = [base, length, self.topology, work, self.groups, whole, curves, *given]
                    launch(kernel, min(slots, items - base), inputs, self.device, grain=1)

        return run

    def prepare_candidates(
        self, items: int, offset: int, mode: int, arrays: Sequence[Any]
    ) -> Callable[[], None]:
        """A repeatable launch of DDP's rollouts offset, .., as of `kernels/control/generic_rollouts.py`.

        Args:
            mode: FOLLOW, SHOOT or GIVEN.
            arrays: number of problems, x0, Policy, Candidates, params, external, active.
        """
        kernel = make_candidates_kernel(self.dtype, self.residual)
        slots = max(min(items, self.chunk), 1)

        def run() -> None:
            with self.workspaces.lend(slots) as work:
                for base in range(0, items, slots):
                    inputs = [offset + base, mode, self.topology, work, *arrays]
                    launch(kernel, min(slots, items - base), inputs, self.device, grain=1)

        return run
