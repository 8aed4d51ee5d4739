"""Warp's cache of kernels: damage is mended, an unusable folder replaced, sharing works."""

import functools
import json
import os
import shutil
import subprocess
import sys
import threading
import time
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp.kernels.device import cache, forked
from slcp_warp.kernels.device.progress import recorded
from slcp_warp.kernels.residual.residuals import make_residual_kernel

RUN = """
import sys, threading, warp as wp
wp.config.log_level = wp.LOG_WARNING
import slcp_warp as slcp
from slcp_warp.kernels.device.cache import get_device, load_all
from slcp_warp.kernels.residual.residuals import make_residual_kernel
threads, kinds = int(sys.argv[1]), sys.argv[2:]
load_all([make_residual_kernel(wp.float64, kind) for kind in kinds], get_device("cpu"), 3)
barrier, out = threading.Barrier(threads), []
def work():
    barrier.wait()
    out.append(slcp.residual("min", 1.0, 2.0).item())
workers = [threading.Thread(target=work) for _ in range(threads)]
[w.start() for w in workers], [w.join() for w in workers]
print(out, wp.config.kernel_cache_dir)
"""

# the superuser without the right to write everywhere
RESTRICT = ["setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-all"]
RESTRICT = RESTRICT if os.name == "posix" and os.geteuid() == 0 and shutil.which("setpriv") else []


def start(threads=1, at_once=(), **environment):
    """A process that needs one small kernel, in so many threads at once, and before it others together."""
    variables = os.environ | {"PYTHONSAFEPATH": "1"} | {k: str(v) for k, v in environment.items()}
    variables = {name: value for name, value in variables.items() if value != "None"}
    command = [*RESTRICT, sys.executable, "-c", RUN, str(threads), *at_once]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, env=variables, text=True, **pipes)


