"""The foreign functions behind `slcp_warp.jax`: a rollout, its backward pass, a linearisation.

Warp calls them back with arrays of JAX's buffers, in which anything may stand. What is vmapped comes with its
dimension folded into the worlds; a row that several worlds share is repeated.
"""

import contextlib
import inspect
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.progress import announced, one_line
from slcp_warp.kernels.device.tables import laid_out
from slcp_warp.kernels.factories import cached

from ..gradients import launches
from ..gradients.open_loop import pull, roll_out
from ..gradients.table import check_values
from ..inputs.arrays import ArrayError
from ..simulator import Simulator


def foreign(function: Callable[..., None], takes: Sequence[Any], fills: Sequence[Any], device: Any) -> Any:
    """A function of Warp arrays as one that JAX calls, traced or not; types of what it takes and fills."""
    names = inspect.signature(function).parameters

    def called(*arrays: wp.array) -> None:
        with _as_errors():
            function(*arrays)

    called.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in names]
    )
    called.__annotations__ = dict(zip(names, (*takes, *fills)))
    called.__qualname__ = function.__qualname__
    _load_module(function.__module__, device.alias)
    mode = wp.JaxCallableGraphMode.NONE  # arrays are made within, and tables looked at
    preload = wp.JaxModulePreloadMode.NONE
    return wp.jax_callable(called, len(fills), mode, vmap_method="broadcast_all", module_preload_mode=preload)


@cached
def _load_module(name: str, device: str) -> None:
    """Load what Warp would load when JAX calls: the kernels of a function's module, of which it has none."""
    with announced(f"what JAX calls, for {device}"), one_line():
        wp.get_module(name).load(device, 1 if wp.get_device(device).is_cpu else None)


@contextlib.contextmanager
def _as_errors() -> Iterator[None]:
    """Warp hands exceptions to JAX, but no interrupt: JAX would take arrays that are not filled for done."""
    try:
        yield
    except Exception:
        raise
    except BaseException as error:
        raise RuntimeError(f"stopped by {type(error).__name__}") from error


@cached
def forward_of(sim: Simulator, every: int, check: bool) -> Any:
    """x0 (B, nx), us (B, N, nu), table (1 or B, P), force (0 or B, 3 bodies) -> states and status."""
    two, three, codes = _kinds(sim)

    def roll(
        x: wp.array, us: wp.array, table: wp.array, force: wp.array, states: wp.array, status: wp.array
    ) -> None:
        _same_device(sim, x)
        _look_at(sim, table, check)
        states.zero_()
        status.zero_()
        rows, force = _rows(table, len(x)), _rows(force, len(x))
        found = roll_out(sim.kernels.stepping, rows, x, us, force, status, every, None if every else states)
        if every:
            wp.copy(states, found)

    return foreign(roll, (two, three, two, two), (three, codes), sim.device)


@cached
def backward_of(sim: Simulator, every: int, parameters: bool) -> Any:
    """Gradients by states, then what went into the rollout and came out -> gradients by x0, us and, with
    `parameters`, every world's row of the table.
    """
    two, three, codes = _kinds(sim)

    def back(
        by_states: wp.array, x: wp.array, us: wp.array, table: wp.array, force: wp.array, states: wp.array,
        status: wp.array, by_x: wp.array, by_us: wp.array, by_table: wp.array,
    ) -> None:  # fmt: skip
        _same_device(sim, x)
        outputs, worlds = (by_x, by_us, by_table), len(x)
        for output in outputs:
            output.zero_()
        if not worlds:
            return
        rows = _rows(table, worlds, share=not parameters)
        for array, gradient in list(zip((x, us, rows), outputs))[: 3 if parameters else 2]:
            array.grad = gradient
            array.requires_grad = True
        force = _rows(force, worlds)
        pull(sim.kernels.stepping, rows, x, us, force, states, status, by_states, every)

    return foreign(back, (three, two, three, two, two, three, codes), (two, three, two), sim.device)


@cached
def linearization_of(sim: Simulator, check: bool) -> Any:
    """x (B, nx), u (B, nu), table (1 or B, P), force (0 or B, 3 bodies) -> A, B and status."""
    two, three, codes = _kinds(sim)

    def linearize(
        x: wp.array, u: wp.array, table: wp.array, force: wp.array, A: wp.array, B: wp.array, status: wp.array
    ) -> None:
        _same_device(sim, x)
        _look_at(sim, table, check)
        worlds = len(x)
        if not worlds:
            return
        u = u if sim.nu else sim.empty(worlds, 1)
        make, rows, force = sim.kernels.stepping.prepare_linearize, _rows(table, worlds), _rows(force, worlds)
        by_x, by_u, _, found = launches.at_states(sim.spec, make, laid_out(rows), x, u, force, False)
        for source, target in ((by_x, A), (by_u, B), (found, status)):
            wp.copy(target, source)

    return foreign(linearize, (two, two, two, two), (three, three, codes), sim.device)


def _kinds(sim: Simulator) -> tuple[Any, Any, Any]:
    """Types of the arrays of a simulator with two and three axes, and of statuses."""
    return wp.array2d(dtype=sim.dtype), wp.array3d(dtype=sim.dtype), wp.array(dtype=wp.int32)


def _same_device(sim: Simulator, array: wp.array) -> None:
    if array.device != sim.device:
        raise ArrayError(
            f"JAX computes on {array.device}, the simulator on {sim.device}; put the arrays there, or make "
            "another simulator"
        )


def _look_at(sim: Simulator, table: wp.array, check: bool) -> None:
    if check:
        check_values(sim.params, table.numpy().astype(np.float64))


def _rows(table: wp.array, worlds: int, share: bool = True) -> wp.array:
    """(worlds, width) of (rows, width): every row for equally many worlds after each other.

    Args:
        share: whether one row for all, or none, is as good.
    """
    rows, width = table.shape
    if rows == worlds or (share and rows < 2):
        return table
    out = wp.empty((worlds, width), dtype=table.dtype, device=table.device)
    shape, strides = (rows, worlds // rows, width), (table.strides[0], 0, table.strides[1])
    repeated: Any = wp.array(
        ptr=table.ptr, shape=shape, strides=strides, dtype=table.dtype, device=table.device
    )
    wp.copy(out.reshape(shape), repeated)
    return out
