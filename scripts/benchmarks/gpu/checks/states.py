"""Steps of the device: as the CPU's, and as the oracle's equations have them; its random numbers."""

import functools
import time
from typing import Any

import numpy as np

import slcp_warp as slcp

from ...fuzz.draws import Worlds, draw_worlds
from ...fuzz.judged import judged
from ...fuzz.verdicts import SILENT, WRONG
from ..processes import side_by_side
from ..record import Found
from ..setting import CPU, Setting, cast

FEW = 10  # times fewer worlds of the stack, of which the oracle takes longer
CLOSE = {"float64": 1e-8, "float32": 2e-3}  # of 1 + |x'|: what contact makes of two roundings
SHARE = {"float64": 1e-3, "float32": 1e-2}  # of worlds that may be further off, or end with another status
MORE = 1e-4  # share of worlds that another rounding may take beyond what the oracle allows
ULPS = 8.0  # of a normal number's radius
ROUNDED = 1e-4  # share of normal numbers that may round to another one in single precision


def run(setting: Setting, found: Found) -> None:
    """Legal states of the finger, and random numbers and states of all classes for it and a stack."""
    sizes = setting.sizes
    finger = [(dtype, method) for dtype in sizes.dtypes for method in sizes.methods]
    side_by_side(_of_finger, setting, found, finger)
    side_by_side(_of_stack, setting, found, sizes.dtypes, 1)


def _of_finger(setting: Setting, found: Found, part: tuple[str, str]) -> None:
    dtype, method = part
    case = f"{method}, {dtype}"
    _legal(setting, found, case, dtype, method)
    sims = [setting.finger(dtype, method, device) for device in (setting.device, CPU)]
    _random(setting, found, f"finger, {case}", sims, setting.sizes.judged)


def _of_stack(setting: Setting, found: Found, dtype: str) -> None:
    sims = [setting.stack(dtype, device) for device in (setting.device, CPU)]
    _random(setting, found, f"stack of 3, hard, {dtype}", sims, max(10, setting.sizes.judged // FEW))


def _legal(setting: Setting, found: Found, case: str, dtype: str, method: str) -> None:
    work = setting.workload(setting.sizes.states)
    x, u = cast(dtype, work.x0, work.controls[:, 0])
    steps = [setting.finger(dtype, method, device).step(x, u) for device in (setting.device, CPU)]
    unsolved = float(np.mean(np.asarray(steps[0].status) != slcp.Status.SOLVED))
    found.at_most(f"legal states, {case}: unsolved", unsolved, 1e-3)
    _beside(found, f"legal states, {case}", dtype, steps)


def _random(setting: Setting, found: Found, case: str, sims: list[Any], count: int) -> None:
    """Judged by the oracle, both the device's and the CPU's, and laid beside each other."""
    worlds = _worlds(sims[0].scene, count, setting.seed)
    begin = time.perf_counter()
    (verdicts, mine), (others, cpu) = (judged(worlds, sim) for sim in sims)
    kinds, counts = np.unique(verdicts.verdict.astype(str), return_counts=True)
    found.row(case, worlds=count, judged_in_seconds=time.perf_counter() - begin,
              worst=verdicts.worst.max(initial=0.0), **dict(zip(kinds, counts)))  # fmt: skip
    bad, known = (np.isin(v.verdict, (SILENT, WRONG)) for v in (verdicts, others))
    reasons = sorted(set(verdicts.reason[bad & ~known].astype(str)))[:5]
    more = float(bad.mean() - known.mean())
    what = f"{case}: share of worlds that are wrong without saying so, less the CPU's"
    found.at_most(what, more, MORE, on_the_device=bad.sum(), on_the_cpu=known.sum(), reasons=reasons)
    _beside(found, case, sims[0].dtype.__name__, [mine, cpu])


@functools.lru_cache(2)
def _worlds(scene: slcp.Scene, count: int, seed: int) -> Worlds:
    return draw_worlds(np.random.default_rng(seed), scene, count)


def _beside(found: Found, case: str, dtype: str, steps: list[Any]) -> None:
    """States and statuses of the device and of the CPU."""
    (x, code), (other, other_code) = [(np.asarray(s.state, float), np.asarray(s.status)) for s in steps]
    differ = code != other_code
    both = (code == slcp.Status.SOLVED) & (other_code == slcp.Status.SOLVED)
    with np.errstate(invalid="ignore", over="ignore"):
        apart = np.abs(x - other).max(1) / (1.0 + np.abs(other).max(1))
    apart = np.where(both, apart, 0.0)
    same = float(np.mean((x == other)[both])) if both.any() else 1.0
    figures = {"median": np.median(apart[both]) if both.any() else 0.0, "largest": apart.max(initial=0.0)}
    found.at_most(f"{case}: statuses that are not the CPU's", float(differ.mean()), SHARE[dtype])
    far = float(np.mean(~(apart <= CLOSE[dtype])))
    what = f"{case}: states further than {CLOSE[dtype]:g} from the CPU's"
    found.at_most(what, far, SHARE[dtype], same_bits=same, **figures)


def random_numbers(setting: Setting, found: Found) -> None:
    """What a sweep draws: the same bits of uniform numbers, normal ones to few units in the last place."""
    task = slcp.tasks.flicking_finger()
    for dtype in setting.sizes.dtypes:
        mine, cpu = (
            slcp.ensembles.worlds.draws.draw_worlds(
                task, setting.sizes.states, setting.seed, dtype=dtype, device=device
            )
            for device in (setting.device, CPU)
        )
        for name in ("x0", "params"):
            a, b = (np.asarray(getattr(each, name), float) for each in (mine, cpu))
            off = a != b
            size = np.maximum(np.abs(b), np.abs(b).max(0)) + 1e-300
            error = np.max(np.abs(a - b) / size, initial=0.0) / np.finfo(dtype).eps
            found.at_most(f"{name}, {dtype}: units in the last place apart", error, ULPS, differ=off.mean())
        if dtype == "float32":
            share = float(np.mean(np.asarray(mine.x0) != np.asarray(cpu.x0)))
            found.at_most("x0, float32: numbers that are not the CPU's", share, ROUNDED)
