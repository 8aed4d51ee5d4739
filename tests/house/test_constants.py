"""A factory's constant that both branches of an inner `if` are the first to read is no value behind it.

Warp makes one variable of what two branches of an `if` name, a constant of the factory among it, and sets it
where they meet. Inside of another branch that place may never be reached, and what reads the constant further
out reads a variable that nothing has set: an optimising compiler hides it, another one does not. Read once
before the branches the constant stays one.
"""

import ast
import re
from pathlib import Path

import pytest
from plan import LAYERS, ROOT, source_files

OF_WARP = {"func", "kernel", "specialised", "packed", "fitted"}  # decorators
Scope = tuple[int, ...]
Known = dict[str, Scope | None]  # by name where its variable is set; None: it is a constant everywhere


def reads(node: ast.AST) -> list[ast.Name]:
    """Constants that an expression reads: names in capitals, but for the literals of `wp.static`."""
    if isinstance(node, ast.expr) and is_static(node):
        return []
    if isinstance(node, ast.Name):
        return [node] if isinstance(node.ctx, ast.Load) and node.id.isupper() and len(node.id) > 1 else []
    return [name for child in ast.iter_child_nodes(node) for name in reads(child)]


def is_static(test: ast.expr) -> bool:
    """Whether a branch is chosen when the kernel is made."""
    return isinstance(test, ast.Call) and ast.unparse(test.func) == "wp.static"


class Reader:
    """Reads a Warp function as its code is made; `wrong`: (line, name) of what reads a variable unset."""

    def __init__(self) -> None:
        self.wrong: list[tuple[int, str]] = []
        self._scopes = 0

    def look(self, node: ast.AST, known: Known, scope: Scope) -> None:
        """An expression."""
        for name in reads(node):
            where = known.setdefault(name.id, None)
            if where is not None and scope[: len(where)] != where:
                self.wrong.append((name.lineno, name.id))

    def inside(self, body: list[ast.stmt], known: Known, scope: Scope) -> Known:
        """What is known at the end of a branch."""
        self._scopes += 1
        own = dict(known)
        self.block(body, own, (*scope, self._scopes))
        return own

    def block(self, body: list[ast.stmt], known: Known, scope: Scope) -> None:
        """Statements, one after the other."""
        for statement in body:
            if isinstance(statement, ast.If):
                self.branches(statement, known, scope)
            elif isinstance(statement, ast.For | ast.While):
                self.look(statement.iter if isinstance(statement, ast.For) else statement.test, known, scope)
                known.update(self.inside(statement.body, known, scope))
            elif not isinstance(statement, ast.FunctionDef | ast.ClassDef):
                self.look(statement, known, scope)

    def branches(self, node: ast.If, known: Known, scope: Scope) -> None:
        """Both branches of an `if`, and what is known behind it."""
        self.look(node.test, known, scope)
        if is_static(node.test):
            self.block(node.body, known, scope)
            self.block(node.orelse, known, scope)
            return
        first, second = (self.inside(body, known, scope) for body in (node.body, node.orelse))
        for name in (first.keys() | second.keys()) - known.keys():
            both = name in first and name in second
            known[name] = scope if both else first.get(name, second.get(name))


def unset(source: str) -> list[tuple[int, str]]:
    """(line, name) of constants that are read behind branches that made a variable of them."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and any(
            OF_WARP & set(re.findall(r"\w+", ast.unparse(d))) for d in node.decorator_list
        ):
            reader = Reader()
            reader.block(node.body, {}, ())
            found += reader.wrong
    return found


@pytest.mark.parametrize(
    "path", source_files(*LAYERS, "examples"), ids=lambda path: str(path.relative_to(ROOT))
)
def test_constants_are_set_where_they_are_read(path: Path):
    assert unset(path.read_text(encoding="utf-8")) == []


WRONG = """
@wp.func
def take(what: int, v: float):
    if what == 1:
        v = v + v
    else:
        if what == 2:
            v = ONE
        else:
            v = v + ONE
    return v + ONE
"""


def test_the_trap_itself_is_found():
    assert unset(WRONG) == [(11, "ONE")]
    assert unset(WRONG.replace("    if what == 1", "    v = v * ONE\n    if what == 1")) == []  # read before
    assert unset(WRONG.replace("v = ONE", "v = v")) == []  # of one branch alone
    assert unset(WRONG.replace("v = v + v", "v = v + ONE")) == []  # set on every way
    assert unset(WRONG.replace("return v + ONE", "return v")) == []  # not read any more
