"""Docstrings parse: sections name what the signature has, an entry a line of its own, no line cut short."""

import ast
import dataclasses
import inspect
import re
from pathlib import Path

import pytest
from test_docs import name
from test_layout import LAYERS, source_files

import slcp_warp
from slcp_warp import ddp

NODES = (ast.Module, ast.ClassDef, ast.FunctionDef)
HEADS = ("Args", "Attributes", "Raises")
ENTRY = re.compile(r" {4}(\*{0,2}\w+(?:, \*{0,2}\w+)*): ")
INSIDE = re.compile(r"(?<=[.;)\]]) (\w+(?:, \w+)*)(?:: | \[)")  # an entry that begins in the middle of a line


def documented(path: Path):
    """(label, node, docstring) of every docstring of a source."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        text = ast.get_docstring(node) if isinstance(node, NODES) else None
        if text is not None:
            yield getattr(node, "name", "module"), node, text


def parameters(node) -> set[str]:
    """What the Args or Attributes of a function or class may name."""
    if isinstance(node, ast.FunctionDef):
        arguments = node.args
        given = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
        return {a.arg for a in (*given, arguments.vararg, arguments.kwarg) if a is not None}
    names = set()
    for child in getattr(node, "body", ()):
        if isinstance(child, ast.AnnAssign) and isinstance(child.target, ast.Name):
            names.add(child.target.id)
        elif isinstance(child, ast.FunctionDef):
            names |= {child.name} | (parameters(child) if child.name == "__init__" else set())
            names |= {
                n.attr for n in ast.walk(child)
                if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name) and n.value.id == "self"
            }  # fmt: skip
    return names


def sections(text: str):
    """(head, lines) of the sections of a docstring."""
    for head, block in re.findall(rf"^({'|'.join(HEADS)}):\n((?:(?: .*)?\n?)*)", text, re.MULTILINE):
        yield head, [line for line in block.splitlines() if line.strip()]


def is_error(word: str) -> bool:
    return word[0].isupper()


def faults(node, text: str):
    """What is wrong with the sections of a docstring."""
    known, inherits = parameters(node), bool(getattr(node, "bases", ()))  # from another file, maybe
    for head, lines in sections(text):
        for line in lines:
            entry = ENTRY.match(line)
            if entry is None and not line.startswith(" " * 8):
                yield f"{head}: {line.strip()!r} is neither an entry nor further in than one"
            names = entry[1].replace("*", "").split(", ") if entry else []
            for word in names:
                if not (is_error(word) if head == "Raises" else word in known or inherits):
                    yield f"{head}: {word!r} is none"
            for found in INSIDE.findall(line):
                if all(is_error(word) if head == "Raises" else word in known for word in found.split(", ")):
                    yield f"{head}: {found!r} begins in the middle of a line"


def cut_lines(text: str):
    """Lines of running text that end early, although the next word would have fitted."""
    lines = text.splitlines()
    for line, after in zip(lines, lines[1:]):
        if not line.strip() or not after.strip() or len(line) + len(after.split()[0]) >= 85:
            continue
        same = len(line) - len(line.lstrip()) == len(after) - len(after.lstrip())
        if same and re.search(r"[a-z,]$", line) and re.match(r" *[a-z]+ [a-z]", after):
            yield line.strip()


@pytest.mark.parametrize("path", source_files(*LAYERS), ids=name)
def test_sections_of_docstrings(path):
    assert [
        f"{label}: {fault}" for label, node, text in documented(path) for fault in faults(node, text)
    ] == []


@pytest.mark.parametrize("path", source_files(*LAYERS), ids=name)
def test_no_line_of_a_docstring_is_cut_short(path):
    assert [f"{label}: {line}" for label, _, text in documented(path) for line in cut_lines(text)] == []


def public():
    """(name, object) of what the package hands out, named scenes apart: their sizes speak for themselves."""
    for module in (slcp_warp, slcp_warp.costs, ddp, ddp.costs):
        for one in module.__all__:
            found = getattr(module, one)
            if inspect.isfunction(found) or dataclasses.is_dataclass(found):
                yield pytest.param(found, id=f"{module.__name__}.{one}")


@pytest.mark.parametrize("thing", list(public()))
def test_fields_and_arguments_of_what_is_public_are_documented(thing):
    text = inspect.getdoc(thing) or ""
    if dataclasses.is_dataclass(thing):
        names = [field.name for field in dataclasses.fields(thing) if field.init and field.name[0] != "_"]
    else:
        names = [name for name in inspect.signature(thing).parameters if name != "path"]
    assert [name for name in names if not re.search(rf"\b{name}\b", text)] == []


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("A.\n\nArgs:\n    x: (B, nx).\n    u: (B, nu),\n        or None.\n", 0),
        ("A.\n\nArgs:\n    x: (B, nx). u: (B, nu).\n", 1),
        ("A.\n\nArgs:\n    x: (B, nx). u [m].\n", 1),
        ("A.\n\nArgs:\n    x: (B, nx),\n    or (nx,).\n", 1),
        ("A.\n\nArgs:\n    y: none.\n", 1),
        ("A.\n\nRaises:\n    ValueError: one. TypeError: two.\n", 1),
        ("A.\n\nRaises:\n    ValueError: one.\n    TypeError: two.\n", 0),
    ],
)
def test_the_rule_itself(text, wrong):
    node = ast.parse("def f(x, u): ...").body[0]
    assert len(list(faults(node, text))) == wrong
