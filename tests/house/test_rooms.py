"""The rooms inside each layer: their order, no circles, nothing imported behind a function."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from plan import FILES, LAYERS, ROOMS, ROOT, circles, floors, graph, imports, package_of, room_graph, room_of

OPTIONAL = {  # the libraries of pyproject.toml's extras, by the names that they are imported by
    *(
        "IPython",
        "PIL",
        "dask",
        "distributed",
        "filelock",
        "gymnasium",
        "jax",
        "matplotlib",
        "mujoco",
        "mujoco_warp",
    ),
    *("psutil", "pyarrow", "pydrake", "rich", "scipy", "submitit", "torch", "typer"),
    "websockets",
}


def upward(arrows: dict[str, set[str]], order: tuple[str, ...]) -> list[str]:
    """The arrows that lead to a room named after the one that they come from, and rooms without a place."""
    place = {room: i for i, room in enumerate(order)}
    wrong = [f"{room} has no place in the order" for room in arrows.keys() - place.keys()]
    wrong += [
        f"{room} imports {other}"
        for room, others in arrows.items()
        for other in others
        if place.get(other, -1) > place.get(room, len(order))
    ]
    return sorted(wrong)


@pytest.mark.parametrize("layer", ROOMS)
def test_no_room_imports_one_above_it(layer):
    arrows = room_graph(layer)
    assert upward(arrows, ROOMS[layer]) == []
    assert sorted(set(ROOMS[layer]) - arrows.keys()) == [], "rooms of the order that are not in the tree"


def test_the_rule_of_the_order_itself():
    order = ("ground", "middle", "top")
    assert upward({"ground": set(), "middle": {"ground"}, "top": {"ground", "middle"}}, order) == []
    assert upward({"ground": {"top"}, "middle": {"ground", "top"}}, order) == [
        "ground imports top",
        "middle imports top",
    ]
    assert upward({"cellar": {"top"}}, order) == ["cellar has no place in the order"]


def test_a_file_belongs_to_one_room():
    for path, room in (
        ("kernels/structure.py", FILES),
        ("kernels/solvers/newton.py", "solvers"),
        ("kernels/__init__.py", ""),
        ("slcp_warp/options.py", "options"),
        ("slcp_warp/torch/__init__.py", "torch"),
        ("scripts/benchmarks/fuzz/run.py", "benchmarks"),
    ):
        assert room_of(ROOT / path) == room


def test_there_are_no_circles_between_files():
    assert [[str(path.relative_to(ROOT)) for path in loop] for loop in circles(graph(*LAYERS))] == []


@pytest.mark.parametrize("layer", LAYERS)
def test_there_are_no_circles_between_rooms(layer):
    assert circles(room_graph(layer)) == []


def test_circles_are_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [["a", "b", "c"]]
    assert circles({"a": {"b"}, "b": {"a"}, "c": {"d"}, "d": {"c"}}) == [["a", "b"], ["c", "d"]]
    assert floors({"a": set(), "b": {"a"}, "c": {"a", "b"}, "d": {"e"}, "e": {"d"}}) == [["a"], ["b"], ["c"]]


def test_imports_are_found_wherever_they_stand():
    source = "import math\nfrom . import a\ndef f():\n    if x:\n        from ..b import c as d\n"
    found = [tuple(item) for item in imports(source, "slcp_warp.ddp.library")]
    assert found == [
        ("math", "", 1, False),
        ("slcp_warp.ddp.library", "a", 2, False),
        ("slcp_warp.ddp.b", "c", 5, True),
    ]


def optional(modules) -> bool:
    return any(module.split(".")[0] in OPTIONAL for module in modules)


def needing_an_option() -> set[Path]:
    """The files of ours that cannot be imported without an optional library, over others too."""
    found = {
        path
        for path in graph(*LAYERS)
        if optional(item.module for item in imports(path.read_text(), package_of(path)) if not item.inside)
    }
    while True:
        more = {
            path
            for path, targets in graph(*LAYERS).items()
            if any(target in found and not all(i.inside for i in items) for target, items in targets.items())
        }
        if more <= found:
            return found
        found |= more


def hidden(path: Path, needing: set[Path]) -> list[str]:
    """Imports inside functions, of anything but optional libraries and files that need one."""
    wrong = [
        f"line {item.line}: {target.relative_to(ROOT)}"
        for target, items in graph(*LAYERS)[path].items()
        for item in items
        if item.inside and target not in needing
    ]
    outside = [item for item in imports(path.read_text(), package_of(path)) if item.inside]
    return wrong + [
        f"line {item.line}: {item.module}"
        for item in outside
        if item.module.split(".")[0] != "slcp_warp" and not optional([item.module])
    ]


def test_nothing_is_imported_behind_a_function():
    needing = needing_an_option()
    found = {str(path.relative_to(ROOT)): hidden(path, needing) for path in graph(*LAYERS)}
    assert {path: lines for path, lines in found.items() if lines} == {}


def test_the_plan_can_be_printed():
    program = [sys.executable, str(ROOT / "tests/support/plan.py"), "--folder", "kernels"]
    said = subprocess.run(program, capture_output=True, text=True, check=True).stdout
    levels = floors(room_graph("kernels"))
    assert f" {len(levels)} floors, 0 circles" in said.splitlines()[0]
    assert all(", ".join(level) in said for level in levels)


def test_the_kernels_stay_a_house_with_few_rooms():
    """Before they had rooms, 80 files stood on 19 floors with 394 arrows: docs/understand/house.md."""
    arrows = room_graph("kernels")
    assert len(arrows) <= 16
    assert sum(map(len, arrows.values())) <= 60
    assert len(floors(arrows)) <= 9


@pytest.mark.parametrize("layer", LAYERS)
def test_the_page_of_the_house_says_what_it_is_like(layer):
    """Within a tenth, so that not every import changes the page."""
    page = (ROOT / "docs/understand/house.md").read_text()
    told = [int(n) for n in re.search(rf"^\| `{layer}/` now \| (.*) \|$", page, re.MULTILINE)[1].split(" | ")]
    arrows = room_graph(layer)
    files = [path for path in graph(layer) if room_of(path)]
    here = [len(files), len(arrows), sum(map(len, arrows.values())), len(floors(arrows)), 0]
    assert all(abs(a - b) <= max(1, 0.1 * b) for a, b in zip(told, here, strict=True)), (told, here)
