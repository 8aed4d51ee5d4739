"""docs/understand/step.md leads from a scene to a step and a rollout in at most five files of the code."""

import ast
import re

import pytest
from test_layout import PACKAGES, ROOT, imported_modules

PAGE = (ROOT / "docs" / "understand" / "step.md").read_text(encoding="utf-8")
PATH = [
    (file, re.findall(r"`([\w.]+)`", names))
    for file, names in re.findall(r"^\| \d \| `([\w/]+\.py)` \| ([^|]+) \|", PAGE, re.MULTILINE)
]
STAGES = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)


def tree(file):
    return ast.parse((ROOT / file).read_text(encoding="utf-8"))


def module(file):
    """The dotted name of a file in the package."""
    folder, _, rest = file.removesuffix(".py").partition("/")
    return f"{PACKAGES[folder]}.{rest.replace('/', '.')}"


def defined(file):
    """Functions and classes of a file, methods with their class before them."""
    names = set()
    for node in tree(file).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names.add(node.name)
            names |= {
                f"{node.name}.{child.name}" for child in node.body if isinstance(child, ast.FunctionDef)
            }
    return names


def test_the_path_has_at_most_five_files():
    assert 3 <= len(PATH) <= 5
    assert PATH[0][1] == ["Scene"]
    assert "Simulator.rollout" in PATH[1][1]
    assert PATH[-1][1] == ["make_step"]


@pytest.mark.parametrize(("file", "names"), PATH, ids=[file for file, _ in PATH])
def test_a_file_of_the_path_defines_what_is_to_be_read(file, names):
    assert names and set(names) <= defined(file)


@pytest.mark.parametrize(("user", "used"), [(PATH[1], PATH[0]), *zip(PATH[1:], PATH[2:])])
def test_each_file_of_the_path_imports_the_next(user, used):
    """The simulator imports the scene, too: it begins there."""
    package = module(user[0]).rpartition(".")[0]
    source = (ROOT / user[0]).read_text(encoding="utf-8")
    imports = imported_modules(source, package)
    froms = [n for n in ast.walk(tree(user[0])) if isinstance(n, ast.ImportFrom)]
    home, _, name = module(used[0]).rpartition(".")
    by_name = any(alias.name == name for node in froms for alias in node.names) and home in imports
    assert module(used[0]) in imports or by_name, f"{user[0]} does not import {used[0]}"


def test_the_stages_are_those_of_the_step_in_its_order():
    (maker,) = (n for n in tree(PATH[-1][0]).body if getattr(n, "name", "") == "make_step")
    (step,) = (n for n in ast.walk(maker) if isinstance(n, ast.FunctionDef) and n.name == "solve_step")
    said = ast.unparse(step)
    places = [re.search(rf"\b{stage}\b[^=]*\(|\b{stage} =", said) for stage in STAGES]
    assert len(STAGES) >= 6
    assert None not in places, [stage for stage, place in zip(STAGES, places) if place is None]
    starts = [place.start() for place in places]
    assert starts == sorted(starts)
