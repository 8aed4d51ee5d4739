"""The line that says what is compiled: when, what and for how long; and who gets to know."""

import io
import re
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp.kernels.device import cache, progress
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP
from slcp_warp.kernels.residual.residuals import make_residual_kernel
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step import rollout


@pytest.fixture
def said(monkeypatch):
    """What comes on stderr, where a user sees progress at once."""
    stderr = io.StringIO()
    monkeypatch.setattr(progress, "sys", SimpleNamespace(stderr=stderr))  # pytest puts its own into sys
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setenv("SLCP_PROGRESS", "1")
    return stderr


def begun(stderr):
    """Wait until a line has begun."""
    for _ in range(3000):
        if stderr.getvalue().rpartition("\n")[2]:
            return
        time.sleep(0.01)
    raise AssertionError("no line was begun")


def test_what_takes_long_is_one_line(said):
    with progress.announced("this and that"):
        begun(said)
        assert said.getvalue() == "slcp-warp: compiling this and that ..."
    assert re.fullmatch(r"slcp-warp: compiling this and that \.\.\. \d+\.\d s\n", said.getvalue())


def test_what_is_ready_soon_is_no_line(said, monkeypatch):
    monkeypatch.setattr(progress, "PATIENCE", 1e6)
    with progress.announced("this and that"):
        pass
    assert said.getvalue() == ""
    timers = [t for t in threading.enumerate() if isinstance(t, threading.Timer)]
    assert all(timer.finished.is_set() for timer in timers)


def test_warp_does_not_speak_in_between(said, monkeypatch):
    """Its own line, where it is to be seen, is left out while this one is."""
    monkeypatch.setattr(wp.config, "log_level", wp.LOG_INFO)
    with progress.one_line():
        assert wp.config.log_level == wp.LOG_WARNING
    assert wp.config.log_level == wp.LOG_INFO
    monkeypatch.setenv("SLCP_PROGRESS", "0")
    with progress.one_line():
        assert wp.config.log_level == wp.LOG_INFO


def test_a_line_ends_where_compiling_fails(said):
    with pytest.raises(RuntimeError, match="no memory"):
        with progress.announced("this and that"):
            begun(said)
            raise RuntimeError("no memory")
    assert re.search(r"stopped after \d+\.\d s\n$", said.getvalue())


@pytest.mark.parametrize("how", ["0", "off", "No", " false "])
def test_a_variable_turns_it_off(said, monkeypatch, how):
    monkeypatch.setenv("SLCP_PROGRESS", how)
    assert not progress.wanted()
    with progress.announced("this and that"):
        assert not [t for t in threading.enumerate() if isinstance(t, threading.Timer)]
    assert said.getvalue() == ""


def test_it_is_silent_where_warp_is(said, monkeypatch):
    levels = (wp.LOG_DEBUG, wp.LOG_INFO, wp.LOG_WARNING, wp.LOG_ERROR)
    wanted = []
    for level in levels:
        monkeypatch.setattr(wp.config, "log_level", level)
        wanted.append(progress.wanted())
    assert wanted == [True, True, True, False]
    monkeypatch.setattr(wp.config, "log_level", wp.LOG_WARNING)
    monkeypatch.setattr(wp.config, "quiet", True, raising=False)
    assert not progress.wanted()


@pytest.mark.parametrize("stderr", [None, "closed"])
def test_no_stderr_is_no_error(said, monkeypatch, stderr):
    other = io.StringIO() if stderr else None
    if other is not None:
        other.close()
    monkeypatch.setattr(progress.sys, "stderr", other)
    line = progress._Line("this and that")
    line.begin()
    line.end("")
    assert line.begun and line.ended and line.timer.finished.is_set()


def test_threads_write_whole_lines(said, monkeypatch):
    """One thread compiles at a time, others wait for it: `factories.building`."""
    load = cache._load

    def slowly(module, device):
        begun(said)
        return load(module, device)

    monkeypatch.setattr(cache, "_load", slowly)
    kernels = [make_residual_kernel(wp.float64, name) for name in ("min", "fischer-burmeister")]
    device = wp.get_device("cpu")
    for kernel in kernels:
        cache._loaded.get(device.alias, set()).discard(kernel)
    with progress.recorded() as loads:
        threads = [threading.Thread(target=cache.load, args=(kernel, device)) for kernel in 2 * kernels]
        [t.start() for t in threads], [t.join() for t in threads]
    lines = said.getvalue().splitlines(keepends=True)
    assert len(lines) == len(loads) == 2
    for name in ("min", "fischer-burmeister"):
        pattern = rf"slcp-warp: compiling residual \(float64, {name}\) for cpu \.\.\. \d+\.\d s\n"
        assert sum(re.fullmatch(pattern, line) is not None for line in lines) == 1


def test_a_record_tells_what_was_compiled(tmp_path, monkeypatch):
    kernel = make_residual_kernel(wp.float64, "min")
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    compiled = []
    for _ in range(2):
        kernel.module.unload()
        cache._loaded.clear()
        with progress.recorded() as loads:
            found = slcp.residual("min", [1.0, 5.0], [2.0, 3.0])
            np.testing.assert_array_equal(found, [1.0, 3.0])
            slcp.residual("min", 1.0, 2.0)
        assert [load.kernel for load in loads] == ["residual (float64, min)"]
        assert loads[0].device == wp.get_preferred_device().alias and loads[0].seconds > 0.0
        compiled.append(loads[0].compiled)
    slcp.residual("min", 1.0, 2.0)
    assert compiled == [True, False] and len(loads) == 1


def test_records_within_records_are_their_own():
    loaded = progress.Loaded("step", "cpu", 1.0, True)
    with progress.recorded() as outer:
        with progress.recorded() as inner:
            pass  # both are empty, and equal
        progress.record(loaded)
    progress.record(loaded)
    assert outer == [loaded] and inner == []


def test_kernels_in_words():
    scene = slcp.scenes.particle()
    slcp.Simulator(scene, device="cpu")
    method = Method("hard", friction="coulomb", integrator="trapezoidal")
    spec = Specialisation(scene.structure, wp.float32, method)
    kernel = rollout.make_rollout_kernel(spec, OPEN_LOOP, False)
    words = "rollout of particle (float32, hard, Coulomb's friction, trapezoidal, open loop)"
    assert progress.describe(kernel) == words
