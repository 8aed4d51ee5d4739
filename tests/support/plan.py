"""The plan of the house, read from the imports: rooms, arrows between them, floors, circles.

    python tests/support/plan.py [--folder kernels] [--tree PATH] [--arrows]

A room is a subfolder with all below it, or a file beside the subfolders; of the kernels these files are one
room. An arrow leads from a room to one that it imports, inside a function too. Rooms that import nothing here
are the ground floor; every other stands on the floor above the highest that it imports. `--tree` reads
another checkout, of a version before, say; `--arrows` prints what each room imports.
"""

import argparse
import ast
import functools
import importlib.util
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {  # folder in the tree -> import name
    "kernels": "slcp_warp.kernels",
    "slcp_warp": "slcp_warp",
    "ddp": "slcp_warp.ddp",
    "scripts": "slcp_warp.scripts",
}
LAYERS = list(PACKAGES)  # from the ground up: a layer imports itself and those before it
FILES = "(files)"
ROOMS = {  # the order of each layer's rooms: none imports one that is named after it
    "kernels": (
        FILES,  # those beside the folders: what all of them speak of
        *("device", "mechanism", "residual", "contact", "solvers", "policies", "step", "generic", "plain"),
        *("derivatives", "gradients", "control", "ensembles"),
    ),
    "slcp_warp": (
        *(
            "inputs",
            "storage",
            "runs",
            "options",
            "description",
            "scenes",
            "parameters",
            "measures",
            "results",
        ),
        *(
            "costs",
            "gradients",
            "stepping",
            "simulator",
            "policies",
            "torch",
            "jax",
            "tasks",
            "ensembles",
        ),
    ),
    "ddp": (
        *("options", "costs", "dynamics", "problem", "identity", "results"),
        *("policies", "batches", "parts", "workspace", "sampling"),
        *("continuation", "solver", "library", "multistart", "planning", "robust", "mpc"),
    ),
    "scripts": (
        *("support", "stages", "charts", "paper", "watch", "benchmarks", "commands", "studies"),
        FILES,  # the table of commands
    ),
    "scripts/benchmarks": (
        *("mechanics", "shared", "exact", "peers", "cost", "contacts", "derivatives", "accuracy"),
        *("stability", "fuzz", "gpu"),
        FILES,
    ),
}


class Import(NamedTuple):
    """One import of a source: the absolute name, what is taken from it ("" for a module), where it stands."""

    module: str
    name: str
    line: int
    inside: bool  # a function


def source_files(*folders: str, root: Path = ROOT) -> list[Path]:
    """Every Python file below the folders, in a fixed order."""
    return sorted(path for folder in folders for path in (root / folder).rglob("*.py"))


def imports(source: str, package: str) -> list[Import]:
    """All imports of a source, at any depth; `package` resolves relative ones."""
    found = []

    def visit(node: ast.AST, inside: bool) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                found.extend(Import(alias.name, "", child.lineno, inside) for alias in child.names)
            elif isinstance(child, ast.ImportFrom):
                base = importlib.util.resolve_name("." * child.level + (child.module or ""), package)
                found.extend(Import(base, alias.name, child.lineno, inside) for alias in child.names)
            visit(child, inside or isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda))

    visit(ast.parse(source), False)
    return found


def file_of(module: str, root: Path = ROOT) -> Path | None:
    """The file of a module of ours, None for others and for names that are no module."""
    for folder, package in sorted(PACKAGES.items(), key=lambda item: -len(item[1])):
        if module == package or module.startswith(package + "."):
            path = root.joinpath(folder, *module[len(package) :].strip(".").split("."))
            for candidate in (path.with_suffix(".py"), path / "__init__.py"):
                if candidate.is_file():
                    return candidate
            return None
    return None


def package_of(path: Path, root: Path = ROOT) -> str:
    """The import name of the package that a file lies in."""
    folder, *below = path.relative_to(root).parent.parts
    return ".".join((PACKAGES[folder], *below))


