"""The faults of tests/faults: each still fits one place of the sources, and names tests that there are."""

import importlib.util
from collections import Counter

import pytest
from plan import LAYERS, ROOT

spec = importlib.util.spec_from_file_location("faults_script", ROOT / "scripts" / "faults.py")
faults = importlib.util.module_from_spec(spec)
spec.loader.exec_module(faults)
FAULTS = faults.read_faults()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_fits_one_place_and_names_its_tests(fault):
    assert fault.problem() == ""
    for test in fault.tests:
        path, _, name = test.partition("::")
        assert not name or f"def {name.split('[')[0]}(" in (ROOT / path).read_text(encoding="utf-8"), test


def test_there_are_faults_in_every_folder():
    folders = Counter(fault.file.split("/")[0] for fault in FAULTS if not fault.equivalent)
    assert sum(folders.values()) >= 60 and set(folders) == set(LAYERS)
    assert min(folders.values()) >= 8
    generic = [fault for fault in FAULTS if fault.file.startswith("kernels/generic/")]
    assert len(generic) >= 10


def test_a_fault_that_fits_no_more_is_named():
    good = {
        "name": "a",
        "file": "kernels/contact/rows.py",
        "find": "def scale(minv",
        "replace": "def s(",
        "tests": ("x",),
    }
    for change, words in (
        ({"file": "kernels/nowhere.py"}, "no kernels/nowhere.py"),
        ({"find": "text that nobody wrote"}, "0 times"),
        ({"find": "wp.static"}, "times; once is needed"),
        ({"replace": good["find"]}, "changes nothing"),
        ({"also": (("kernels/contact/rows.py", "text that nobody wrote", "x"),)}, "0 times"),
        ({"tests": ()}, "either tests or equivalent"),
        ({}, "there is no x"),
    ):
        assert words in faults.Fault(**{**good, **change}).problem()


def test_all_places_of_a_fault_change_and_are_put_back(tmp_path):
    for name in ("a.py", "b.py"):
        (tmp_path / name).write_text(f"one\ntwo {name}\n")
    places = (("a.py", "two", "three"), ("b.py", "one", "none"))
    before = faults.Fault("x", "a.py", "one", "1", ("t",), also=places).put_in(tmp_path)
    assert (tmp_path / "a.py").read_text() == "1\nthree a.py\n"
    assert (tmp_path / "b.py").read_text() == "none\ntwo b.py\n"
    assert before == {tmp_path / name: f"one\ntwo {name}\n".encode() for name in ("a.py", "b.py")}
