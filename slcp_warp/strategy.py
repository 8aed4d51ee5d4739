"""Which kernels a scene gets: specialised ones, or generic ones.

"specialised": every (scene, options, precision) compiles kernels of its own, unrolled, one world per thread
in registers: fastest for small mechanisms, and the only ones with derivatives. "generic": one kernel per
precision and residual serves every scene by tables, a world's state in memory (`kernels/generic/step.py`):
for scenes whose unrolled kernels would take minutes to compile and spill anyway.
"""

import contextlib
import threading
import warnings
from collections.abc import Iterator
from typing import Any

import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.generic import step as generic_step
from slcp_warp.kernels.generic.topology import NUMBERS, make_topology
from slcp_warp.kernels.generic.work import Work, allocate_work, bytes_per_world
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.structure import MOST_ROWS, Structure, layout

from .inputs.checks import choice
from .inputs.errors import ArgumentError

STRATEGIES = ("auto", "specialised", "generic")
RENAMED = {"registers": "specialised", "memory": "generic"}  # as they were called before
# nv times the larger of nr and nv, by whether the device is a CPU: beyond, specialised kernels compile for
# half a minute on a CPU and for minutes on a GPU (docs/understand/performance.md)
LARGEST = {True: 200, False: 32}
WORKSPACE_BYTES = 256 * 2**20  # worlds are stepped in chunks whose workspaces fit in here


class StrategyError(ArgumentError):
    """What was asked for is not offered with the kernels of this scene."""


def missing(s: Structure, method: Method) -> str:
    """What keeps a scene from the generic kernels, or ""."""
    if not (method.hard or method.rem):
        return f"residual {method.residual!r}"
    if method.friction != "anitescu" and not (method.coulomb and method.hard):
        return f"friction {method.friction!r}"
    if method.integrator != "euler":
        return f"integrator {method.integrator!r}"
    if method.state_noise:
        return f"noise {method.noise!r}"
    if method.tolerance is not None:
        return f"tolerance {method.tolerance!r}"
    if method.end_gap:
        return f"gap {method.gap!r}"
    if method.converts:
        return f"deviation {method.deviation!r}"
    unknown = [name for name in layout(s).names if name not in NUMBERS]
    return f"parameters {unknown}" if unknown else ""


def current_name(strategy: Any) -> Any:
    """A strategy by its name of today; one of before is taken, with a warning where the public call is."""
    if not isinstance(strategy, str) or strategy not in RENAMED:
        return strategy
    name = RENAMED[strategy]
    warnings.warn(f"strategy {strategy!r} is called {name!r} now", DeprecationWarning, stacklevel=3)
    return name


def choose(strategy: str, s: Structure, method: Method, device: Any) -> str:
    """Specialised or generic kernels for a scene; a clear error where neither serves."""
    choice("strategy", strategy, STRATEGIES)
    lacks = missing(s, method)
    if strategy == "generic" and lacks:
        raise StrategyError(f"{lacks} is not offered by the generic kernels; use strategy='specialised'")
    if s.nr > MOST_ROWS and (strategy == "specialised" or lacks):
        reason = f"; the generic kernels do not offer {lacks}" if lacks else "; use strategy='generic'"
        raise StrategyError(
            f"the scene has {s.nr} rows, specialised kernels take at most {MOST_ROWS}{reason}"
        )
    if strategy != "auto" or lacks:
        return "specialised" if strategy == "auto" else strategy
    large = s.nr > MOST_ROWS or s.nv * max(s.nr, s.nv) > LARGEST[wp.get_device(device).is_cpu]
    return "generic" if large else "specialised"


class Workspaces:
    """Workspaces of one scene on one device, each lent to one call at a time; some are kept for later calls.

    On a GPU they belong to the stream that they were used on, whose order keeps calls apart.
    """

    def __init__(self, s: Structure, device: Any) -> None:
        self.structure, self.device = s, wp.get_device(device)
        self.most = max(1, WORKSPACE_BYTES // bytes_per_world(s))  # slots of a workspace, and of those kept
        self._lock = threading.Lock()
        self._kept: dict[Any, list[tuple[int, Work]]] = {}

    @contextlib.contextmanager
    def lend(self, slots: int) -> Iterator[Work]:
        """A workspace of at least that many slots that no other call has."""
        stream = self.device.stream if self.device.is_cuda else None
        with self._lock:
            kept = self._kept.setdefault(stream, [])
            size, work = kept.pop() if kept else (0, None)
        if work is None or size < slots:
            size, work = slots, allocate_work(self.structure, slots, self.device)
        try:
            yield work
        finally:
            with self._lock:
                if size + sum(other for other, _ in kept) <= self.most:
                    kept.append((size, work))


class GenericKernels:
    """Launches of the generic kernels for one scene on one device; any number of threads may call them."""

    def __init__(self, spec: Specialisation, device: Any) -> None:
        s, dtype, method = spec
        self.dtype, self.device = dtype, device
        self.residual = generic_step.residual_of(method, s.nr)
        self.topology = make_topology(s, method.inertia_scaling, method.coulomb, device)
        self.workspaces = Workspaces(s, device)
        self.chunk = self.workspaces.most  # worlds of a launch

    def _launch(
        self, kernel: wp.Kernel, worlds: int, flags: list[int], arrays: list[Any], grain: int
    ) -> None:
        with self.workspaces.lend(min(worlds, self.chunk)) as work:
            for base in range(0, worlds, self.chunk):
                count = min(self.chunk, worlds - base)
                inputs = [base, *flags, self.topology, work, *arrays]
                launch(kernel, count, inputs, self.device, grain=grain)

    def step(self, worlds: int, arrays: list[Any]) -> None:
        """As a launch of `rollout.make_step_kernel`."""
        self._launch(generic_step.make_step_kernel(self.dtype, self.residual), worlds, [], arrays, 8)

    def rollout(self, worlds: int, exact_gap: bool, arrays: list[Any]) -> None:
        """As a launch of `rollout.make_rollout_kernel` for an open loop, whose controls are an array here."""
        kernel = generic_step.make_rollout_kernel(self.dtype, self.residual)
        self._launch(kernel, worlds, [int(exact_gap)], arrays, 1)
