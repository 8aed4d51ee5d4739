"""What the arrays of a plan's file must be."""

from dataclasses import fields

import numpy as np

from slcp_warp.results.record_checks import (
    Arrays,
    finite,
    known_statuses,
    length,
    shapes,
    worlds_of_parameters,
)
from slcp_warp.results.simulated import Simulated
from slcp_warp.storage.files import FileError

from .status import Status
from .trace import Trace

SINGLE = ("cost", "status", "iterations", "gradient", "min_pivot")
COLUMNS = tuple(f"trace_{f.name}" for f in fields(Trace))
OF_STEPS = ("xs", "us", "K", "k", "Vx", "Vxx")
OF_COMMANDS = ("level_sigma", "level_cost", "trace_level", "batch_cost", "batch_status")  # of `slcp optimise`
STATE_LIMITS = ("state_lower", "state_upper")  # of problems that have some, (1 or B, nx)
PLAN = (*OF_STEPS, *SINGLE, *COLUMNS, "lower", "upper", *STATE_LIMITS, *OF_COMMANDS)


def check_plan(arrays: Arrays, simulated: Simulated) -> None:
    """A `ddp.Result` of one problem or a batch of them, its trace's columns of one length; what the noise
    levels of `slcp optimise` cost.
    """
    nx, nu = 2 * simulated.scene.nv, simulated.scene.nu
    axes = 3 if "us" in arrays and arrays["us"].ndim == 3 else 2
    batch = arrays["us"].shape[:1] if axes == 3 else ()
    steps, passes = length(arrays, "us", axes - 2, axes), length(arrays, "trace_cost", axes - 2, axes - 1)
    if steps < 1 or passes < 1 or 0 in batch:
        raise FileError("it holds no step, no pass or no problem")
    need = {
        "xs": (steps + 1, nx), "us": (steps, nu), "K": (steps, nu, nx), "k": (steps, nu),
        "Vx": (steps + 1, nx), "Vxx": (steps + 1, nx, nx), **dict.fromkeys(SINGLE, ()),
        **dict.fromkeys(COLUMNS, (passes,)),
    }  # fmt: skip
    limits = ("lower", "upper") if {"lower", "upper"} & arrays.keys() else ()  # files without state none
    need |= dict.fromkeys(limits, (nu,))
    shapes(arrays, {name: (*batch, *shape) for name, shape in need.items()})
    if limits and not (arrays["lower"] <= arrays["upper"]).all():
        raise FileError("a lower control limit is above the upper one")
    if set(STATE_LIMITS) & arrays.keys():
        _check_state_limits(arrays, nx, batch)
    planned = np.isfinite(arrays["cost"]) if batch else ...
    followed = ("xs", "us", "K", "k")
    finite({name: arrays[name][planned] for name in followed}, *followed)
    known_statuses(arrays["status"], Status)
    worlds_of_parameters(simulated, batch or (1,))
    _check_solved(arrays)
    _check_levels(arrays, passes)


def _check_state_limits(arrays: Arrays, nx: int, batch: tuple[int, ...]) -> None:
    """Raise FileError for limits of other states or problems."""
    rows = length(arrays, STATE_LIMITS[0], 0, 2)
    shapes(arrays, dict.fromkeys(STATE_LIMITS, (rows, nx)))
    if rows not in (1, *batch):
        raise FileError(f"array 'state_lower' is for {rows} problems; 1 or one each is needed")
    if not (arrays[STATE_LIMITS[0]] <= arrays[STATE_LIMITS[1]]).all():
        raise FileError("a lower state limit is above the upper one")


def _check_solved(arrays: Arrays) -> None:
    """Raise FileError for numbers of a solve that none leaves."""
    if np.isnan(arrays["cost"]).all():
        raise FileError("array 'cost' contains nan; numbers are needed")
    for name in ("iterations", "trace_restarts", "trace_regularization", "trace_step_size", "trace_gradient"):
        if (arrays[name] < 0).any():
            raise FileError(
                f"array {name!r} contains {np.nanmin(arrays[name])}; numbers of at least 0 are needed"
            )
    if (arrays["iterations"] != np.floor(arrays["iterations"])).any():
        raise FileError("array 'iterations' contains what is no whole number")


def _check_levels(arrays: Arrays, passes: int) -> None:
    """Raise FileError where noise levels, if there are any, do not fit the trace."""
    if not {"level_sigma", "level_cost", "trace_level"} & arrays.keys():
        return
    levels = length(arrays, "level_sigma", 0, 1)
    if levels < 1:
        raise FileError("it holds no noise level")
    shapes(arrays, {"trace_level": (passes,), "level_cost": (levels,)})
    if np.setdiff1d(arrays["trace_level"], np.arange(levels)).size:
        raise FileError(f"array 'trace_level' names noise levels beyond its {levels}")
