"""`slcp gpu-check` without a GPU: all sections that a CPU has, and what becomes of those that fail."""

import contextlib
import json
import multiprocessing
import os
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from typer.testing import CliRunner

import slcp_warp as slcp
from slcp_warp.kernels.device import cache
from slcp_warp.scripts.app import app
from slcp_warp.scripts.benchmarks.gpu import run as running
from slcp_warp.scripts.benchmarks.gpu import sections
from slcp_warp.scripts.benchmarks.gpu.against import compare
from slcp_warp.scripts.benchmarks.gpu.checks import (
    compiling,
    crowds,
    graphs,
    isolation,
    product,
    rates,
    states,
    sweeping,
)
from slcp_warp.scripts.benchmarks.gpu.page import write_page
from slcp_warp.scripts.benchmarks.gpu.processes import side_by_side
from slcp_warp.scripts.benchmarks.gpu.product import PRODUCT, Use
from slcp_warp.scripts.benchmarks.gpu.record import DONE, FAILED, LEFT_OUT, Found, Record, read, wrong
from slcp_warp.scripts.benchmarks.gpu.sections import SECTIONS, Section
from slcp_warp.scripts.benchmarks.gpu.setting import SMALL, Setting
from slcp_warp.scripts.benchmarks.gpu.uses import plan

SETTING = Setting("cpu", replace(SMALL, dtypes=("float64",), methods=("smoothed",)))
ON_A_GPU = ("blocks",)


def quiet(_):
    """Nothing is said."""


def fall(setting, found):
    """A section that finds something and falls."""
    found.row("before", rate=1.0)
    raise ArithmeticError("on purpose")


def die(setting, found):
    """A section whose process dies."""
    found.check("before", True)
    os._exit(3)


def hang(setting, found):
    """A section that never ends."""
    found.note("before")
    time.sleep(1000.0)


def stand(setting, found):
    """A section that is right."""
    found.check("stands", True)


def wrong_one(setting, found):
    """A section that finds something wrong."""
    found.at_most("too much", 2.0, 1.0)


def part_of(setting, found, part):
    """A part of a section, which one of them falls in."""
    if part == "bad":
        raise ArithmeticError("on purpose")
    found.row(part, process=os.getpid(), device=setting.device)
    found.check(f"{part} is done", True)


def found_by(work, setting=SETTING):
    """The events of a section."""
    events = []
    work(setting, Found(events.append))
    return events


def checks(events):
    return {e["what"]: e["right"] for e in events if e["kind"] == "checks"}


@pytest.mark.slow
def test_every_section_that_a_cpu_has_is_right_there(tmp_path, monkeypatch):
    monkeypatch.setattr(sweeping, "library", lambda setting: plan(setting, "float64"))  # compiles for long
    monkeypatch.setattr(product, "PRODUCT", {"particles": PRODUCT["particles"]})  # the others are below
    monkeypatch.setattr(crowds, "LAWS", {"hard": crowds.LAWS["hard"]})
    names = [name for name in SECTIONS if name != "kernels"]
    record = Record(tmp_path / "gpu.json", "cpu", names)
    running.run(record, SETTING, names, 600.0, quiet, apart=False)
    content = read(tmp_path / "gpu.json")
    assert wrong(content) == []
    for name, section in content["sections"].items():
        assert section["status"] == (LEFT_OUT if name in ON_A_GPU else DONE), (name, section.get("traceback"))
        assert section["checks"] or section["rows"] or section["notes"] or name in ON_A_GPU
    for name in ("rates", "planning", "sweep"):
        assert all(row["rate"] > 0.0 for row in content["sections"][name]["rows"])
    write_page(tmp_path / "gpu.md", content, compare(content, content))
    page = (tmp_path / "gpu.md").read_text()
    assert "Nothing is wrong." in page and all(f"## {name}\n" in page for name in names)


