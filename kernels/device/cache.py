"""Warp's cache of compiled kernels: nothing damaged is run, and a folder that cannot be used is replaced.

Warp runs what it finds in its cache. A truncated object is a bare exception there, one with a flipped byte a
crash or another result. So beside every object lies its checksum, written once the object is whole; a kernel
without a matching one is compiled again. Processes that need the same kernel wait for each other, threads
too. Where the folder cannot be written, or its name cannot be given to the compiler, kernels are compiled
into a temporary folder, with a warning.
"""

import atexit
import hashlib
import json
import os
import pathlib
import shutil
import tempfile
import threading
import time
import warnings
import weakref
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import Any

import warp as wp

from ..factories import building
from .forked import FORKS, in_processes
from .progress import Loaded, announced, describe, one_line, record

try:
    import fcntl
except ImportError:  # Windows: processes do not wait for each other, and may compile the same twice
    fcntl = None  # type: ignore[assignment]

CHECKSUMS = "checksums.json"
CHECKED = (".o", ".cubin", ".ptx", ".meta")
NAMED = 3  # kernels of several that are compiled at once that are named
PATIENCE = 600.0  # seconds that a process waits for another one's compiler before it compiles itself

# Threads of a block on a GPU. How many of a kernel's warps a multiprocessor holds is up to its registers;
# blocks of two warps waste none of that room (of eight: 8 warps are held instead of 12 at 168 registers), and
# spread few worlds over many multiprocessors
BLOCK = 64

_loaded: dict[str, "weakref.WeakSet[wp.Kernel]"] = {}
_elsewhere: list[int] = []  # kinds of GPUs that need not be here
_prepared = False
_looking = threading.Lock()  # one thread at a time finds that the folder cannot be used


class KernelCacheError(OSError):
    """No folder for compiled kernels; the message names the folders tried and what to set."""


def block_of(device: wp.Device) -> int:
    """Threads of a block of a launch."""
    return 1 if device.is_cpu else BLOCK


def for_gpu(device: Any) -> bool:
    """Whether kernels are chosen for a GPU: one that is here, or one elsewhere."""
    return bool(_elsewhere) or not wp.get_device(device).is_cpu


@contextmanager
def compiling_for(arch: int) -> Iterator[None]:
    """Kernels that are loaded meanwhile are a GPU's, and are compiled for GPUs of a kind, too, into the
    cache; such a GPU need not be here.

    Args:
        arch: 90 for sm_90.

    Raises:
        ValueError: Warp compiles for no such kind.
    """
    _prepare()
    known = sorted(wp._src.context.runtime.nvrtc_supported_archs)
    if arch not in known:
        raise ValueError(f"arch is {arch}; Warp compiles for {', '.join(map(str, known)) or 'no GPU'} here")
    _elsewhere.append(arch)
    try:
        yield
    finally:
        _elsewhere.pop()


def get_device(device: Any = None) -> wp.Device:
    """A Warp device by its name (None: the preferred one), with a folder for kernels that can be used."""
    _prepare()
    return wp.get_preferred_device() if device is None else wp.get_device(device)


def load(kernel: wp.Kernel, device: wp.Device) -> None:
    """Compile a kernel, or take it from the cache if it is whole there, before its first launch.

    Raises:
        KernelCacheError: it has to be compiled, and there is no folder that can be written.
    """
    load_all((kernel,), device)


def load_all(kernels: Sequence[wp.Kernel], device: wp.Device, threads: int = 1) -> None:
    """As `load`; several kernels are compiled by so many threads for a GPU, by so many processes for a CPU
    (on Linux, else one after the other), at best in the time of the slowest.
    """
    done = _loaded.get(device.alias, ())
    if all(kernel in done for kernel in kernels):
        return
    with building():
        _prepare()
        done = _loaded.setdefault(device.alias, weakref.WeakSet())
        missing = [kernel for kernel in dict.fromkeys(kernels) if kernel not in done]  # by no other thread
        if missing:
            with announced(f"{_in_few_words(missing, device)} for {device.alias}"), one_line():
                found = _compiled(missing, device, threads)
                found += [_compiled_elsewhere(kernel, arch) for arch in _elsewhere for kernel in missing]
            for loaded in found:
                record(loaded)
            done.update(missing)


def _compiled(kernels: Sequence[wp.Kernel], device: wp.Device, threads: int) -> list[Loaded]:
    most, apart = min(threads, len(kernels)), dict[wp.Kernel, float]()
    if most > 1 and device.is_cpu:
        apart = _compiled_apart(kernels, device, most)
    with _lock_file() as file:
        if most == 1 or device.is_cpu:
            found = [_loaded_kernel(kernel, device, file) for kernel in kernels]
        else:
            with ThreadPoolExecutor(most) as pool:
                found = list(pool.map(lambda kernel: _loaded_kernel(kernel, device, file), kernels))
    return [
        replace(each, seconds=apart[kernel] + each.seconds, compiled=True) if kernel in apart else each
        for kernel, each in zip(kernels, found)
    ]


