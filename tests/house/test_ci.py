"""The long checks: every section of .ci/full is told of, and what is left out elsewhere runs in one."""

import csv
import re
from types import SimpleNamespace

import pytest
from compiled import Compiled
from plan import ROOT

from slcp_warp.kernels.device.progress import Loaded, record

FULL = (ROOT / ".ci/full").read_text()
TOLD = (ROOT / "docs/understand/testing.md").read_text()


def sections() -> list[str]:
    """The sections that run without a name, in order."""
    return re.search(r"sections=\(([a-z ]+)\); fi", FULL)[1].split()


def test_every_section_can_be_named_and_is_told_of():
    assert re.search(r"^    ([a-z |]+)\) ;;$", FULL, re.MULTILINE)[1].split(" | ") == sections()
    assert re.findall(r"^#   ([a-z]+)  ", FULL, re.MULTILINE) == sections()
    assert re.findall(r"^\| `([a-z]+)` \| ", TOLD.split("## Bounds")[0], re.MULTILINE) == sections()
    assert all(f"\n{name}() {{\n" in FULL for name in sections())


def test_files_that_the_sections_use_are_there():
    for path in re.findall(r"(?:bash|python\"?) (scripts/[\w./]+)", FULL):
        assert (ROOT / path).is_file(), path


@pytest.mark.full
def test_tests_marked_full_run_when_they_are_asked_for(pytestconfig):
    """In the section "long" alone: elsewhere `conftest.py` leaves it out, and it would fail."""
    assert pytestconfig.getoption("--full")


def test_tests_marked_full_are_left_out(pytestconfig, request):
    found = {item.name for item in request.session.items if item.get_closest_marker("full")}
    assert pytestconfig.getoption("--full") or not found


def test_tests_are_collected_without_pytorch_and_jax():
    """As section `pythons` has none: a file that imports one at its head would end the run."""
    head = re.compile(r"^(?:import|from) (?:torch|jax)\b", re.MULTILINE)
    files = sorted((ROOT / "tests").rglob("*.py"))
    assert [path.name for path in files if head.search(path.read_text(encoding="utf-8"))] == []


def test_files_that_come_first_are_there(pytestconfig):
    conftest = pytestconfig.pluginmanager.getplugin(str(ROOT / "tests/conftest.py"))
    there = {path.stem for path in (ROOT / "tests").rglob("test_*.py")}
    first = [*conftest.OPTIMISED, *conftest.LONGEST]
    assert len(set(first)) == len(first)
    assert {*first, *conftest.AFTER, *conftest.AFTER.values()} <= there
    assert {name.removesuffix(".py") for name in conftest.QUICK} <= there


def test_what_tests_compile_is_listed(tmp_path, monkeypatch):
    """Kernels from the cache are not; the files that compile the longest come first."""
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    plugin = Compiled(str(tmp_path / "compiled.csv"))
    for test, kernels in (("a.py::x", [(2.0, True), (9.0, False)]), ("b.py::y", [(1.5, True), (1.5, True)])):
        running = plugin.pytest_runtest_protocol(SimpleNamespace(nodeid=test))
        next(running)
        for seconds, compiled in kernels:
            record(Loaded("step of a scene", "cpu", seconds, compiled))
        with pytest.raises(StopIteration):
            running.send(True)
    plugin.pytest_sessionfinish()
    assert plugin.by_file() == [("b.py", 2, 3.0), ("a.py", 1, 2.0)]
    with (tmp_path / "compiled.csv").open(newline="") as file:
        assert [row["seconds"] for row in csv.DictReader(file)] == ["2.0", "1.5", "1.5"]
