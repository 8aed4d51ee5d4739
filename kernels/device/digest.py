"""Digest of all that determines a kernel's code: its source and every value that its source names.

What Warp makes of a function depends on its syntax tree, the types of its arguments, and the values of the
names in it: other functions, types, constants, tuples and namespaces of these. A digest over all of them,
followed through all functions, is another one exactly where an edit can change the code. Comments,
docstrings, the place of a file and whatever else a file contains do not enter. Nothing is translated for it.

Of a dotted name only the last value counts: `rows.limit` is one function, not all that `rows` holds. Names
that `wp.static` looks up enter like all others, also where a loop's index picks the value (`gap_row[i]`: all
of `gap_row`).

What cannot be followed is an OpaqueError, and Warp's translation tells instead: objects and classes of
users, whose methods may reach anything; arrays; `eval`, `globals` and the like.
"""

import ast
import builtins
import dataclasses
import enum
import functools
import hashlib
import inspect
import os
import sys
import sysconfig
import textwrap
from collections.abc import Callable
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType, SimpleNamespace
from typing import Any

import warp as wp
from warp._src.codegen import Struct
from warp._src.types import Reference

ATOMS = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis))
SCALARS = (wp.float16, wp.float32, wp.float64, wp.int8, wp.int16, wp.int32, wp.int64,
           wp.uint8, wp.uint16, wp.uint32, wp.uint64)  # fmt: skip
OWN = __name__.partition(".")[0]
STANDARD = tuple(os.path.join(sysconfig.get_path(name), "") for name in ("stdlib", "platstdlib"))
BLIND = {eval, exec, compile, globals, locals, vars, getattr, __import__}  # they reach what no name tells
MISSING = object()


class OpaqueError(TypeError):
    """A function names a value whose content cannot be told."""


def content_digest(function: Callable, *more: Any) -> str:
    """Digest of a kernel's Python function, and of values beside it, as 64 hexadecimal digits.

    Raises:
        OpaqueError: the function, or one that it calls, names a value of an unknown type.
    """
    walk = _Walk()
    whole = walk.of((wp.__version__, more)) + walk.of_function(function, function.__annotations__)
    return hashlib.sha256(whole).hexdigest()


def own_alone(function: Callable) -> bool:
    """Whether a kernel's Python function and all that it calls are of this package, Warp, NumPy and the
    standard library.
    """
    walk = _Walk()
    try:
        walk.of_function(function, function.__annotations__)
    except OpaqueError:
        return False
    return not walk.foreign