FEW = ("replay, specialised kernels", "environment, specialised kernels", "map", "sensitivity")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [*FEW, *(pytest.param(n, marks=pytest.mark.full) for n in PRODUCT if n not in FEW)]
)
def test_what_people_run_is_the_same_twice(monkeypatch, name):
    """On a CPU, both times: every number, of worlds that act."""
    monkeypatch.setattr(product, "PRODUCT", {name: PRODUCT[name]})
    found = checks(found_by(product.run))
    assert found and all(found.values())
    numbers = PRODUCT[name].run("cpu")
    a_number = all(a.size == 1 for a in numbers.values())
    assert all(np.isfinite(a).any() for a in numbers.values())
    assert max(np.ptp(a[np.isfinite(a)]) for a in numbers.values()) > 0.0 or a_number


def test_a_product_that_differs_is_found(monkeypatch):
    """Numbers that are further away in more worlds than may be, and what falls on one device."""
    here = []

    def other(device):
        here.append(device)
        return {"x": np.where(np.arange(100) < 5 * len(here), 1.0, 0.0), "same": np.array([np.nan, np.inf])}

    def falls(device):
        raise ArithmeticError("on purpose")

    uses = {
        "moved": Use(other, 0.1, 0.04),
        "falls": Use(falls),
        "not there": Use(falls, needs="no_such_module"),
    }
    monkeypatch.setattr(product, "PRODUCT", uses)
    found = found_by(product.run)
    assert checks(found) == {
        "moved: x further than 0.1 from the CPU's": False,
        "moved: same further than 0.1 from the CPU's": True,
        "falls, cpu: it runs": False,
    }
    assert [e["text"] for e in found if e["kind"] == "notes"] == [
        "not there: no_such_module is not installed"
    ]


def test_kernels_are_compiled_by_processes(monkeypatch):
    monkeypatch.setattr(compiling, "uses_of", lambda setting: dict.fromkeys(("step smoothed", "no use")))
    found = found_by(compiling.run)
    assert checks(found) == {"no use, float64, cpu: compiled": False}
    cases = [event["case"] for event in found if event["kind"] == "rows"]
    assert any("step of flicking_finger" in case for case in cases) and cases[-1] == "all of them"


def test_kernels_are_compiled_for_a_gpu_elsewhere(monkeypatch):
    """Of the kind that is named, while a use runs on the CPU."""
    asked = []

    @contextlib.contextmanager
    def elsewhere(arch):
        asked.append(arch)
        yield
        asked.append("until then")

    monkeypatch.setattr(cache, "compiling_for", elsewhere)
    monkeypatch.setattr(compiling, "uses_of", lambda setting: {"use": lambda *_: asked.append("use")})
    compiling.compile_use("use", "float32", replace(SETTING, arch=90))
    assert asked == [90, "use", "until then"]
    compiling.compile_use("use", "float32", SETTING)
    assert asked[3:] == ["use"]


def test_code_that_takes_more_than_predicted_is_found(monkeypatch):
    """What a GPU says of its kernels is made up."""
    loaded, used = [], {"register_count": 100, "local_memory_size": 320}
    monkeypatch.setattr(cache, "load", lambda kernel, device: loaded.append(kernel))
    monkeypatch.setattr(wp, "get_cuda_kernel_properties", lambda kernel, device, block: used)
    gpu = SimpleNamespace(is_cpu=False, arch=90)
    found = checks(found_by(lambda _, found: compiling.predicted(gpu, found)))
    bad = {what for what, right in found.items() if not right}
    more = {
        f"{name}: bytes of local memory" for name in ("rollout", "hard rollout", "linearisation", "library")
    }
    assert bad == {"library: registers", *more} and len(loaded) == len(found) / 2
    gpu.arch = 100  # of another GPU it is said, and not judged
    events = found_by(lambda _, found: compiling.predicted(gpu, found))
    assert not checks(events) and len(events) == len(loaded) / 2
    row = compiling._code(loaded[0], gpu)
    assert row["part"] == "fast" and row["register_count"] == 100


