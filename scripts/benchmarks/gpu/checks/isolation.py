"""Worlds that cannot be solved leave their neighbours' bits alone, and say why."""

import numpy as np

import slcp_warp as slcp
from slcp_warp.description.acting import acting

from ..record import Found
from ..setting import Setting, cast

WORLDS, STEPS = 256, 10


def run(setting: Setting, found: Found) -> None:
    """Numbers that are none, infinite speeds, limits that exclude each other, among good worlds."""
    for dtype in setting.sizes.dtypes:
        sim = setting.finger(dtype)
        work = setting.workload(WORLDS, STEPS)
        x, us = cast(dtype, work.x0, work.controls)
        bad = np.arange(WORLDS) % 16 == 5
        ill = x.copy()
        ill[5], ill[21, 3], ill[37] = np.nan, np.inf, -np.inf
        lower = np.tile(sim.params["lower"], (WORLDS, 1))
        limited = acting(sim.scene.structure, "lower")
        lower[np.ix_(bad & (np.arange(WORLDS) > 37), limited)] = 10.0  # above the upper ones
        _step(found, f"step, {dtype}", sim, x, ill, us, lower, bad)
        _rollout(found, f"rollout, {dtype}", sim, x, ill, us, lower, bad)
        _gradient(found, f"gradient, {dtype}", sim, x, ill, us, lower, bad)


def _pair(sim: slcp.Simulator, lower: np.ndarray) -> tuple[slcp.Parameters, slcp.Parameters]:
    good = np.tile(sim.params["lower"], (len(lower), 1))
    return sim.params.replace(lower=good), sim.params.replace(lower=lower)


def _step(found: Found, case: str, sim: slcp.Simulator, x: np.ndarray, ill: np.ndarray, us: np.ndarray,
          lower: np.ndarray, bad: np.ndarray) -> None:  # fmt: skip
    alone, among = (sim.step(s, us[:, 0], p) for s, p in zip((x, ill), _pair(sim, lower)))
    _neighbours(found, case, alone.state, among.state, alone.status, among.status, bad)
    kept = among.state[bad], ill[bad]
    found.check(f"{case}: an unsolved world stays where it was", np.array_equal(*kept, equal_nan=True))


def _rollout(found: Found, case: str, sim: slcp.Simulator, x: np.ndarray, ill: np.ndarray, us: np.ndarray,
             lower: np.ndarray, bad: np.ndarray) -> None:  # fmt: skip
    alone, among = (sim.rollout(s, us, p) for s, p in zip((x, ill), _pair(sim, lower)))
    _neighbours(found, case, alone.states, among.states, alone.status, among.status, bad)


def _gradient(found: Found, case: str, sim: slcp.Simulator, x: np.ndarray, ill: np.ndarray, us: np.ndarray,
              lower: np.ndarray, bad: np.ndarray) -> None:  # fmt: skip
    weights = np.ones((len(x), us.shape[1] + 1, sim.nx), x.dtype)
    alone, among = (slcp.vjp(sim, s, us, weights, p) for s, p in zip((x, ill), _pair(sim, lower)))
    _neighbours(found, case, alone.x0, among.x0, alone.status, among.status, bad)
    found.check(f"{case}: an unsolved world has none", bool(np.isnan(among.x0[bad]).all()))


def _neighbours(found: Found, case: str, alone: np.ndarray, among: np.ndarray, before: np.ndarray,
                after: np.ndarray, bad: np.ndarray) -> None:  # fmt: skip
    same = np.array_equal(alone[~bad], among[~bad], equal_nan=True)
    found.check(f"{case}: the others have the same bits", same and np.array_equal(before[~bad], after[~bad]))
    names = sorted({slcp.Status(int(code)).name for code in after[bad]})
    found.check(f"{case}: every bad world says so", bool(np.all(after[bad] != slcp.Status.SOLVED)), as_=names)
