"""Seconds of a call until the device has done it."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from .setting import Setting


def seconds(setting: Setting, call: Callable[[], Any], repeats: int | None = None) -> tuple[float, float]:
    """Median and least wall time of a call, the device's work included; once more before, unmeasured."""
    call()
    setting.wait()
    spent = []
    for _ in range(repeats or setting.sizes.repeats):
        begin = time.perf_counter()
        call()
        setting.wait()
        spent.append(time.perf_counter() - begin)
    return float(np.median(spent)), float(min(spent))