def _compiled_elsewhere(kernel: wp.Kernel, arch: int) -> Loaded:
    start, module = time.monotonic(), kernel.module
    options = module.resolve_options(wp.config, block_dim=BLOCK)
    with _lock_file() as file, _alone(module.name, file):
        folder = _usable_folder(module, BLOCK)
        module._compile(None, str(folder), output_arch=arch, use_ptx=False, options=options)
        compiled = bool(_unlisted(folder, _listed(folder)))
        if compiled:
            _write_checksums(folder)
    return Loaded(describe(kernel), f"sm_{arch}", time.monotonic() - start, compiled)


def _compiled_apart(kernels: Sequence[wp.Kernel], device: wp.Device, most: int) -> dict[wp.Kernel, float]:
    """Those that were not in the cache and now are, and in how many seconds all of them."""
    block = block_of(device)
    new = [kernel for kernel in kernels if not _folder(kernel.module, block).exists()]
    if len(new) < 2 or not FORKS:
        return {}
    with _looking:
        _usable_folder(new[0].module, block)  # a folder of this process's own, not of a child's
    start = time.monotonic()
    in_processes([partial(_compile_here, kernel, device) for kernel in new], most, PATIENCE)
    seconds = time.monotonic() - start
    return {kernel: seconds for kernel in new if _folder(kernel.module, block).exists()}


def _compile_here(kernel: wp.Kernel, device: wp.Device) -> None:
    wp.config.log_level = wp.LOG_ERROR
    with _lock_file() as file:
        _loaded_kernel(kernel, device, file)


def _in_few_words(kernels: Sequence[wp.Kernel], device: wp.Device) -> str:
    """Some kernels in words; of many those that are not in the cache, and of these three at most."""
    new = [each for each in kernels if not _folder(each.module, block_of(device)).exists()] or kernels
    words = [describe(kernel) for kernel in new]
    if len(words) > NAMED + 1:
        words = [*words[:NAMED], f"{len(words) - NAMED} more"]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _loaded_kernel(kernel: wp.Kernel, device: wp.Device, file: Any) -> Loaded:
    start = time.monotonic()
    with _alone(kernel.module.name, file):
        compiled = _load(kernel.module, device)
    return Loaded(describe(kernel), device.alias, time.monotonic() - start, compiled)


def _load(module: Any, device: wp.Device) -> bool:
    """Load a module; whether it had to be compiled."""
    block = block_of(device)
    with _looking:
        folder = _usable_folder(module, block)
    cached = folder.exists()
    try:
        module.load(device, block)
    except Exception as error:
        if not cached:
            raise
        _remove(folder, f"it cannot be loaded ({error})")
        module.load(device, block)
        folder = _folder(module, block)
    compiled = folder.exists() and bool(_unlisted(folder, _listed(folder)))  # it may be loaded from elsewhere
    if compiled:
        _write_checksums(folder)
    return compiled


def _usable_folder(module: Any, block: int) -> pathlib.Path:
    """Where a module's objects are, whole ones alone, or can be written."""
    folder = _folder(module, block)
    if folder.exists():
        _keep_what_is_whole(folder)
    folder = _folder(module, block)
    reason = None if folder.exists() else _unwritable(folder.parent)
    if reason is not None:
        _use_temporary_folder(reason)
    return _folder(module, block)


def _folder(module: Any, block: int) -> pathlib.Path:
    return pathlib.Path(wp.config.kernel_cache_dir, module.get_module_identifier(block))


