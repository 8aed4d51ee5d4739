"""Files of Python that tasks and policies are named in: they see the modules beside them."""

import sys

import pytest

import slcp_warp as slcp
from slcp_warp.storage import python

TASK = "import slcp_warp as slcp\nfrom {helper} import NAME\ntask = slcp.tasks.catch().replace(name=NAME)\n"
POLICY = "def make():\n    import {helper}\n    return {helper}.policy()\n"
MAKES = """import slcp_warp
def policy():
    return slcp_warp.policies.Linear([[0.0] * 10] * 2, [0.0] * 10, [0.0] * 2)
"""


@pytest.fixture(autouse=True)
def as_before(monkeypatch):
    """What is imported and where modules are found, as it was."""
    modules = dict(sys.modules)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(python, "_folders", [])
    yield
    for name in sys.modules.keys() - modules.keys():
        del sys.modules[name]


def put(folder, helper, name, more=""):
    folder.mkdir(exist_ok=True)
    (folder / f"{helper}.py").write_text(f"NAME = {name!r}\n{more}")
    file = folder / "mine.py"
    file.write_text(TASK.format(helper=helper) + POLICY.format(helper=helper))
    return file


def test_a_file_imports_what_lies_beside_it_and_when_it_is_asked(tmp_path):
    before = list(sys.path)
    file = put(tmp_path / "a", "own_helper", "mine", MAKES)
    assert slcp.load_task(f"{file}:task").name == "mine"
    assert slcp.policies.load_policy(f"{file}:make").K.shape == (1, 2, 10)
    assert sys.path == [*before, str(tmp_path / "a")]  # behind what is installed
    other = put(tmp_path / "b", "own_other", "another")
    assert slcp.load_task(f"{other}:task").name == "another"
    assert slcp.load_task(f"{file}:task").name == "mine"
    assert sys.path == [*before, str(tmp_path / "a"), str(tmp_path / "b")]


def test_what_is_installed_is_not_replaced(tmp_path):
    file = put(tmp_path / "a", "own_helper", "mine")
    (tmp_path / "a" / "json.py").write_text("raise RuntimeError")
    (tmp_path / "a" / "slcp_warp.py").write_text("raise RuntimeError")
    assert slcp.load_task(f"{file}:task").name == "mine"


def test_two_modules_of_one_name_are_not_mixed_up(tmp_path):
    """The second would get the first one's, silently."""
    first, second = (put(tmp_path / name, "own_helper", name) for name in ("a", "b"))
    assert slcp.load_task(f"{first}:task").name == "a"
    with pytest.raises(
        slcp.InputError, match="imports 'own_helper', which was imported already from .*a/own_h"
    ):
        slcp.load_task(f"{second}:task")
    (tmp_path / "b" / "own_between.py").write_text("from own_helper import NAME\n")
    second.write_text(TASK.format(helper="own_between"))
    with pytest.raises(slcp.InputError, match="'own_helper', which was imported already"):
        slcp.load_task(f"{second}:task")
    assert slcp.load_task(f"{first}:task").name == "a"


def test_two_packages_of_one_name_are_not_mixed_up(tmp_path):
    """Nor a package and a module; what a package imports is beside the file, too."""
    first, second, third = (put(tmp_path / name, "own_helper", name) for name in ("a", "b", "c"))
    for name in ("a", "b"):
        package = tmp_path / name / "own_helper"
        package.mkdir()
        (tmp_path / name / "own_helper.py").rename(package / "__init__.py")
    assert slcp.load_task(f"{first}:task").name == "a"
    for other in (second, third):
        with pytest.raises(slcp.InputError, match="'own_helper', which was imported already from .*a/own_h"):
            slcp.load_task(f"{other}:task")
    assert slcp.load_task(f"{first}:task").name == "a"


IMPORTS = (
    "from own_tools.{0} import NAME",
    "from own_tools import {0}\nNAME = {0}.NAME",
    "import own_tools.{0}\nNAME = own_tools.{0}.NAME",
)


@pytest.mark.parametrize("how", IMPORTS)
def test_two_folders_of_one_name_are_not_mixed_up(tmp_path, how):
    """Without `__init__.py` both are one package to Python; the second file got the first one's module."""
    files = {}
    for name, module in (("a", "own_helper"), ("b", "own_helper"), ("c", "own_third")):
        files[name] = put(tmp_path / name, module, name)
        (tmp_path / name / "own_tools").mkdir()
        (tmp_path / name / f"{module}.py").rename(tmp_path / name / "own_tools" / f"{module}.py")
        files[name].write_text(TASK.replace("from {helper} import NAME", how.format(module)))
    assert slcp.load_task(f"{files['a']}:task").name == "a"
    assert slcp.load_task(f"{files['c']}:task").name == "c"  # another module of such a folder
    with pytest.raises(
        slcp.InputError, match="'own_tools.own_helper', which was imported already from .*a/own"
    ):
        slcp.load_task(f"{files['b']}:task")
