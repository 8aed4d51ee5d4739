"""A sweep of many worlds under a plan and under a library, and what of it is the kernel's."""

import time

import numpy as np

import slcp_warp as slcp

from ..record import Found
from ..setting import DOUBLE, Setting
from ..uses import library, plan, sweep

CASES = 2  # of a scene's sweep: the smoothed and the hard problem
BUDGET = 30.0  # seconds that a policy's sweep may take: of more worlds fewer are run


def run(setting: Setting, found: Found) -> None:
    """Of the finger, masses and torques perturbed."""
    setting.keep_memory()
    sizes = setting.sizes
    policies = {"plan": plan(setting, DOUBLE), "library": library(setting)}
    steps = round(sizes.duration / slcp.scenes.flicking_finger().step_size)
    for name, policy in policies.items():
        few = max(10, sizes.sweep // 20)
        seconds = 0.0
        for _ in range(2):  # the first one compiles
            begin = time.perf_counter()
            sweep(setting, policy, few, sizes.duration)
            seconds = time.perf_counter() - begin
        worlds = int(min(sizes.sweep, max(few, few * BUDGET / max(seconds, 1e-9))))
        begin = time.perf_counter()
        report = sweep(setting, policy, worlds, sizes.duration)
        seconds = time.perf_counter() - begin
        found.row(f"under the {name}", worlds=worlds, steps=steps, seconds=seconds,
                  in_launches=sum(case["seconds"] for case in report.cases),
                  rate=CASES * worlds * steps / seconds)  # fmt: skip
        unsolved = float(np.mean(report.table["status"] != slcp.Status.SOLVED))
        found.at_most(f"under the {name}: unsolved worlds", unsolved, 1e-2)
