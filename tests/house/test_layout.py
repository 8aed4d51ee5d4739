"""The layers of the project: import order, one namespace, what is installed, one version."""

import importlib
import importlib.metadata
import importlib.util
import re
import sys
from pathlib import Path

import pytest
from plan import LAYERS, PACKAGES, ROOT, imports, source_files

import slcp_warp
import slcp_warp.kernels
from slcp_warp.scripts.support.checkout import ROOMS


def layer_of(module: str) -> str | None:
    """The layer that a dotted module name belongs to; None outside the project.

    A bare `kernels`, `ddp` or `scripts` counts as ours: it is the same code under a name that breaks others.
    """
    first, *rest = module.split(".")
    if first != "slcp_warp":
        return f"bare {first}" if first in PACKAGES else None
    return rest[0] if rest and rest[0] in PACKAGES else "slcp_warp"


def imported_modules(source: str, package: str) -> set[str]:
    """Absolute names of all modules that a source imports, at any depth; `package` resolves relative ones."""
    return {
        f"{module}.{name}"
        if module == "slcp_warp" and name
        else module  # `from slcp_warp import ddp` names a layer
        for module, name, *_ in imports(source, package)
    }


def forbidden_imports(source: str, layer: str, subpackage: str = "") -> list[str]:
    """The imports of a source in `layer` that the order of layers does not allow."""
    allowed = {None, *LAYERS[: LAYERS.index(layer) + 1]}
    modules = imported_modules(source, PACKAGES[layer] + subpackage)
    wrong = [module for module in modules if layer_of(module) not in allowed]
    if layer == "kernels":
        outside = {module for module in modules if layer_of(module) is None}
        wrong += [m for m in outside if m.split(".")[0] not in {"warp", *sys.stdlib_module_names}]
    return sorted(wrong)


@pytest.mark.parametrize("path", source_files(*LAYERS), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_go_one_way(path: Path):
    layer, *below = path.relative_to(ROOT).parent.parts
    assert forbidden_imports(path.read_text(), layer, "".join(f".{name}" for name in below)) == []


@pytest.mark.parametrize(
    ("layer", "source", "wrong"),
    [
        ("kernels", "import math, warp\nfrom slcp_warp.kernels.step import f\nfrom . import g", []),
        ("kernels", "import numpy as np", ["numpy"]),
        ("kernels", "from slcp_warp import kernels, scene", ["slcp_warp.scene"]),
        ("kernels", "from .. import ddp", ["slcp_warp.ddp"]),
        ("kernels", "import slcp_warp", ["slcp_warp"]),
        ("slcp_warp", "import numpy\nfrom . import kernels\nfrom .kernels.step import f", []),
        ("slcp_warp", "def f():\n    from slcp_warp.ddp import solve", ["slcp_warp.ddp"]),
        ("slcp_warp", "import kernels.step", ["kernels.step"]),
        ("ddp", "import slcp_warp as slcp\nfrom ..kernels import step", []),
        ("ddp", "from ..scripts.main import main", ["slcp_warp.scripts.main"]),
        ("scripts", "from slcp_warp import ddp, kernels\nimport typer", []),
        ("scripts", "from scripts import app\nimport ddp", ["ddp", "scripts"]),
    ],
)
def test_the_rule_itself(layer: str, source: str, wrong: list[str]):
    assert forbidden_imports(source, layer) == wrong


def test_tests_import_no_bare_folder():
    for path in source_files("tests"):
        bare = [m for m in imported_modules(path.read_text(), "") if str(layer_of(m)).startswith("bare")]
        assert bare == [], f"{path.relative_to(ROOT)} imports {bare}"


def test_test_files_have_names_of_their_own():
    """They are imported by their bare names: of two alike pytest takes the first, and stops at the second."""
    names = [path.name for path in source_files("tests")]
    assert sorted({name for name in names if names.count(name) > 1}) == []


def test_kernels_come_from_the_one_namespace():
    """Installed, all packages lie below slcp_warp; in an editable install each is its own folder."""
    home = Path(slcp_warp.__file__).resolve().parent
    editable = home == ROOT / "slcp_warp"
    for folder, name in PACKAGES.items():
        module = importlib.import_module(name)
        inside = home if folder == "slcp_warp" else home / folder
        assert Path(module.__file__).resolve().parent == (ROOT / folder if editable else inside)


@pytest.mark.parametrize("name", ["kernels", "ddp", "scripts"])
def test_the_folders_are_not_importable_by_their_bare_names(name: str):
    """A top-level `kernels` would hide another project's; one that is no part of this tree does no harm."""
    spec = importlib.util.find_spec(name)
    places = [] if spec is None else [spec.origin or "", *(spec.submodule_search_locations or [])]
    assert [place for place in places if place and Path(place).resolve().is_relative_to(ROOT / name)] == []


@pytest.mark.parametrize("folder", LAYERS)
def test_the_installed_package_is_this_tree(folder: str):
    """Nothing was left out of the wheel (a new subfolder, say), nothing stale is in it."""
    home = Path(importlib.import_module(PACKAGES[folder]).__file__).parent
    here = {path.relative_to(ROOT / folder): path.read_bytes() for path in source_files(folder)}
    there = {path.relative_to(home): path.read_bytes() for path in home.rglob("*.py")}
    if folder == "scripts" and home != ROOT / folder:  # a wheel leaves ROOMS out
        here = {path: text for path, text in here.items() if path.parts[0] not in ROOMS}
    if folder == "slcp_warp":  # installed, the other packages lie below it
        there = {path: text for path, text in there.items() if path.parts[0] not in PACKAGES}
    assert here.keys() == there.keys()
    assert [str(path) for path in here if here[path] != there[path]] == []


def test_the_package_is_marked_as_typed():
    assert (Path(slcp_warp.__file__).parent / "py.typed").is_file()


def test_one_version():
    declared = re.search(r'^version = "([^"]+)"', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert declared is not None
    assert declared[1] == slcp_warp.__version__ == importlib.metadata.version("slcp-warp")
