"""Residuals of single complementarity conditions, in batch: eqs. (4), (15), (17), footnote 3 and more.

They are what the smoothed problems minimise or solve; `Options.residual` selects one for the step and
`solve_complementarity` one for a matrix.
"""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.cache import get_device
from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.residual.residuals import NAMES, make_residual_kernel

from ..inputs.arrays import ArrayError
from ..inputs.checks import array, choice
from ..options import OptionError


def residual(name: str, a: Any, b: Any, sigma: Any = 1.0, dtype: str = "float64") -> np.ndarray:
    """A residual of a >= 0, b >= 0, ab = 0, elementwise, computed as the kernels do.

    Args:
        name: "min", eq. (4); "fischer-burmeister", a + b - sqrt(a^2 + b^2); "rem-logistic", eq. (17), and
            "rem-normal", footnote 3, E[min(a, b + noise)]; "erm-normal", eq. (15), "erm-logistic", footnote
            3, and "erm-uniform", the paper's [1], E[min(a, b + noise)^2]. The REM residual is the first
            kind's square.
        a, b: numbers of any shapes that broadcast together.
        sigma: noise level, > 0: standard deviation, of a logistic distribution its scale; "min" and
            "fischer-burmeister" have none.
        dtype: "float64" or "float32", the precision of the computation and of the result.

    Raises:
        OptionError: unknown name or dtype.
        ArrayError: not numbers, or sigma not positive.
    """
    choice("name", name, NAMES, error=OptionError)
    choice("dtype", dtype, ("float32", "float64"), error=OptionError)
    given_numbers = [
        array(label, value, finite=False, error=ArrayError).astype(dtype)
        for label, value in (("a", a), ("b", b), ("sigma", sigma))
    ]
    try:
        arrays = np.broadcast_arrays(*given_numbers)
    except ValueError as error:
        raise ArrayError(f"a, b, sigma are no arrays of numbers that broadcast together: {error}") from error
    if not ((arrays[2] > 0) & (arrays[2] < np.inf)).all():
        raise ArrayError(f"sigma is {arrays[2].min():g}; positive and finite numbers are needed")
    kind, device = getattr(wp, dtype), get_device("cpu")
    given: list[wp.array] = [
        wp.array(np.ascontiguousarray(x).reshape(-1), dtype=kind, device=device) for x in arrays
    ]
    out = wp.zeros(arrays[0].size, dtype=kind, device=device)
    launch(make_residual_kernel(kind, name), out.shape[0], [*given, out], device)
    return out.numpy().reshape(arrays[0].shape)
