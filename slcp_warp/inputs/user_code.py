"""Users' Warp functions: what Warp cannot translate, and indices that are beyond what they index.

The latter are read off the code, as Warp does not look. An index counts that is a number in the code, a name
of one outside of the function, or what a loop over a range of such numbers counts, alone or with a number
added, where no question about it stands between; one that is computed otherwise, or behind a condition that
asks for a length, is the user's.
"""

import ast
import contextlib
import functools
import inspect
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import warp as wp

from .errors import ArgumentError, ArgumentTypeError

Shapes = tuple[tuple[str, tuple[int, ...]], ...]  # of the arrays of a struct, by name
MOST = 8  # functions that call each other


class Known(NamedTuple):
    """What is known of an argument: a vector's length, or the shapes of a struct's arrays."""

    length: int | None = None
    arrays: Shapes = ()


UNKNOWN = Known()


@contextlib.contextmanager
def of_user(what: str) -> Iterator[None]:
    """Errors of a user's code, or of Warp on it, as one ArgumentTypeError; `what` says what it is not."""
    try:
        yield
    except ArgumentError:
        raise
    except Exception as error:
        raise ArgumentTypeError(f"{what}: {type(error).__name__}: {last_line(error)}") from error


def last_line(error: Exception) -> str:
    """The line of an error that says what is wrong."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return f"{lines[-1] if lines else ''}"[:300]


def check_indices(label: str, function: Any, *known: Known) -> None:
    """Raise ArgumentError for an index in a function, or in what it calls, that its arguments do not have.

    Args:
        label: what the function is.
        known: of its arguments in their order; those that are left out are not known.
    """
    if function is not None and (wrong := _wrong(function, known, MOST)):
        raise ArgumentError(f"{label}: {wrong}")


def reads(function: Any, place: int) -> bool:
    """Whether a function names its argument at a place; True where its code is not known."""
    adjoint: Any = getattr(function, "adj", None)
    body = adjoint.tree.body[0] if getattr(adjoint, "tree", None) is not None else None
    if not isinstance(body, ast.FunctionDef) or len(body.args.args) <= place:
        return True
    name = body.args.args[place].arg
    return any(isinstance(n, ast.Name) and n.id == name for n in ast.walk(body))


@functools.lru_cache(1024)
def _wrong(function: Any, known: tuple[Known, ...], depth: int) -> str:
    """What is wrong, in words, or ""."""
    if len(getattr(function, "user_overloads", None) or ()) > 1:
        return ""  # which one is called goes by its arguments
    adjoint: Any = getattr(function, "adj", None)
    body = adjoint.tree.body[0] if getattr(adjoint, "tree", None) is not None else None
    if not isinstance(body, ast.FunctionDef) or depth == 0:
        return ""
    arguments = [each.arg for each in body.args.args]
    own = {
        *arguments,
        *(n.id for n in ast.walk(body) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)),
    }
    outside = {name: value for name, value in _outside(adjoint.func).items() if name not in own}
    there = _locals(body, dict(zip(arguments, known)), outside)
    guarded, loops = _guarded(body, own, outside), _loops(body, outside)
    for node in ast.walk(body):
        if id(node) in guarded:
            continue
        found = ""
        if isinstance(node, ast.Subscript):
            found = _index(node, there, outside | loops.get(id(node), {}))
        elif isinstance(node, ast.Call):
            called = outside.get(node.func.id) if isinstance(node.func, ast.Name) else None
            if isinstance(called, wp.Function):
                given = (there.get(a.id, UNKNOWN) if isinstance(a, ast.Name) else UNKNOWN for a in node.args)
                found = _wrong(called, tuple(given), depth - 1)
                if found:
                    return found
        if found:
            return f"{body.name} has {found}"
    return ""


def _outside(function: Any) -> Mapping[str, Any]:
    """Names that a function has from outside."""
    try:
        names = inspect.getclosurevars(function)
    except (TypeError, ValueError):
        return {}
    return {**names.globals, **names.nonlocals}


def _locals(
    body: ast.FunctionDef, there: Mapping[str, Known], outside: Mapping[str, Any]
) -> dict[str, Known]:
    """What is known of names: of arguments that stay what they are, and of vectors that are made here."""
    made: dict[str, set[int | None]] = {}
    direct: set[int] = set()
    for node in ast.walk(body):
        if not isinstance(node, ast.Assign):
            continue
        for target in node.targets:
            if isinstance(target, ast.Name):
                made.setdefault(target.id, set()).add(_length_made(node.value, outside))
                direct.add(id(target))
    for node in ast.walk(body):  # part of a tuple, of a loop, changed in place
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and id(node) not in direct:
            made.setdefault(node.id, set()).add(None)
    out = {name: each for name, each in there.items() if name not in made}
    for name, lengths in made.items():
        if len(lengths) == 1 and None not in lengths and name not in there:
            out[name] = Known(next(iter(lengths)))
    return out


def _length_made(value: ast.expr, outside: Mapping[str, Any]) -> int | None:
    """The length of a vector that a value makes by its type."""
    if isinstance(value, ast.Call) and isinstance(value.func, ast.Name):
        length = getattr(outside.get(value.func.id), "_length_", None)
        return length if isinstance(length, int) else None
    return None


def _loops(body: ast.FunctionDef, outside: Mapping[str, Any]) -> dict[int, dict[str, int]]:
    """Of every subscript in loops over ranges of known numbers the last that each counts, by its name."""
    found: dict[int, dict[str, int]] = {}
    for node in ast.walk(body):
        if not isinstance(node, ast.For) or not isinstance(node.target, ast.Name):
            continue
        span = _span(node.iter, outside)
        if span is None or _asked(node, node.target.id):
            continue
        for inner in ast.walk(ast.Module(node.body, [])):
            if isinstance(inner, ast.Subscript):
                found.setdefault(id(inner), {})[node.target.id] = span[-1]
    return found


def _span(over: ast.expr, outside: Mapping[str, Any]) -> range | None:
    """The range of a loop that has a pass, if the code says which."""
    if not isinstance(over, ast.Call) or not isinstance(over.func, ast.Name) or over.func.id != "range":
        return None
    given = [_number(each, {}, outside) for each in over.args]
    numbers = [each for each in given if each is not None]
    if not 1 <= len(numbers) == len(given) <= 2:
        return None
    return range(*numbers) or None


def _asked(loop: ast.For, name: str) -> bool:
    """Whether a loop asks about what it counts, changes it, or may end early."""
    for node in ast.walk(ast.Module(loop.body, [])):
        tests: list[ast.expr] = []
        if isinstance(node, ast.If | ast.IfExp | ast.While):
            tests = [node.test]
        elif isinstance(node, ast.BoolOp | ast.Break | ast.Continue | ast.Return):
            return True
        if any(isinstance(n, ast.Name) and n.id == name for test in tests for n in ast.walk(test)):
            return True
        if isinstance(node, ast.Name) and node.id == name and isinstance(node.ctx, ast.Store):
            return True
    return False


def _guarded(body: ast.FunctionDef, own: set[str], outside: Mapping[str, Any]) -> set[int]:
    """What stands behind a question about lengths: in it, and where it may end the function all of that."""
    found: set[int] = set()
    for node in ast.walk(body):
        tests: list[ast.expr] = []
        if isinstance(node, ast.If | ast.IfExp | ast.While):
            tests = [node.test]
        elif isinstance(node, ast.BoolOp):
            tests = node.values
        elif isinstance(node, ast.For) and _span(node.iter, outside) is None:
            tests = [node.iter]
        if any(_asks(test, own, isinstance(node, ast.For)) for test in tests):
            ends = any(isinstance(n, ast.Return | ast.Break | ast.Continue) for n in ast.walk(node))
            found |= {id(inner) for inner in ast.walk(body if ends else node)}
    return found


def _asks(test: ast.expr, own: set[str], loop: bool) -> bool:
    """Whether an expression asks for a length, or is settled before the kernel is made: what nothing of the
    function is in. Of a loop: whether it may have no pass.
    """
    names = {node.id for node in ast.walk(test) if isinstance(node, ast.Name)}
    for node in ast.walk(test):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in ("static", "len"):
                return True
        if isinstance(node, ast.Attribute) and node.attr in ("shape", "_length_"):
            return True
    if loop:
        numbers = [node.value for node in ast.walk(test) if isinstance(node, ast.Constant)]
        return names != {"range"} or len(numbers) != 1 or numbers[0] == 0
    return not names & own


def _index(node: ast.Subscript, there: Mapping[str, Known], outside: Mapping[str, Any]) -> str:
    """An index that is beyond, in words, or ""."""
    value = node.value
    if isinstance(value, ast.Name):
        known = there.get(value.id, UNKNOWN)
        at = _number(node.slice, there, outside)
        if known.length is None or at is None or -known.length <= at < known.length:
            return ""
        return f"{value.id}[{at}]; {value.id} has {known.length} numbers"
    if not (isinstance(value, ast.Attribute) and isinstance(value.value, ast.Name)):
        return ""
    shapes = dict(there.get(value.value.id, UNKNOWN).arrays)
    if value.attr not in shapes:
        return ""
    places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    for place, size in zip(places, shapes[value.attr]):
        at = _number(place, there, outside)
        if at is not None and not -size <= at < size:
            whole = f"{value.value.id}.{value.attr}"
            index = ", ".join(ast.unparse(each) for each in places)
            return f"{whole}[{index}]; {whole} has shape {shapes[value.attr]}"
    return ""


def _number(place: ast.expr, there: Mapping[str, Known], outside: Mapping[str, Any]) -> int | None:
    """The whole number that an index is, if the code says so."""
    if isinstance(place, ast.UnaryOp) and isinstance(place.op, ast.USub):
        inside = _number(place.operand, there, outside)
        return None if inside is None else -inside
    if isinstance(place, ast.BinOp) and isinstance(place.op, ast.Add):
        sides = [_number(side, there, outside) for side in (place.left, place.right)]
        return None if None in sides else sum(sides)  # type: ignore[arg-type]
    found = place.value if isinstance(place, ast.Constant) else None
    if isinstance(place, ast.Name) and place.id not in there:
        found = outside.get(place.id)
    return found if isinstance(found, int) and not isinstance(found, bool) else None
