"""Controls, impulses and gaps of steps that a sweep's kernels made: these steps, once more, one by one."""

import warnings
from collections.abc import Collection
from typing import Any

import numpy as np
import warp as wp

from ...options import Status
from ...parameters import Parameters
from ...simulator import Simulator
from ...storage.printed import counted

CLOSE = 1e-3  # of a world's velocities: by so much they agree where it is the same step,
ROUNDINGS = 32  # beside so many of its positions


def steps_told(sim: Simulator, worlds: int, steps: int) -> wp.array:
    """Room for what steps begin from (B, N, nx + nu + 3 nb), see `Written`; NaN where no step was made."""
    width = sim.nx + sim.nu + 3 * len(sim.scene.bodies)
    out: wp.array = wp.full((worlds, steps, width), np.nan, dtype=sim.dtype, device=sim.device)
    return out


def recorded(
    sim: Simulator,
    told: np.ndarray,
    unsolved_time: np.ndarray,
    step_size: float,
    params: Parameters,
    wanted: Collection[str],
    numbers: np.ndarray,
) -> dict[str, np.ndarray]:
    """Controls (B, N, nu) as they acted, impulse and gap (B, N, nr) of every step.

    NaN from a step on that was not solved; where a world had ended nothing acts. Impulses of a step that
    leads elsewhere when it is made alone, as contact with several solutions may, are not known: NaN, and a
    RuntimeWarning that says of which worlds.

    Args:
        sim: whose steps they are.
        told: (B, N, nx + nu + 3 nb) what they began from, see `Written`.
        unsolved_time: (B,) when the step began that was not solved [s]; infinite: all were.
        step_size: [s].
        params: of the worlds.
        wanted: of these, what is recorded.
        numbers: (B,) of the worlds, for the warning.
    """
    worlds, steps, _ = told.shape
    nx, nu = sim.nx, sim.nu
    out = {"controls": np.full((worlds, steps, nu), np.nan)}
    out |= {name: np.full((worlds, steps, sim.nr), np.nan) for name in ("impulse", "gap")}
    ends = np.where(np.isfinite(unsolved_time), np.round(unsolved_time / step_size), steps)
    stands, warm, elsewhere = np.tile(sim.scene.x0, (worlds, 1)), None, np.zeros((worlds, steps), bool)
    for k in range(steps):
        goes, made = k < ends, np.isfinite(told[:, k, :nx]).all(axis=1)
        x = np.where(made[:, None], told[:, k, :nx], stands)
        u = np.where(made[:, None], told[:, k, nx : nx + nu], 0.0)
        force = np.nan_to_num(told[:, k, nx + nu :]).reshape(worlds, -1, 3)
        step: Any = sim.step(x, u, params, external_force=force, warm_start=warm)
        warm, stands = step.multiplier, np.where((made & goes)[:, None], step.state, stands)
        same = step.status == Status.SOLVED
        if k + 1 < steps:
            same &= _arrives(step.state, told[:, k + 1, :nx], x, step_size) | (k + 1 >= ends)
        elsewhere[:, k] = made & goes & ~same
        out["controls"][goes, k], out["gap"][goes, k] = u[goes], step.gap[goes]
        out["impulse"][goes, k] = np.where(made[goes, None], step.impulse[goes], 0.0)
    out["impulse"][elsewhere] = np.nan
    if "impulse" in wanted and elsewhere.any():
        some = np.flatnonzero(elsewhere.any(axis=1))
        named = ", ".join(str(number) for number in numbers[some[:8]])
        warnings.warn(
            f"impulses of {counted(int(elsewhere.sum()), 'step')} are NaN, in worlds {named}"
            f"{' and more' if len(some) > 8 else ''}: made alone they lead elsewhere, as contact with "
            "several solutions may",
            RuntimeWarning,
            stacklevel=3,
        )
    return out


def _arrives(state: np.ndarray, next: np.ndarray, x: np.ndarray, step_size: float) -> np.ndarray:
    """Whether steps made alone lead to where worlds were next (B,): to their positions, as velocities are
    kicked there; True where they had no next step.
    """
    nv = x.shape[1] // 2
    moved = (next[:, :nv] - x[:, :nv]) / step_size
    off = np.abs((state[:, :nv] - x[:, :nv]) / step_size - moved).max(axis=1, initial=0.0)
    size = np.abs(np.concatenate([x[:, nv:], moved], axis=1)).max(axis=1, initial=0.0)
    place = np.abs(x[:, :nv]).max(axis=1, initial=0.0)
    return ~(off > CLOSE * size + ROUNDINGS * np.finfo(state.dtype).eps * place / step_size)
