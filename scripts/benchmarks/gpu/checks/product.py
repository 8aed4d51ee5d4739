"""Sweeps, replays, environments, plans and questions of robustness, of the device and of the CPU."""

import time

import numpy as np

from ..processes import side_by_side
from ..product import PRODUCT, there
from ..record import Found
from ..setting import CPU, Setting, cores

WORKERS = 8


def run(setting: Setting, found: Found) -> None:
    """Every use, on both, in few processes: they take turns on a GPU."""
    workers = min(WORKERS, cores()) if setting.gpu else 1
    side_by_side(_beside, setting, found, tuple(PRODUCT), workers)


def _beside(setting: Setting, found: Found, name: str) -> None:
    use = PRODUCT[name]
    if not there(use):
        found.note(f"{name}: {use.needs} is not installed")
        return
    spent = []
    numbers = []
    for device in (setting.device, CPU):
        begin = time.perf_counter()
        try:
            numbers.append(use.run(device))
        except Exception as error:
            found.check(f"{name}, {device}: it runs", False, error=f"{type(error).__name__}: {error}"[:2000])
            return
        spent.append(time.perf_counter() - begin)
    found.row(name, seconds=spent[0], seconds_of_the_cpu=spent[1])
    mine, cpu = numbers
    for what, theirs in cpu.items():
        a, b = (np.asarray(each, float).reshape(len(each), -1) for each in (mine[what], theirs))
        both = (a == b) | (np.isnan(a) & np.isnan(b))
        with np.errstate(invalid="ignore"):
            apart = np.where(both, 0.0, np.abs(a - b)).max(1, initial=0.0)
            size = np.max(np.abs(np.where(np.isfinite(b), b, 0.0)), 1, initial=0.0)
        far = float(np.mean(~(apart <= use.within * (1.0 + size))))
        found.at_most(f"{name}: {what} further than {use.within:g} from the CPU's", far, use.share,
                      same_bits=both.mean(), worlds=len(b),
                      largest=np.nanmax(apart, initial=0.0))  # fmt: skip
