"""What is there: Warp, CUDA, driver, the devices and their memory."""

from typing import Any

import warp as wp

from slcp_warp.runs.origin import version

from ..record import Found
from ..setting import Setting, cores

WARP = "1.19"


def run(setting: Setting, found: Found) -> None:
    """Facts, and whether Warp is of the version that the package is written for."""
    for name in ("warp-lang", "numpy", "torch", "mujoco", "mujoco-warp"):
        found.row(name, version=version(name) or "not installed")
    found.check("Warp's version is the one that this package is tested with",
                wp.config.version.startswith(WARP), found=wp.config.version)  # fmt: skip
    found.row("cores", count=cores())
    found.row("CUDA", toolkit=_pair(wp.get_cuda_toolkit_version), driver=_pair(wp.get_cuda_driver_version))
    for device in wp.get_cuda_devices() if setting.gpu else []:
        found.row(
            device.alias, name=device.name, arch=device.arch, multiprocessors=device.sm_count,
            memory_GB=device.total_memory / 1e9, free_GB=device.free_memory / 1e9,
            memory_pools=device.is_mempool_supported, uuid=device.uuid, bus=device.pci_bus_id,
        )  # fmt: skip
    if setting.gpu:
        device = wp.get_device(setting.device)
        found.check("the device takes code of its own kind", device.is_cubin_supported, arch=device.arch)
        found.check("numbers come back as they went", _there_and_back(setting.device) == 499500.0)


def _pair(ask: Any) -> str:
    """A version as text, or why there is none."""
    try:
        return ".".join(map(str, ask()))
    except Exception as error:
        return f"none ({error})"


def _there_and_back(device: str) -> float:
    array: Any = wp.array(list(range(1000)), dtype=wp.float64, device=device)
    return float(wp.clone(array).numpy().sum())