def _checksums(folder: pathlib.Path) -> dict[str, str]:
    """SHA-256 of everything in a kernel's folder that Warp reads."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in _unlisted(folder, {})}


def _listed(folder: pathlib.Path) -> dict[str, str]:
    """The checksums that were written; none, if none were."""
    try:
        content = json.loads((folder / CHECKSUMS).read_bytes())
    except FileNotFoundError:
        return {}
    if not isinstance(content, dict):
        raise ValueError("its checksums are no table")
    return content


def _unlisted(folder: pathlib.Path, listed: dict[str, str]) -> list[pathlib.Path]:
    """What Warp reads and no checksum vouches for."""
    return sorted(p for p in folder.iterdir() if p.suffix in CHECKED and p.name not in listed)


def _keep_what_is_whole(folder: pathlib.Path) -> None:
    """Take out of the cache what is damaged, and what no checksum vouches for.

    Objects for several processors share a kernel's folder. One without a checksum is Warp's own work or that
    of a process that was killed, maybe whole, maybe not: it goes without a warning.
    """
    try:
        listed, found = _listed(folder), _checksums(folder)
        if any(found.get(name) != checksum for name, checksum in listed.items()):
            raise ValueError("its checksum does not match")
        for path in _unlisted(folder, listed):
            path.unlink()
    except (OSError, ValueError) as error:
        _remove(folder, str(error))


def _write_checksums(folder: pathlib.Path) -> None:
    """Put the checksums beside a kernel; where that fails, the next process compiles it again."""
    try:
        part = folder / f"{CHECKSUMS}.{os.getpid()}.part"
        part.write_text(json.dumps(_checksums(folder)), encoding="utf-8")
        part.replace(folder / CHECKSUMS)
    except OSError as error:
        warnings.warn(f"{folder}: its checksum cannot be written ({error})", RuntimeWarning, stacklevel=2)


def _remove(folder: pathlib.Path, fault: str) -> None:
    """Take a damaged kernel out of the cache."""
    warnings.warn(f"the compiled kernel in {folder} is compiled again: {fault}", RuntimeWarning, stacklevel=2)
    away = folder.with_name(f"{folder.name}_damaged_p{os.getpid()}")
    try:
        folder.replace(away)
    except OSError as error:
        _use_temporary_folder(f"{folder} is not whole and cannot be removed ({error.strerror})")
    shutil.rmtree(away, ignore_errors=True)


def _unwritable(folder: pathlib.Path) -> str | None:
    """Why no file can be written below a folder; None if one can."""
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix="slcp-warp-") as file:
            file.write(b"\0")
        str(folder).encode("utf-8")
    except UnicodeEncodeError:
        return f"the name of {str(folder)!a} cannot be encoded in this locale"
    except OSError as error:
        return f"{folder} cannot be written ({error.strerror})"
    return None


def _prepare() -> None:
    """Initialise Warp, with a temporary folder for kernels where it cannot make its own."""
    global _prepared
    if _prepared:
        return
    with building():
        try:
            wp.init()
            str(wp.config.kernel_cache_dir).encode("utf-8")
        except UnicodeEncodeError:
            name = ascii(str(wp.config.kernel_cache_dir))
            _use_temporary_folder(f"the name of {name} cannot be encoded in this locale")
        except OSError as error:
            if error.filename is None:  # a library of Warp's that is not there, not a folder
                raise
            _use_temporary_folder(f"{error.filename} cannot be made ({error.strerror})")
            wp.init()
        _prepared = True


def _use_temporary_folder(reason: str) -> None:
    """Compile kernels into a folder of this process's own from now on."""
    hint = "set WARP_CACHE_PATH to a folder that can be written"
    try:
        folder = tempfile.mkdtemp(prefix="slcp-warp-kernels-")
        folder.encode("utf-8")
    except (OSError, UnicodeEncodeError) as error:
        raise KernelCacheError(
            f"no folder for compiled kernels: {reason}, and there is no temporary one; {hint}"
        ) from error
    warnings.warn(
        f"{reason}; kernels are compiled into {folder} for this process alone: {hint}",
        RuntimeWarning,
        stacklevel=2,
    )
    wp.config.kernel_cache_dir = folder
    atexit.register(_remove_own, folder, os.getpid())


def _remove_own(folder: str, pid: int) -> None:
    if os.getpid() == pid:  # not at the end of a process forked from the one that made it
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _lock_file() -> Iterator[Any]:
    """The file whose bytes are locks; None where there are none, or the folder can only be read.

    A process that closes it gives all of its locks back: it is opened once for all kernels of a call.
    """
    try:
        if fcntl is None:
            raise OSError
        file = open(pathlib.Path(wp.config.kernel_cache_dir, "slcp-warp.lock"), "ab")
    except OSError:  # objects appear in the folder as a whole anyway
        yield None
        return
    with file:
        yield file


@contextmanager
def _alone(name: str, file: Any) -> Iterator[None]:
    """Hold a kernel against other processes: the byte of the lock file that its name falls on."""
    if file is None:
        yield
        return
    byte = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "little") % 2**30
    _wait_for(file, byte)
    try:
        yield
    finally:
        with suppress(OSError):
            fcntl.lockf(file, fcntl.LOCK_UN, 1, byte)


def _wait_for(file: Any, byte: int) -> None:
    """Lock a byte, or give up where locks do not work or the other process takes too long."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
            return
        except (BlockingIOError, PermissionError):
            time.sleep(0.02)
        except OSError:
            return
