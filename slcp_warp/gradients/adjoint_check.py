"""Whether Warp's adjoint of a user's function is right: against differences, in float64.

Warp differentiates code whose loops and assignments it can follow back; of a loop of another length in each
world, or of a component that is assigned twice, its adjoint is wrong, silently.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.adjoints import make_probe_kernel
from slcp_warp.kernels.device.cache import KernelCacheError, block_of, load
from slcp_warp.kernels.factories import building

STEP = 1e-5  # of the differences, whose error is the fourth power of it and rounding / STEP
NEAR = 1e-6  # of the largest difference: by how much an adjoint may miss
KINKED = 1e-4  # the same of differences to one side, whose error is the square of the step
ROUNDING = 1e-9  # of the largest value
MOVES = STEP * np.arange(-2.0, 3.0)
SIZES = (0.1, 1.0, 5.0)  # of random numbers at which a function is looked at
POINTS = 48  # of each size
FILLED = 0.71  # in place of the first zero among a function's numbers, a little more of the next
FEWEST = 16  # of one size at which a function must be finite to tell

_right: dict[tuple[Any, int, int], bool] = {}


def near(found: np.ndarray, moved: Callable[[float], np.ndarray]) -> bool:
    """Whether slopes are those of central differences, or, beside a kink, those of one side.

    ``moved`` gives the values after a move along what the slopes are by.
    """
    before, here, after = moved(-STEP), moved(0.0), moved(STEP)
    two_before, two_after = moved(-2.0 * STEP), moved(2.0 * STEP)
    central = (8.0 * (after - before) - (two_after - two_before)) / (12.0 * STEP)
    right = (4.0 * after - 3.0 * here - two_after) / (2.0 * STEP)
    left = (3.0 * here - 4.0 * before + two_before) / (2.0 * STEP)
    largest = np.abs(here).max()
    close = np.zeros(found.shape, bool)
    for slopes, error in ((central, NEAR), (right, KINKED), (left, KINKED)):
        close |= np.abs(found - slopes) <= error * np.abs(slopes).max() + ROUNDING * largest
    return bool(close.all())


def adjoint_is_right(value: Any, nz: int, indices: int, numbers: Any) -> bool:
    """Whether Warp's adjoint of ``value(numbers, row, z, index)`` by z is its derivative; looked at once.

    The verdict is for whatever numbers come later: so zeros among them, which hide what they multiply, are
    looked at as other numbers, too.

    Args:
        value: a Warp function in float64.
        nz: length of z.
        indices: as many indices are tried, 0 on.
        numbers: what it reads, (rows, P) in float64 on the device that it will run on; row 0 is taken.
    """
    key = value, nz, indices
    with building():
        if key not in _right:
            _right[key] = _looks_right(value, nz, indices, numbers)
        return _right[key]


def _looks_right(value: Any, nz: int, indices: int, numbers: Any) -> bool:
    kernel, device = make_probe_kernel(value, nz), numbers.device
    try:
        load(kernel, device)
    except KernelCacheError:
        raise
    except Exception:  # Warp has no adjoint of what the function calls, or the function is at fault itself
        return False
    given = numbers.numpy()[:1]
    if not _right_at(kernel, given, nz, indices, device, True):
        return False
    filled = np.where(given == 0.0, FILLED + np.arange(given.shape[1]) / 64.0, given)
    return bool((filled == given).all()) or _right_at(kernel, filled, nz, indices, device, False)


def _right_at(kernel: Any, row: np.ndarray, nz: int, indices: int, device: Any, must_be_finite: bool) -> bool:
    """With one row of numbers; where the function is finite at too few points, as `must_be_finite` says."""
    numbers: Any = wp.array(row, dtype=wp.float64, device=device)
    rng = np.random.default_rng(0)
    zs = np.concatenate([size * rng.standard_normal((POINTS, nz)) for size in SIZES])
    along = rng.standard_normal(zs.shape)
    rows, index = indices * len(zs), np.repeat(np.arange(indices, dtype=np.int32), len(zs))
    slope = wp.empty(rows, dtype=wp.float64, device=device)
    values = wp.empty((rows, len(MOVES)), dtype=wp.float64, device=device)
    given = [np.tile(zs, (indices, 1)), np.tile(along, (indices, 1)), index, MOVES]
    kinds = [wp.float64, wp.float64, wp.int32, wp.float64]
    arrays: Any = [wp.array(a, dtype=kind, device=device) for a, kind in zip(given, kinds)]
    inputs = [numbers, *arrays, slope, values]
    block = block_of(device)
    wp.launch(kernel, rows, inputs, device=device, block_dim=block, record_tape=False)
    shape = (indices, len(SIZES), POINTS)
    slopes, around = slope.numpy().reshape(shape), values.numpy().reshape(*shape, len(MOVES))
    pairs = [(slopes[i, s], around[i, s]) for i in range(indices) for s in range(len(SIZES))]
    return all(_all_near(*pair, not must_be_finite) for pair in pairs)


def _all_near(slopes: np.ndarray, values: np.ndarray, otherwise: bool) -> bool:
    """Of the points of one size at which the function is finite; `otherwise` where these are few."""
    finite = np.isfinite(values).all(1)
    if finite.sum() < FEWEST:
        return otherwise
    values = values[finite]
    return near(slopes[finite], lambda by: values[:, int(np.abs(MOVES - by).argmin())])