def imported_files(path: Path, root: Path = ROOT) -> dict[Path, list[Import]]:
    """The files of ours that a file imports, with the imports that name them."""
    files: dict[Path, list[Import]] = {}
    for item in imports(path.read_text(encoding="utf-8"), package_of(path, root)):
        target = file_of(f"{item.module}.{item.name}" if item.name else item.module, root)
        target = target or file_of(item.module, root)
        if target is not None:
            files.setdefault(target, []).append(item)
    return files


@functools.cache
def graph(*folders: str, root: Path = ROOT) -> dict[Path, dict[Path, list[Import]]]:
    """For every file of the folders what it imports."""
    return {path: imported_files(path, root) for path in source_files(*folders, root=root)}


def room_of(path: Path, root: Path = ROOT, folder: str = "") -> str:
    """The room of a file: the subfolder of its layer (or of `folder`), or the file itself; "" for the layer's
    __init__.py.
    """
    folder = folder or path.relative_to(root).parts[0]
    room, *below = path.relative_to(root / folder).parts
    if room == "__init__.py":
        return ""
    folders = any((root / folder / name).is_dir() for name in ROOMS.get(folder, ()))
    return FILES if folders and not below and FILES in ROOMS.get(folder, ()) else room.removesuffix(".py")


def room_graph(folder: str, root: Path = ROOT) -> dict[str, set[str]]:
    """For every room of a layer the other rooms of it that it imports; an empty __init__.py is no room."""
    rooms: dict[str, set[str]] = {}
    for path, imported in graph(folder, root=root).items():
        room = room_of(path, root, folder)
        if room:
            targets = [target for target in imported if target.is_relative_to(root / folder)]
            inside = {room_of(target, root, folder) for target in targets}
            rooms.setdefault(room, set()).update(inside - {room, ""})
    return rooms


def circles(arrows: dict) -> list[list]:
    """What imports itself over others: every set of two and more that reach each other (Tarjan's)."""
    index: dict = {}
    low: dict = {}
    stack: list = []
    found: list[list] = []

    def visit(node) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in arrows.get(node, ()):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            at = stack.index(node)
            if len(stack) - at > 1 or node in arrows.get(node, ()):
                found.append(sorted(stack[at:]))
            del stack[at:]

    for node in arrows:
        if node not in index:
            visit(node)
    return sorted(found)


def floors(arrows: dict[str, set[str]]) -> list[list[str]]:
    """The rooms by floors, the ground floor first, without those of a circle and what stands on one."""
    levels: list[list[str]] = []
    placed: set[str] = set()
    while True:
        free = sorted(room for room, on in arrows.items() if room not in placed and on <= placed)
        if not free:
            return levels
        levels.append(free)
        placed.update(free)


def plan(folder: str, root: Path = ROOT, arrows: bool = False) -> str:
    """What `python tests/support/plan.py` prints of a folder."""
    rooms = room_graph(folder, root)
    levels = floors(rooms)
    sizes = {room: 0 for room in rooms}
    for path in graph(folder, root=root):
        if room_of(path, root):
            sizes[room_of(path, root)] += 1
    loops = circles(rooms)
    lines = [
        f"{folder}: {sum(sizes.values())} files, {len(rooms)} rooms, {sum(map(len, rooms.values()))} arrows,"
        f" {len(levels)} floors, {len(loops)} circles"
    ]
    lines += [f"  {n}  {', '.join(levels[n])}" for n in reversed(range(len(levels)))]
    lines += [f"  circle: {', '.join(loop)}" for loop in loops]
    if arrows:
        lines += [f"  {room} -> {', '.join(sorted(on)) or '(nothing)'}" for room, on in sorted(rooms.items())]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", choices=LAYERS, action="append", help="which; all of them without it")
    parser.add_argument("--tree", type=Path, default=ROOT, help="the checkout to read")
    parser.add_argument("--arrows", action="store_true", help="print what each room imports, too")
    given = parser.parse_args()
    for folder in given.folder or LAYERS:
        print(plan(folder, given.tree.resolve(), given.arrows))
    loops = circles(graph(*LAYERS, root=given.tree.resolve()))
    for loop in loops:
        print("circle of files:", *(path.relative_to(given.tree.resolve()) for path in loop))


if __name__ == "__main__":
    sys.exit(main())
