"""The kernels of the other sections, compiled by processes side by side, and what their code takes."""

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any

import warp as wp

from slcp_warp.kernels.device import cache
from slcp_warp.kernels.device.progress import describe, recorded

from ..record import Found
from ..setting import Setting, cores
from ..uses import uses_of

ARCH = 90  # that the predictions are of
PREDICTED = {  # use -> the most registers and bytes of local memory of its largest kernel in float32
    "step smoothed": (255, 512), "rollout smoothed": (255, 576), "rollout hard": (255, 576),
    "adjoint smoothed": (255, 1024), "planning": (255, 2816), "sweep under a library": (255, 1536),
}  # fmt: skip


def run(setting: Setting, found: Found) -> None:
    """Every use of kernels in a process; the cache keeps them for the sections that follow."""
    jobs = [(name, dtype) for dtype in reversed(setting.sizes.dtypes) for name in uses_of(setting)]
    workers = min(len(jobs), cores())
    begin, work = time.perf_counter(), 0.0
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        waiting = {pool.submit(compile_use, name, dtype, setting): (name, dtype) for name, dtype in jobs}
        for done in as_completed(waiting):
            name, dtype = waiting[done]
            case = f"{name}, {dtype}"
            try:
                rows = done.result()
            except Exception as error:
                found.check(f"{case}: compiled", False, error=f"{type(error).__name__}: {error}")
                continue
            for row in rows:
                work += row.get("seconds", 0.0)
                found.row(f"{case}: {row.pop('kernel')}", **row)
            if setting.gpu:
                _predicted(name, dtype, rows, setting, found)
    seconds = time.perf_counter() - begin
    found.row("all of them", seconds=seconds, one_after_the_other=work, processes=workers)


def compile_use(name: str, dtype: str, setting: Setting) -> list[dict[str, Any]]:
    """Run a use at its smallest; a row for each of its kernels."""
    wp.config.log_level = wp.LOG_WARNING
    device = wp.get_device(setting.device)
    before = device.free_memory if device.is_cuda else 0
    with recorded() as kernels:
        uses_of(setting)[name](setting, dtype)
    setting.wait()
    rows: dict[str, dict[str, Any]] = {
        each.kernel: {"kernel": each.kernel, "seconds": each.seconds, "compiled": each.compiled}
        for each in kernels
        if each.device == device.alias
    }
    for kernel in list(cache._loaded.get(device.alias, ())) if device.is_cuda else []:
        row = rows.get(describe(kernel))
        if row is not None:
            row |= wp.get_cuda_kernel_properties(kernel, device)
    out = list(rows.values())
    if device.is_cuda:
        out.append({"kernel": "memory taken", "MB": (before - device.free_memory) / 1e6})
    return out


def _predicted(name: str, dtype: str, rows: list[dict[str, Any]], setting: Setting, found: Found) -> None:
    """Whether the largest kernel of a use takes what its code for sm_90 was found to take."""
    sized = [row for row in rows if "register_count" in row]
    if name not in PREDICTED or dtype != "float32" or not sized or wp.get_device(setting.device).arch != ARCH:
        return
    registers, local = PREDICTED[name]
    found.at_most(f"{name}: registers", max(row["register_count"] for row in sized), registers)
    found.at_most(f"{name}: bytes of local memory", max(row["local_memory_size"] for row in sized), local)