def test_blocks_are_put_back_after_they_were_tried(monkeypatch):
    monkeypatch.setattr(rates, "SINGLE", "float64")
    tried, load = [], cache.load_all
    monkeypatch.setattr(cache, "load_all", lambda *given: tried.append(cache.BLOCK) or load(*given))
    before = cache.BLOCK
    setting = Setting("cpu", replace(SETTING.sizes, blocks=(before, 2 * before), worlds=(4,)))
    rows = [event for event in found_by(rates.blocks, setting) if event["kind"] == "rows"]
    assert [(row["block"], row["own"]) for row in rows] == [(before, True), (2 * before, False)]
    assert cache.BLOCK == before and set(tried) == {before, 2 * before}


@pytest.mark.slow
def test_a_section_that_fails_dies_or_hangs_stops_no_other(tmp_path, monkeypatch):
    parts = {"fall": fall, "die": die, "hang": hang, "stand": stand}
    for name, work in parts.items():
        monkeypatch.setitem(SECTIONS, name, Section(work, 20.0 if work is hang else 60.0))
    record = Record(tmp_path / "gpu.json", "cpu", list(parts))
    running.run(record, SETTING, list(parts), 600.0, quiet)
    found = read(tmp_path / "gpu.json")["sections"]
    assert [found[name]["status"] for name in parts] == [FAILED, FAILED, FAILED, DONE]
    assert found["fall"]["error"] == "ArithmeticError: on purpose" and found["fall"]["rows"]
    assert "raise ArithmeticError" in found["fall"]["traceback"]
    assert found["die"]["error"] == "its process ended with code 3" and found["die"]["checks"]
    assert found["hang"]["error"] == "it took more than 20 s" and found["hang"]["notes"] == ["before"]
    assert len(wrong(record.content)) == 3


@pytest.mark.slow
def test_a_section_that_ends_before_its_process_began_leaves_none(tmp_path, monkeypatch):
    monkeypatch.setitem(SECTIONS, "hang", Section(hang, 0.05))
    record = Record(tmp_path / "gpu.json", "cpu", ["hang"])
    running.run(record, SETTING, ["hang"], 600.0, quiet)
    found = read(tmp_path / "gpu.json")["sections"]["hang"]
    assert found["status"] == FAILED and found["error"] == "it took more than 0 s"
    assert multiprocessing.active_children() == []


def test_sections_for_which_no_time_is_left_are_left_out(tmp_path, monkeypatch):
    monkeypatch.setitem(SECTIONS, "stand", Section(stand, 10.0))
    record = Record(tmp_path / "gpu.json", "cpu", ["stand"])
    running.run(record, SETTING, ["stand"], 1.0, quiet, apart=False)
    section = record.section("stand")
    assert (section["status"], section["error"]) == (LEFT_OUT, "no time was left") and not wrong(
        record.content
    )


class Shifted:
    """A simulator whose states are off."""

    def __init__(self, sim, by):
        self._sim, self._by = sim, by

    def __getattr__(self, name):
        return getattr(self._sim, name)

    def step(self, *given, **named):
        done = self._sim.step(*given, **named)
        state = np.where(np.arange(done.state.shape[1]) == self._sim.nx - 1, self._by, 0.0) + done.state
        return replace(done, state=state)


def test_states_that_are_off_are_found(monkeypatch):
    """By the CPU's states, and by the oracle alone."""
    finger = Setting.finger

    def shifted(self, dtype, method="smoothed", device=None):
        sim = finger(self, dtype, method, "cpu")
        return sim if device == "reference" else Shifted(sim, 1e-6)

    monkeypatch.setattr(states, "CPU", "reference")
    monkeypatch.setattr(Setting, "finger", shifted)
    monkeypatch.setattr(Setting, "stack", lambda self, dtype, device=None: finger(self, dtype))
    found = checks(found_by(states.run))
    bad = [what for what, right in found.items() if not right]
    assert "legal states, smoothed, float64: states further than 1e-08 from the CPU's" in bad
    assert any("wrong without saying so" in what and "finger" in what for what in bad)


