"""The kernels of the other sections, compiled by processes side by side, and what their code takes."""

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from typing import Any

import warp as wp

from slcp_warp.kernels.device import cache
from slcp_warp.kernels.device.progress import describe, recorded
from slcp_warp.kernels.specialisation import Specialisation

from ..record import Found
from ..setting import CPU, Setting, cores
from ..uses import COMPARED, uses_of

ARCH = 90  # that the predictions are of
PREDICTED = {  # use -> the most registers and bytes of local memory of its fast kernel in float32
    "rollout smoothed": (200, 32), "rollout hard": (176, 32), "sweep under a library": (200, 32 + 768 + 32),
    "planning": (200, 40),
}  # fmt: skip
Rows = list[dict[str, Any]]


def run(setting: Setting, found: Found) -> None:
    """Every use of kernels in a process, for the device and, where they are compared, for the CPU; the cache
    keeps them for the sections that follow.
    """
    places = [setting, replace(setting, device=CPU)] if setting.gpu else [setting]
    jobs = [
        (name, dtype, place)
        for place in places
        for dtype in reversed(setting.sizes.dtypes)
        for name in uses_of(setting)
        if place is setting or name in COMPARED
    ]
    begin, work, workers = time.perf_counter(), 0.0, min(len(jobs), cores())
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        waiting = {pool.submit(compile_use, *job): job for job in jobs}
        for done in as_completed(waiting):
            name, dtype, place = waiting[done]
            case = f"{name}, {dtype}, {place.device}"
            try:
                rows = done.result()
            except Exception as error:
                found.check(f"{case}: compiled", False, error=f"{type(error).__name__}: {error}")
                continue
            work += sum(row.get("seconds", 0.0) for row in rows)
            if place.gpu:
                _predicted(name, dtype, rows, place, found)
            for row in rows:
                found.row(f"{case}: {row.pop('kernel')}", **row)
    seconds = time.perf_counter() - begin
    found.row("all of them", seconds=seconds, one_after_the_other=work, processes=workers)
    if setting.gpu:
        _memory(setting, found)


def compile_use(name: str, dtype: str, setting: Setting) -> Rows:
    """Run a use at its smallest; rows of the kernels that were made ready, and on a GPU of their code."""
    wp.config.log_level = wp.LOG_WARNING
    device = wp.get_device(setting.device)
    with recorded() as kernels:
        uses_of(setting)[name](setting, dtype)
    setting.wait()
    rows: Rows = [
        {"kernel": each.kernel, "seconds": each.seconds, "compiled": each.compiled}
        for each in kernels
        if each.device == device.alias
    ]
    return rows + ([_code(kernel, device) for kernel in _loaded(device)] if device.is_cuda else [])


def _loaded(device: wp.Device) -> list[wp.Kernel]:
    return list(cache._loaded.get(device.alias, ()))


def _code(kernel: wp.Kernel, device: wp.Device) -> dict[str, Any]:
    """What a kernel's code takes on a device, and which part of the steps it makes."""
    made: dict[str, Any] = getattr(kernel, "made_with", {})
    parts = [value.method.part for value in made.values() if isinstance(value, Specialisation)]
    used = wp.get_cuda_kernel_properties(kernel, device, cache.block_of(device))
    return {"kernel": f"{describe(kernel)}: code", "part": parts[0] if parts else "", **used}


def _predicted(name: str, dtype: str, rows: Rows, setting: Setting, found: Found) -> None:
    """Whether the fast kernel of a use takes what its code for sm_90 was found to take."""
    fast = [row for row in rows if row.get("part") == "fast"]
    if name not in PREDICTED or dtype != "float32" or not fast or wp.get_device(setting.device).arch != ARCH:
        return
    registers, local = PREDICTED[name]
    found.at_most(f"{name}: registers", max(row["register_count"] for row in fast), registers)
    found.at_most(f"{name}: bytes of local memory", max(row["local_memory_size"] for row in fast), local)


def _memory(setting: Setting, found: Found) -> None:
    """What every use takes of the device's memory, one after the other: code, stacks of threads, arrays."""
    device = wp.get_device(setting.device)
    for dtype in setting.sizes.dtypes:
        for name, use in uses_of(setting).items():
            before = device.free_memory
            use(setting, dtype)
            setting.wait()
            found.row(f"memory that {name}, {dtype} takes first", MB=(before - device.free_memory) / 1e6)
