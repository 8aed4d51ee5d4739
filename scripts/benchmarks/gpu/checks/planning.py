"""Passes of DDP a second, over the number of problems."""

from functools import partial

import numpy as np

from ..record import Found
from ..setting import Setting
from ..timing import seconds
from ..uses import workspace


def run(setting: Setting, found: Found) -> None:
    """From starts of their own and zero controls, none of the problems ending early."""
    setting.keep_memory()
    sizes = setting.sizes
    for dtype in sizes.dtypes:
        for count in sizes.problems:
            work = workspace(setting, dtype, count, sizes.passes)
            starts, zeros = setting.near_start(count), np.zeros((count, sizes.horizon, 2))
            passes = work.run(starts, zeros)
            middle, least = seconds(setting, partial(work.run, starts, zeros), min(3, sizes.repeats))
            done = int(work.passes.numpy().sum())  # of some problems fewer than of others
            found.row(
                f"{count} problems, {dtype}", problems=count, dtype=dtype, passes=passes, done=done,
                rate=done / middle, best_rate=done / least, ms_a_pass=1e3 * middle / max(1, passes),
            )  # fmt: skip
