"""Where results come from: versions, sources, commit, processor."""

import datetime
import functools
import hashlib
import importlib.metadata
import importlib.util
import os
import platform
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import warp as wp

from slcp_warp.kernels.device.compile import cpu_compiler_flags

from ..storage.version import __version__

PACKAGE = Path(__file__).resolve().parents[1]
COMPUTES = ("slcp_warp", "slcp_warp.kernels", "slcp_warp.ddp")  # what results depend on; no commands
COMPARED = ("slcp-warp", "sources", "warp-lang", "numpy")  # of programs whose parts may stand side by side


def program() -> dict[str, str]:
    """What computes: versions, and a digest of this package's sources, which tells two commits apart."""
    return {"slcp-warp": __version__, "sources": _sources(), **{n: version(n) for n in COMPARED[2:]}}


@functools.cache
def _sources() -> str:
    """Digest of the package's sources, by name and contents."""
    digest = hashlib.sha256()
    for package in COMPUTES:
        spec = importlib.util.find_spec(package)
        if spec is None or spec.origin is None:
            continue
        folder = Path(spec.origin).parent
        for path in sorted(folder.rglob("*.py")):
            name = path.relative_to(folder).as_posix()
            if package == "slcp_warp" and name.split("/")[0] in ("kernels", "ddp", "scripts"):
                continue  # installed, they lie below it
            digest.update(f"{package}/{name}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def version(name: str) -> str:
    """The version of an installed package, empty where there is none."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


@functools.cache
def processor() -> str:
    """The processor's model."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")


def device_kind(device: wp.Device) -> str:
    """On what results have the same bits: the CPU with its compiler's flags, or a GPU's architecture."""
    return f"cpu {cpu_compiler_flags()}" if device.is_cpu else f"cuda sm_{device.arch}"


@functools.cache
def commit() -> str:
    """The commit of the working tree that holds the package, "+" where it has changes; empty outside one."""
    try:
        options: Any = {"cwd": PACKAGE, "capture_output": True, "text": True, "check": True, "timeout": 10}
        git = ["git", "--no-optional-locks"]
        subprocess.run([*git, "ls-files", "--error-unmatch", __file__], **options)
        head = subprocess.run([*git, "rev-parse", "--short", "HEAD"], **options).stdout.strip()
        changed = subprocess.run([*git, "status", "--porcelain", "-uno"], **options).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""
    return head + ("+" if changed else "")


def now() -> str:
    """The time, UTC, to the second."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def surroundings() -> dict[str, Any]:
    """Machine, interpreter, commit and command, for whoever reads results later."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "command": shlex.join(sys.orig_argv), "folder": _here(), "commit": commit(), "time": now(),
        "cpu": processor(), "cores": cores, "system": platform.platform(),
        "python": platform.python_version(),
    }  # fmt: skip


def _here() -> str:
    try:
        return os.getcwd()
    except OSError:  # it is gone
        return ""