def test_neighbours_that_change_and_graphs_that_do_not_follow_are_found(monkeypatch):
    rollout = slcp.Simulator.rollout

    def leaking(self, x0, *given, **named):
        done = rollout(self, x0, *given, **named)
        if not isinstance(x0, np.ndarray):
            return done
        extra = 0.0 if np.isfinite(np.asarray(x0)).all() else 1e-12
        return replace(done, states=done.states + extra)

    with monkeypatch.context() as patch:
        patch.setattr(slcp.Simulator, "rollout", leaking)
        found = checks(found_by(isolation.run))
    assert not found["rollout, float64: the others have the same bits"]
    assert found["step, float64: the others have the same bits"]
    arrays = graphs.Arrays(SETTING, "float64")
    kept = wp.clone(arrays.step()[0])
    assert graphs.replayed(SETTING, arrays, lambda: [kept]) == (True, False)


def test_two_runs_are_compared_by_rates_and_checks(tmp_path):
    contents = []
    for right, rate in ((True, 100.0), (False, 80.0)):
        record = Record(tmp_path / "gpu.json", "cpu", ["rates"])
        record.add("rates", {"kind": "checks", "what": "holds", "right": right})
        record.add("rates", {"kind": "rows", "case": "many", "rate": rate, "seconds": 1.0})
        contents.append(read(tmp_path / "gpu.json"))
    found = compare(contents[1], contents[0])
    assert found["newly wrong"] == [{"section": "rates", "case": "holds"}] and not found["newly right"]
    assert [(row["case"], row["ratio"]) for row in found["rates"]] == [("many", 0.8)]
    assert compare(contents[0], contents[1])["newly right"]


def test_exit_codes(tmp_path, monkeypatch):
    def call(*words):
        return CliRunner().invoke(app, ["gpu-check", "--out", str(tmp_path / "gpu.json"), *words])

    monkeypatch.setattr(wp, "get_cuda_devices", lambda: [])
    done = call()
    assert done.exit_code == 2 and len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert "no GPU here" in done.stderr and not (tmp_path / "gpu.json").exists()
    for words in (
        ("--only", "nonsense"),
        ("--device", "cuda:77"),
        ("--against", str(tmp_path / "none.json")),
    ):
        assert call(*words, "--no-apart").exit_code == 2
    for name, work in (("stand", stand), ("wrong", wrong_one)):
        monkeypatch.setitem(sections.SECTIONS, name, Section(work, 60.0))
    small = ("--device", "cpu", "--no-apart", "--only")
    assert call(*small, "stand").exit_code == 0
    assert json.loads((tmp_path / "gpu.json").read_text())["sections"]["stand"]["status"] == DONE

    def stopped(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("slcp_warp.scripts.benchmarks.gpu.command.run", stopped)
        done = call(*small, "stand")
        assert done.exit_code == 130 and "what was found until then is in" in done.stderr
    assert call(*small, "stand").exit_code == 0
    done = call(*small, "stand,wrong", "--against", str(tmp_path / "gpu.json"))
    assert done.exit_code == 1 and "wrong: too much" in done.stdout
    assert "| too much | **no** | 2 | 1 |" in (tmp_path / "gpu.md").read_text()


@pytest.mark.parametrize("workers", [None, 2])
def test_parts_of_a_section_in_processes_of_their_own_or_in_this_one(workers):
    def section(parts):
        return lambda setting, found: side_by_side(part_of, setting, found, parts, workers)

    events = found_by(section(["a", "b", "c"]))
    rows = [e for e in events if e["kind"] == "rows"]
    assert sorted(e["case"] for e in rows) == ["a", "b", "c"] and {e["device"] for e in rows} == {"cpu"}
    assert all((e["process"] == os.getpid()) == (workers is None) for e in rows)
    assert checks(events) == {f"{part} is done": True for part in "abc"}
    assert [e["kind"] for e in events] == ["rows", "checks"] * 3  # a part's together
    with pytest.raises(ArithmeticError, match="on purpose"):
        found_by(section(["a", "bad"]))
