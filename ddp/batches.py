"""Batches of arrays at the solver's door: shapes, and numbers that are finite."""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.inputs.checks import numeric, shown
from slcp_warp.inputs.errors import ArgumentError

from .problem import Problem


def check_array(name: str, value: Any, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless a host array has this shape, or this without its batch axis, and is finite."""
    array = value if isinstance(value, wp.array) else numeric(value)
    if array is None:
        raise ArgumentError(f"{name} must be an array of numbers, got {shown(value)}")
    if array.shape not in (shape, shape[1:]):
        raise ArgumentError(f"{name} must have shape {shape} or {shape[1:]}, got {array.shape}")
    if isinstance(array, wp.array):
        return
    if not np.isfinite(array).all():
        bad = np.count_nonzero(~np.isfinite(array))
        raise ArgumentError(f"{name} must be finite; {bad} of its values are NaN or infinite")


def batch_of(problem: Problem, x0: Any, u0: Any, controls: str = "u0") -> tuple[bool, int]:
    """Whether the batch axis is left out, and how many problems there are; the arrays are checked.

    Args:
        problem: whose sizes they have.
        x0, u0: states, and controls or None.
        controls: what errors call the controls.
    """
    given = []
    if u0 is None:
        u0 = np.zeros((problem.horizon, problem.nu), dtype=wp.dtype_to_numpy(problem.dynamics.dtype))
    for name, value in (("x0", x0), (controls, u0)):
        array = value if isinstance(value, wp.array) else numeric(value)
        if isinstance(value, wp.array) and value.dtype is not problem.dynamics.dtype:
            need = problem.dynamics.dtype.__name__
            raise ArgumentError(f"{name} is a Warp array of {value.dtype.__name__}; {need} is needed")
        if array is None:
            raise ArgumentError(f"{name} must be an array of numbers, got {shown(value)}")
        given.append(array)
    x, u = given
    single = x.ndim == 1 and u.ndim == 2
    batch = 1 if single or not (x.ndim == 2 or u.ndim == 3) else len(x if x.ndim == 2 else u)
    check_array("x0", x, (batch, problem.nx))
    check_array(controls, u, (batch, problem.horizon, problem.nu))
    return single, batch


def fill(target: wp.array, value: Any, name: str, shape: tuple[int, ...]) -> None:
    """Copy an argument into a device array, checking its shape, and host arrays for NaN."""
    if isinstance(value, wp.array):
        if value.shape != shape or value.dtype != target.dtype:
            raise ArgumentError(
                f"{name} must have shape {shape} and dtype {target.dtype.__name__}, got {value.shape}, "
                f"{value.dtype.__name__}"
            )
        if value.ptr != target.ptr:
            wp.copy(target, value)
        return
    check_array(name, value, shape)
    array = np.asarray(value, dtype=wp.dtype_to_numpy(target.dtype))
    if wp.get_device(target.device).is_cpu:
        target.numpy()[...] = array
    else:
        target.assign(np.ascontiguousarray(np.broadcast_to(array, shape)))