def ended(process, threads=1):
    """What a process of `start` said; it must have got its numbers."""
    out, errors = process.communicate()
    assert process.returncode == 0 and out.startswith(str([1.0] * threads)), out + errors
    return out, errors


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache of this test's own that holds one kernel; the kernel's folder."""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    again()
    return next(tmp_path.glob("wp_*"))


def again():
    """Compute with the kernel as a new process would: from the cache."""
    kernel = make_residual_kernel(wp.float64, "min")
    kernel.module.unload()
    cache._loaded.clear()
    np.testing.assert_array_equal(slcp.residual("min", [1.0, 5.0], [2.0, 3.0]), [1.0, 3.0])


def halved(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flipped(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 4] ^= 0xFF
    path.write_bytes(bytes(data))


DAMAGE = {
    "object cut off": ("*.o", halved),
    "object empty": ("*.o", lambda path: path.write_bytes(b"")),
    "object with a flipped byte": ("*.o", flipped),  # Warp runs it: a crash, or another result
    "object gone": ("*.o", lambda path: path.unlink()),
    "description cut off": ("*.meta", halved),
    "checksum cut off": ("checksums.json", halved),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_kernel_is_compiled_again_once(folder, what):
    pattern, damage = DAMAGE[what]
    damage(next(folder.glob(pattern)))
    with pytest.warns(RuntimeWarning, match="compiled again") as caught:
        again()
    assert len(caught) == 1 and str(folder) in str(caught[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again()
    assert [path.name for path in folder.parent.glob("wp_*")] == [folder.name]


def test_an_object_without_a_checksum_is_compiled_again(folder):
    """A process may have been killed before it was whole; nobody knows, so nobody is warned."""
    halved(next(folder.glob("*.o")))
    (folder / "checksums.json").unlink()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again()


def test_a_kernel_that_is_loaded_needs_no_folder(folder):
    """The cache was emptied, or is another one, since the kernel was loaded from it."""
    shutil.rmtree(folder)
    cache._loaded.clear()
    np.testing.assert_array_equal(slcp.residual("min", [1.0, 5.0], [2.0, 3.0]), [1.0, 3.0])
    again()
    assert folder.exists()


def test_objects_for_several_processors_share_a_folder(folder):
    """Those with a checksum stay; one without is not trusted, and is compiled by who needs it."""
    (folder / "another.o").write_bytes(b"for another processor")
    (folder / "checksums.json").write_text(json.dumps(cache._checksums(folder)))
    (folder / "third.o").write_bytes(b"for a third one")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again()
    listed = json.loads((folder / "checksums.json").read_text())
    assert "another.o" in listed and "third.o" not in listed and not (folder / "third.o").exists()


def test_an_object_that_was_never_right_is_compiled_again(folder):
    """Damaged before its checksum was written, by a disk that was full, say."""
    halved(next(folder.glob("*.o")))
    (folder / "checksums.json").write_text(json.dumps(cache._checksums(folder)))
    with pytest.warns(RuntimeWarning, match="cannot be loaded"):
        again()


@pytest.mark.filterwarnings("ignore:the compiled kernel")
def test_a_folder_that_cannot_be_written_is_not_needed_for_what_is_in_it(folder, monkeypatch):
    def refuse(path):
        return f"{path} cannot be written"

    monkeypatch.setattr(cache, "_unwritable", refuse)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again()
    next(folder.glob("*.o")).unlink()
    with pytest.warns(RuntimeWarning, match="WARP_CACHE_PATH"):
        again()
    assert wp.config.kernel_cache_dir != str(folder.parent)


def test_without_any_folder_there_is_one_error(folder, monkeypatch):
    def refuse(**options):
        raise OSError(28, "No space left on device")

    next(folder.glob("*.o")).unlink()
    monkeypatch.setattr(cache, "_unwritable", lambda path: f"{path} cannot be written")
    monkeypatch.setattr(cache.tempfile, "mkdtemp", refuse)
    with pytest.raises(cache.KernelCacheError, match="cannot be written, and .* WARP_CACHE_PATH"):
        with warnings.catch_warnings(action="ignore"):
            again()


@pytest.mark.parametrize("what", ["home", "path", "read only", "name"])
def test_an_unusable_folder_is_replaced_with_a_warning(tmp_path, what):
    """A home or a cache below a file; a folder without permission; a name that the locale cannot encode."""
    (tmp_path / "file").write_text("")
    (tmp_path / "locked").mkdir(mode=0o555)
    given = {
        "home": {"HOME": tmp_path / "file", "XDG_CACHE_HOME": None, "WARP_CACHE_PATH": None},
        "path": {"WARP_CACHE_PATH": tmp_path / "file" / "cache"},
        "read only": {"WARP_CACHE_PATH": tmp_path / "locked"},
        "name": {"WARP_CACHE_PATH": tmp_path / "größe", "LC_ALL": "POSIX", "PYTHONUTF8": 0,
                 "PYTHONCOERCECLOCALE": 0},
    }[what]  # fmt: skip
    if what == "read only" and os.access(tmp_path / "locked", os.W_OK) and not RESTRICT:
        pytest.skip("this user may write everywhere")
    out, errors = ended(start(**given))
    place = out.split()[-1]
    assert "slcp-warp-kernels-" in place and not os.path.exists(place)  # it goes with the process
    assert errors.count("RuntimeWarning") == 1 and "set WARP_CACHE_PATH" in errors


def test_processes_and_threads_compile_the_same_kernel_at_once(tmp_path):
    """Three processes of three threads in an empty cache: one compiles, all get it, nothing is left over."""
    running = [start(threads=3, WARP_CACHE_PATH=tmp_path) for _ in range(3)]
    for process in running:
        _, errors = ended(process, threads=3)
        assert "compiled again" not in errors
    (folder,) = tmp_path.rglob("wp_*_kernel_*/")
    assert sorted(p.suffix for p in folder.iterdir()) == [".cpp", ".json", ".meta", ".o"]


def test_processes_compile_several_kernels_at_once(tmp_path):
    kinds = ("min", "rem-logistic", "rem-normal")
    for running in [start(at_once=kinds, WARP_CACHE_PATH=tmp_path) for _ in range(2)]:
        assert "compiled again" not in ended(running)[1]
    assert len(list(tmp_path.rglob("wp_*_kernel_*/checksums.json"))) == len(kinds)
    assert not list(tmp_path.rglob("*.part")) and not list(tmp_path.rglob("*_t*"))


def test_threads_that_find_an_unusable_folder_replace_it_once(tmp_path):
    (tmp_path / "file").write_text("")
    running = start(
        at_once=("min", "rem-logistic", "rem-normal"), WARP_CACHE_PATH=tmp_path / "file" / "cache"
    )
    out, errors = ended(running)
    assert errors.count("RuntimeWarning") == 1 and not os.path.exists(out.split()[-1])


def test_kernels_for_a_gpu_are_compiled_at_once(monkeypatch):
    kernels = [make_residual_kernel(wp.float64, name) for name in ("min", "rem-logistic")]
    both = threading.Barrier(2, timeout=20)
    device = SimpleNamespace(is_cpu=False, alias="a GPU")

    def compiling(kernel, device, file):
        both.wait()
        return cache.Loaded(kernel.key, device.alias, 1.0, True)

    monkeypatch.setattr(cache, "_loaded_kernel", compiling)
    with recorded() as found:
        cache.load_all(kernels, device, 2)
        cache.load_all(kernels[:1], device, 2)  # is ready
    assert [loaded.kernel for loaded in found] == [kernel.key for kernel in kernels]


KINDS = ("min", "rem-logistic", "rem-normal")


def fresh_kernels(monkeypatch):
    """Kernels that this process has not loaded."""
    monkeypatch.setattr(cache, "_loaded", {})
    kernels = [make_residual_kernel(wp.float64, kind) for kind in KINDS]
    for kernel in kernels:
        kernel.module.unload()
    return kernels


@pytest.mark.skipif(not forked.FORKS, reason="processes are forked on Linux alone")
@pytest.mark.parametrize("child", ["well", "killed", "error", "too long"])
def test_kernels_for_a_cpu_are_compiled_by_processes(tmp_path, monkeypatch, child):
    """Whatever becomes of these."""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    monkeypatch.setattr(cache, "PATIENCE", 0.3 if child == "too long" else 60.0)
    work = {
        "killed": lambda *_: os.kill(os.getpid(), 9),
        "error": lambda *_: 1 / 0,
        "too long": lambda *_: time.sleep(60.0),
    }
    if child in work:
        monkeypatch.setattr(cache, "_compile_here", work[child])
    compiled, compile_ = [], wp._src.context.Module._compile

    def counted(*given, **more):
        compiled.append(compile_(*given, **more))
        return compiled[-1]

    monkeypatch.setattr(wp._src.context.Module, "_compile", counted)
    with recorded() as found:
        cache.load_all(fresh_kernels(monkeypatch), wp.get_device("cpu"), 2)
    assert sum(compiled) == (0 if child == "well" else len(KINDS))  # by this process
    assert [each.compiled for each in found] == [True] * len(KINDS)
    assert len(list(tmp_path.glob("wp_*/checksums.json"))) == len(KINDS)
    again()
    assert slcp.residual("min", 1.0, 2.0).item() == 1.0


@pytest.mark.skipif(not forked.FORKS, reason="processes are forked on Linux alone")
def test_processes_end_with_who_asked_for_them(tmp_path, monkeypatch):
    def job(name):
        (tmp_path / name).write_text(str(os.getpid()))
        time.sleep(60.0)

    def sleep(seconds):
        if len(list(tmp_path.iterdir())) == 2:
            raise KeyboardInterrupt
        wait(seconds)

    wait = time.sleep
    jobs = [functools.partial(job, name) for name in "abc"]
    monkeypatch.setattr(forked.time, "sleep", lambda s: sleep(s) if os.getpid() == own else wait(s))
    own = os.getpid()
    with pytest.raises(KeyboardInterrupt):
        forked.in_processes(jobs, 2, 60.0)
    for name in "ab":
        with pytest.raises(ProcessLookupError):
            os.kill(int((tmp_path / name).read_text() or 0) or 2**30, 0)
