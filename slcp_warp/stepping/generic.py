"""Launches of the generic kernels, which serve any scene by tables; a workspace keeps a world's state."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.generic import step as generic_step
from slcp_warp.kernels.generic import work
from slcp_warp.kernels.generic.derivatives import linearize, tables
from slcp_warp.kernels.generic.topology import make_topology
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.structure import Structure

from .arrays import Controls, RolloutArrays, StepArrays
from .single import rollout_by_steps

WORKSPACE_BYTES = 256 * 2**20  # worlds are stepped in chunks whose workspaces fit in here


class Workspaces:
    """Workspaces of one scene on one device, each lent to one call at a time; some are kept for later calls.

    On a GPU they belong to the stream that they were used on, whose order keeps calls apart.

    Args:
        allocate: (structure, slots, device) -> a workspace.
        size: of one slot [bytes].
    """

    def __init__(self, s: Structure, device: Any, allocate: Callable[..., Any], size: int) -> None:
        self.structure, self.device, self.allocate = s, wp.get_device(device), allocate
        self.most = max(1, WORKSPACE_BYTES // max(size, 1))  # slots of a workspace, and of those kept
        self._lock = threading.Lock()
        self._kept: dict[Any, list[tuple[int, Any]]] = {}

    @contextlib.contextmanager
    def lend(self, slots: int) -> Iterator[Any]:
        """A workspace of at least that many slots that no other call has."""
        stream = self.device.stream if self.device.is_cuda else None
        with self._lock:
            kept = self._kept.setdefault(stream, [])
            size, work = kept.pop() if kept else (0, None)
        if work is None or size < slots:
            size, work = slots, self.allocate(self.structure, slots, self.device)
        try:
            yield work
        finally:
            with self._lock:
                if size + sum(other for other, _ in kept) <= self.most:
                    kept.append((size, work))


class GenericKernels:
    """The generic kernels for one scene on one device; any number of threads may call them.

    Nothing is recorded on a tape.
    """

    def __init__(self, spec: Specialisation, device: Any) -> None:
        s, dtype, method = spec
        self.structure, self.dtype, self.device = s, dtype, device
        self.residual = generic_step.residual_of(method, s.nr)
        self.topology = make_topology(s, method.inertia_scaling, method.coulomb, device)
        self.groups = tables.make_groups(s, device)
        self.workspaces = Workspaces(s, device, work.allocate_work, work.bytes_per_world(s))
        self.slopes = Workspaces(s, device, tables.allocate_slopes, tables.bytes_per_world(s))
        self.chunk = min(self.workspaces.most, self.slopes.most)  # worlds of a launch

    def _launch(
        self, kernel: wp.Kernel, worlds: int, flags: list[int], arrays: list[Any], grain: int
    ) -> None:
        with self.workspaces.lend(min(worlds, self.chunk)) as space:
            for base in range(0, worlds, self.chunk):
                count = min(self.chunk, worlds - base)
                inputs = [base, *flags, self.topology, space, *arrays]
                launch(kernel, count, inputs, self.device, grain=grain)

    def step(self, a: StepArrays) -> None:
        """One step of every world."""
        kernel = generic_step.make_step_kernel(self.dtype, self.residual)
        self._launch(kernel, a.worlds, [], a.in_order(), 8)

    def rollout(self, a: RolloutArrays, controls: Controls, record: tuple[str, ...]) -> None:
        """All steps of every world; in one launch with given controls."""
        if controls.us is None:
            rollout_by_steps(self.step, self.structure, a, controls)
            return
        kernel = generic_step.make_rollout_kernel(self.dtype, self.residual)
        self._launch(kernel, a.worlds, [int("gap" in record)], a.in_order(controls.us), 1)

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
        steps = us.shape[1]
        kernel = linearize.make_linearize_kernel(self.dtype, self.residual)
        fx, fu, _, status = outputs
        arrays = [params, steps, xs, us, external, active, fx, fu, status]

        def run() -> None:
            items = us.shape[0] * steps
            slots = min(items, self.chunk)
            with self.workspaces.lend(slots) as space, self.slopes.lend(slots) as slopes:
                for base in range(0, items, self.chunk):
                    count = min(self.chunk, items - base)
                    inputs = [base, self.topology, space, self.groups, slopes, *arrays]
                    launch(kernel, count, inputs, self.device, grain=1)

        return run