class _Walk:
    """Digests of values, each found once."""

    def __init__(self) -> None:
        self.foreign = False  # whether a function of a user's is among them
        self.known: dict[int, tuple[bytes, Any]] = {}  # by id; the value is kept, and with it its id

    def of(self, value: Any) -> bytes:
        """Digest of a value."""
        if _plain(value, ATOMS) and not isinstance(value, enum.Enum):
            return _hash(type(value).__name__, repr(value))
        found = self.known.get(id(value))
        if found is None:
            self.known[id(value)] = (b"itself", value)  # in a function that calls itself
            found = self.known[id(value)] = (self._of_new(value), value)
        return found[0]

    def _of_new(self, value: Any) -> bytes:
        if isinstance(value, wp.Function):
            return self._of_warp_function(value)
        if isinstance(value, Struct):
            return _hash("struct", value.hash, *(self.of(var.type) for var in value.vars.values()))
        if isinstance(value, Reference):  # an argument that is handed on by reference
            return _hash("reference", self.of(value.value_type))
        if isinstance(value, enum.Enum):
            return _hash("enum", type(value).__qualname__, value.name, self.of(value.value))
        if isinstance(value, tuple) and not _plain(value, (tuple,)):  # with names, and perhaps with methods
            return _hash(self._of_methods(type(value)), *(self.of(item) for item in value))
        if _plain(value, (tuple, list)):
            return _hash(type(value).__name__, *(self.of(item) for item in value))
        if _plain(value, (set, frozenset)):
            return _hash("set", *sorted(self.of(item) for item in value))
        if _plain(value, (dict,)):
            return _hash("dict", *(self.of(item) for pair in value.items() for item in pair))
        if isinstance(value, type):
            return self._of_type(value)
        if isinstance(value, wp.array):  # an annotation
            if value.ptr:
                raise OpaqueError("the content of an array may change")
            return _hash("array", type(value).__name__, repr(value.ndim), self.of(value.dtype))
        if hasattr(type(value), "_wp_scalar_type_"):
            return _hash(self.of(type(value)), bytes(value))
        if isinstance(value, SCALARS):
            return _hash(type(value).__name__, repr(value.value))
        if isinstance(value, BuiltinFunctionType) and isinstance(value.__self__, ModuleType | type(None)):
            return _hash("builtin", value.__module__ or "", value.__qualname__)
        if isinstance(value, FunctionType) or hasattr(value, "__wrapped__"):
            return self._of_python_function(inspect.unwrap(value))
        if isinstance(value, MethodType):
            return _hash("method", self.of(value.__self__), self.of(value.__func__))
        if isinstance(value, functools.partial):
            return _hash("partial", self.of(value.func), self.of(value.args), self.of(value.keywords))
        return self._of_object(value)

    def _of_object(self, value: Any) -> bytes:
        """An object by its attributes, or by its bytes if it is an array."""
        kind = type(value)
        if kind is SimpleNamespace:
            return _hash(kind.__qualname__, self.of(vars(value)))
        if dataclasses.is_dataclass(value):  # fields only: others tell what was asked of it before
            fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
            return _hash(kind.__qualname__, self.of(fields), self._of_methods(kind))
        try:
            data = memoryview(value)
            return _hash(kind.__qualname__, data.format, repr(data.shape), data.tobytes())
        except TypeError:
            raise OpaqueError(f"the content of a {kind.__qualname__} cannot be told") from None

    def _of_type(self, value: type) -> bytes:
        scalar = getattr(value, "_wp_scalar_type_", None)
        if scalar is not None:
            kind = value._wp_generic_type_str_  # a quaternion is no vector of four
            plain = "matrix" if kind in ("vec_t", "mat_t") else kind
            return _hash(plain, repr(value._shape_), self.of(scalar))
        if _in_library(value.__module__):
            return _hash("type", value.__module__, value.__qualname__)
        return _hash("class", value.__qualname__, self._of_methods(value))

    def _of_methods(self, kind: type) -> bytes:
        """A class of this package, and those that it is made of, by all that their bodies hold."""
        parts: list[str | bytes] = []
        for base in kind.__mro__:
            if _in_library(base.__module__):
                parts.append(f"{base.__module__}.{base.__qualname__}")
                continue
            if base.__module__.partition(".")[0] != OWN:
                raise OpaqueError(f"what a {base.__qualname__} does cannot be told")
            parts.append(_Source.of(base).text)
            for held in vars(base).values():
                function = getattr(held, "fget", None) or getattr(held, "func", None)
                function = function or getattr(held, "__func__", held)
                function = inspect.unwrap(function) if callable(function) else function
                written = isinstance(function, FunctionType) and function.__code__.co_filename[0] != "<"
                if written and function.__module__ == base.__module__:  # not what `dataclass` makes
                    parts.append(self.of(function))
        return _hash(*parts)

    def _of_warp_function(self, value: wp.Function) -> bytes:
        if value.is_builtin():
            return _hash("builtin", value.key, value.native_func)
        templates = {id(template.func) for template in value.user_templates.values()}
        asked = {name: f for name, f in value.user_overloads.items() if id(f.func) not in templates}
        overloads = asked | value.user_templates  # not what templates were made into so far
        return _hash("overloads", *(self._of_overload(overloads[name]) for name in sorted(overloads)))

    def _of_overload(self, value: wp.Function) -> bytes:
        parts = [value.key, value.inline_hint, value.native_snippet, value.adj_native_snippet,
                 value.replay_snippet, value.custom_grad_func, value.custom_replay_func]  # fmt: skip
        whole = _hash(self.of(parts), self.of_function(value.func, value.adj.arg_types, value.adj.source))
        if (value.func.__module__ or "").partition(".")[0] == OWN:
            value.adj.code_digest = whole  # its translation is kept for it (`translated.py`)
        return whole

    def _of_python_function(self, value: FunctionType) -> bytes:
        if _in_library(value.__module__):
            return _hash("function", value.__module__, value.__qualname__)
        return self.of_function(value, {})

    def of_function(
        self, function: FunctionType, annotations: dict[str, Any], text: str | None = None
    ) -> bytes:
        """A function by its syntax tree, its annotations and defaults, and the values of its names."""
        source = _Source.of(function, text)
        names = [self.of(annotations), self.of((function.__defaults__, function.__kwdefaults__))]
        own = (function.__module__ or "").partition(".")[0] == OWN
        self.foreign |= not own
        captured = dict(zip(function.__code__.co_freevars, function.__closure__ or ()))
        for path in source.names:
            value = _value(path, captured, function)
            if not own and any(value is blind for blind in BLIND):
                raise OpaqueError(f"{value.__name__} may reach anything")
            names += [_hash(*path), b"unset" if value is MISSING else self.of(value)]
        return _hash("code", source.text, *names)


