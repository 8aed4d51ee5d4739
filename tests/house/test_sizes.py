"""What a reader opens is small: folders of few names, files of few lines, functions that fit a screen."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from plan import LAYERS, ROOT, source_files

MAX_LINES = 400  # of a file
MAX_NAMES = 18  # of a folder: about fifteen
MAX_CODE = 60  # lines of a function
CODE = (*LAYERS, "examples", "tests")
REASON = "# long: "
Function = ast.FunctionDef | ast.AsyncFunctionDef


def shown(folder: Path) -> list[str]:
    """The names that `ls` shows of a folder of sources, without what belongs to every package."""
    hidden = {"__init__.py", "__pycache__", "py.typed"}
    return sorted(p.name for p in folder.iterdir() if p.name not in hidden and not p.name.startswith("."))


def folders() -> list[Path]:
    return sorted({path.parent for path in source_files(*CODE)} | {ROOT / "docs"})


@pytest.mark.parametrize("folder", folders(), ids=lambda path: str(path.relative_to(ROOT)))
def test_a_folder_is_seen_at_a_glance(folder):
    names = shown(folder)
    assert len(names) <= MAX_NAMES, f"{len(names)}: {names}"


def test_names_are_counted_as_a_reader_sees_them(tmp_path):
    for name in ("__init__.py", "a.py", "b.py", "py.typed", ".hidden", "notes.md"):
        (tmp_path / name).touch()
    for name in ("__pycache__", "room"):
        (tmp_path / name).mkdir()
    assert shown(tmp_path) == ["a.py", "b.py", "notes.md", "room"]


def test_no_file_is_too_long():
    lengths = {path: len(path.read_text().splitlines()) for path in source_files(*CODE)}
    assert {str(path): lines for path, lines in lengths.items() if lines > MAX_LINES} == {}


def functions(tree: ast.AST) -> Iterator[Function]:
    """Every function of a source, nested ones too."""
    return (node for node in ast.walk(tree) if isinstance(node, Function))


def nested(function: Function) -> Iterator[ast.AST]:
    """The functions and classes right below a function."""
    todo = list(function.body)
    while todo:
        node = todo.pop()
        if isinstance(node, Function | ast.ClassDef):
            yield node
        else:
            todo += ast.iter_child_nodes(node)


def own_lines(function: Function, lines: list[str]) -> list[str]:
    """The lines of a function from its `def` on, stripped; no docstring, no nested functions and classes."""
    left_out: set[int] = set()
    if ast.get_docstring(function) is not None:
        left_out.update(range(function.body[0].lineno, function.body[0].end_lineno + 1))
    for node in nested(function):
        first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
        left_out.update(range(first, node.end_lineno + 1))
    return [
        lines[i - 1].strip() for i in range(function.lineno, function.end_lineno + 1) if i not in left_out
    ]


def code_lines(function: Function, lines: list[str]) -> int:
    """How many lines of code a function has: a factory that nests functions is judged by its parts."""
    return sum(bool(line) and not line.startswith("#") for line in own_lines(function, lines))


def has_reason(function: Function, lines: list[str]) -> bool:
    """Whether a comment of the function's own says why it is long."""
    own = own_lines(function, lines)
    return any(line.startswith(REASON) and len(line) > len(REASON) + 20 for line in own)


def too_long(source: str) -> list[str]:
    """The functions of a source that do not fit a screen and say no reason."""
    lines = source.splitlines()
    long = [f for f in functions(ast.parse(source)) if code_lines(f, lines) > MAX_CODE]
    return [f"{f.name}: {code_lines(f, lines)}" for f in long if not has_reason(f, lines)]


def test_functions_fit_a_screen():
    found = {
        str(path.relative_to(ROOT)): too_long(path.read_text(encoding="utf-8"))
        for path in source_files(*CODE)
    }
    assert {path: names for path, names in found.items() if names} == {}


def test_a_function_is_measured_by_its_own_lines():
    body = "\n".join(f"    x{i} = {i}" for i in range(MAX_CODE - 1))
    fits, long = f"def f():\n{body}\n", f"def f():\n{body}\n    return 1\n"
    assert too_long(fits) == []
    assert too_long(long) == [f"f: {MAX_CODE + 1}"]
    assert too_long(f'def f():\n    """Words.\n\n    More words.\n    """\n    # a comment\n\n{body}\n') == []
    inner = "\n".join("    " + line for line in fits.splitlines())
    assert too_long(f"def make():\n{inner}\n    @decorated\n{inner}\n    return f\n") == []
    deeper = "\n".join("    " + line for line in long.splitlines())
    assert too_long(f"def make():\n    if True:\n{deeper.replace('    ', '        ')}\n") == [
        f"f: {MAX_CODE + 1}"
    ]
    assert (
        too_long(long.replace("    return", "    # long: one table that is read from above\n    return"))
        == []
    )
    assert too_long(long.replace("    return", "    # long:\n    return")) == [f"f: {MAX_CODE + 1}"]
    reason = "def make():\n    def f():\n        # long: one table that is read from above\n        pass\n"
    assert too_long(reason + body + "\n    return 1\n") == [f"make: {MAX_CODE + 1}"]
