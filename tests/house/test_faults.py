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
        ({"tests": ()}, "either tests or equivalent"),
        ({}, "there is no x"),
    ):
        assert words in faults.Fault(**{**good, **change}).problem()