class _Source:
    """A function's syntax tree as text without docstrings, and the dotted names that it looks up outside."""

    made: dict[int, tuple[Any, "_Source"]] = {}  # by id of what the source belongs to, which is kept

    def __init__(self, thing: Any, source: str | None) -> None:
        code = getattr(thing, "__code__", None)
        if code is not None and code.co_name == "<lambda>":  # whose source cannot be cut out of its line
            self.text = _code_text(code)
            self.names = sorted((name,) for name in _code_names(code))
            return
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(thing)) if source is None else source)
        except (OSError, SyntaxError, TypeError) as error:
            raise OpaqueError(f"the source of {thing!r} cannot be read ({error})") from None
        words: list[str] = []
        names: set[tuple[str, ...]] = set()
        (definition,) = tree.body
        for field in definition._fields:  # type and default of an argument are values of the function
            found = names if field == "body" else set()
            _read_field(definition, field, words, found)
        local = set() if code is None else {*code.co_varnames, *code.co_cellvars}
        self.text = "\0".join(words)
        self.names = sorted(name for name in names if name[0] not in local)

    @classmethod
    def of(cls, thing: Any, source: str | None = None) -> "_Source":
        """The source of a function or class, read once for all functions that a definition makes."""
        key = getattr(thing, "__code__", thing)
        if id(key) not in cls.made:
            cls.made[id(key)] = key, cls(thing, source)
        return cls.made[id(key)][1]


def _read(node: ast.AST, words: list[str], names: set[tuple[str, ...]]) -> None:
    """Write a syntax tree as words, and collect its names, each with the attributes that follow it."""
    path: list[str] = []
    end = node
    while end.__class__ is ast.Attribute:
        path.append(end.attr)
        end = end.value
    if end.__class__ is ast.Name:
        name = (end.id, *reversed(path))
        names.add(name)
        words.append("name " + ".".join(name))
        return
    words += ["." + attribute for attribute in path]
    words.append(end.__class__.__name__)
    for field in end._fields:
        _read_field(end, field, words, names)


def _read_field(node: ast.AST, field: str, words: list[str], names: set[tuple[str, ...]]) -> None:
    value = getattr(node, field, None)
    if isinstance(value, list):
        described = field == "body" and isinstance(node, ast.FunctionDef | ast.ClassDef)
        if described and ast.get_docstring(node, clean=False) is not None:
            value = value[1:]
        words.append(f"{field} {len(value)}")
        for item in value:
            if isinstance(item, ast.AST):
                _read(item, words, names)
            else:
                words.append(repr(item))
    elif field == "ctx":  # whether it is set or read follows from where it is
        return
    elif isinstance(value, ast.AST):
        _read(value, words, names)
    else:
        words.append(repr(value))


def _value(path: tuple[str, ...], captured: dict[str, Any], function: FunctionType) -> Any:
    """The value of a dotted name in a function, or of its longest part that has one.

    MISSING where a branch that was not taken would have set it, or where it is local to a part of the
    function. What other libraries hold goes by its name, unless it is a number: their version counts.
    """
    first, *rest = path
    try:
        value = captured[first].cell_contents if first in captured else _global(first, function)
    except ValueError:
        return MISSING
    for k, name in enumerate(rest):
        library = isinstance(value, ModuleType) and _in_library(value.__name__)
        value = getattr(value, name, value)
        if library and not isinstance(value, ATOMS):
            return ".".join((path[0], *rest[: k + 1]))
    return value


def _plain(value: Any, kinds: tuple[type, ...]) -> bool:
    """Whether a value is of one of these types, or of a library's subtype: no methods of a user's."""
    return isinstance(value, kinds) and (type(value) in kinds or _in_library(type(value).__module__))


@functools.cache
def _in_library(module: str) -> bool:
    """Whether a module is of Warp, NumPy or the standard library, not a user's of the same name."""
    root = module.partition(".")[0]
    if root in ("warp", "numpy"):
        return True
    if root not in sys.stdlib_module_names:
        return False
    spec = getattr(sys.modules.get(root), "__spec__", None)
    origin = "" if spec is None else spec.origin or ""
    outside = "site-packages" in origin or "dist-packages" in origin
    return origin in ("built-in", "frozen") or (origin.startswith(STANDARD) and not outside)


def _global(name: str, function: FunctionType) -> Any:
    return function.__globals__.get(name, getattr(builtins, name, MISSING))


def _code_text(code: CodeType) -> str:
    constants = (_code_text(c) if isinstance(c, CodeType) else repr(c) for c in code.co_consts)
    return repr((code.co_code, code.co_names, code.co_varnames, code.co_freevars, *constants))


def _code_names(code: CodeType) -> set[str]:
    inner = (c for c in code.co_consts if isinstance(c, CodeType))
    return {*code.co_names, *code.co_freevars}.union(*(_code_names(c) for c in inner))


def _hash(*parts: str | bytes) -> bytes:
    """Digest of a sequence of texts, each with its length."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(b"%d:" % len(data) + data)
    return digest.digest()
