"""The kernels of the other sections, compiled by processes side by side, and what their code takes."""

import contextlib
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from typing import Any

import warp as wp

from slcp_warp.kernels.device import cache
from slcp_warp.kernels.device.progress import describe, recorded
from slcp_warp.kernels.specialisation import Specialisation

from ..predicted import ARCH, FAST
from ..record import Found
from ..setting import CPU, Setting, cores
from ..uses import COMPARED, USES, uses_of

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
        if place is setting or name in COMPARED or name not in USES
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
            for row in rows:
                found.row(f"{case}: {row.pop('kernel')}", **row)
    seconds = time.perf_counter() - begin
    found.row("all of them", seconds=seconds, one_after_the_other=work, processes=workers)
    if setting.gpu:
        predicted(wp.get_device(setting.device), found)
        _memory(setting, found)


def compile_use(name: str, dtype: str, setting: Setting) -> Rows:
    """Run a use at its smallest; rows of the kernels that were made ready, and on a GPU of their code."""
    wp.config.log_level = wp.LOG_WARNING
    device = wp.get_device(setting.device)
    elsewhere = contextlib.nullcontext() if setting.arch is None else cache.compiling_for(setting.arch)
    with elsewhere, recorded() as kernels:
        uses_of(setting)[name](setting, dtype)
    setting.wait()
    rows: Rows = [
        {"kernel": each.kernel, "seconds": each.seconds, "compiled": each.compiled, "for": each.device}
        for each in kernels
        if each.device in (device.alias, f"sm_{setting.arch}")
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


def predicted(device: wp.Device, found: Found) -> None:
    """Whether the fast kernels take what their code for sm_90 was found to take."""
    for name, most in FAST.items():
        kernel = most.make()
        cache.load(kernel, device)
        used = wp.get_cuda_kernel_properties(kernel, device, cache.block_of(device))
        if device.arch != ARCH:
            found.row(f"{name}: code", **used)
            continue
        found.at_most(f"{name}: registers", used["register_count"], most.registers)
        found.at_most(f"{name}: bytes of local memory", used["local_memory_size"], most.frame)


def _memory(setting: Setting, found: Found) -> None:
    """What every use takes of the device's memory, one after the other: code, stacks of threads, arrays."""
    device = wp.get_device(setting.device)
    for dtype in setting.sizes.dtypes:
        for name, use in USES.items():
            before = device.free_memory
            use(setting, dtype)
            setting.wait()
            found.row(f"memory that {name}, {dtype} takes first", MB=(before - device.free_memory) / 1e6)
