"""Names in users' Python files, as `file.py:name` says them."""

import ast
import hashlib
import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_folders: list[str] = []  # of files that were run, in `sys.path` behind everything else, the latest first


def python_name(path: Path, name: str) -> tuple[Any, dict[str, Any]]:
    """What has a name in a Python file, which is run as a module of its own, and all names of it.

    None where nothing has it. The file imports modules that lie beside it, as a script does; what is
    installed comes before them. Errors of the file go through.

    Raises:
        FileNotFoundError: no such file.
        ImportError: a module beside it has the name of one beside another file, which was imported already.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    place = hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:16]  # the same in every process
    module_name = f"slcp_file_{path.stem}_{place}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # Warp looks its functions' modules up
    _put_folder(path.resolve())
    spec.loader.exec_module(module)
    return getattr(module, name, None), vars(module)


def _put_folder(path: Path) -> None:
    """Let modules beside a file be found."""
    folder = str(path.parent)
    for name, beside in _beside(path):
        there = getattr(sys.modules.get(name), "__file__", None)
        if there is not None and Path(there) != beside and _folder_of(name, Path(there)) in _folders:
            raise ImportError(
                f"{path} imports {name!r}, which was imported already from {there}; "
                "give one of them another name"
            )
    if folder in sys.path and folder not in _folders:
        return
    sys.path[:] = [each for each in sys.path if each not in _folders]
    _folders[:] = [folder, *(each for each in _folders if each != folder)]
    sys.path.extend(_folders)


def _folder_of(name: str, module: Path) -> str:
    """Where a module of this name was found, or the package that a file begins."""
    return str(module.parents[name.count(".") + (module.name == "__init__.py")])


def _beside(path: Path) -> Iterator[tuple[str, Path]]:
    """The modules of a folder that one of its files imports, also through others, by name."""
    todo, seen = [path], {path}
    while todo:
        file = todo.pop()
        try:
            tree = ast.parse(file.read_bytes())
        except (SyntaxError, ValueError):
            continue  # it says so when it is run
        names = {
            alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names
        }
        names |= {
            f"{node.module}.{alias.name}"
            for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module
            for alias in node.names
        }  # fmt: skip
        for name in sorted(names):
            found, beside = _first_file(path.parent, name.split("."))
            if beside is not None and beside not in seen:
                seen.add(beside)
                todo.append(beside)
                yield found, beside


def _first_file(folder: Path, parts: list[str]) -> tuple[str, Path | None]:
    """The first file that importing a name from a folder runs, and its name: of a folder without
    `__init__.py`, a package over several places, it is a module in it. None: it is not there.
    """
    for n, part in enumerate(parts):
        package, module = folder / part / "__init__.py", folder / f"{part}.py"
        beside = package if package.is_file() else module  # as Python chooses
        if beside.is_file():
            return ".".join(parts[: n + 1]), beside
        folder = folder / part
    return "", None
