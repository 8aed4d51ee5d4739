"""Places where Warp 1.19 does more than it needs, done shorter.

All only save time. Another version of Warp is left as it is: kernels are then compiled again after an edit
of a comment, or where others with the same functions came first, and are translated twice as long, all
of them anew; the functions of structs that only adjoints need are compiled in kernels without one, and
Warp's whole header in all.
"""

import re
from typing import Any

import warp as wp
from warp._src import build, codegen, types
from warp._src.codegen import Adjoint, Var
from warp._src.context import ModuleHasher
from warp._src.types import Reference

from . import header, translated


def apply() -> None:
    """Make the changes, once."""
    if wp.__version__.startswith("1.19.") and not hasattr(ModuleHasher.hash_adjoint, "shortened"):
        ModuleHasher.hash_adjoint = _hash_by_name(ModuleHasher.hash_adjoint)
        Adjoint.resolve_func = _resolve_once(Adjoint.resolve_func)
        _know_plain_types()
        translated.keep()
        build.build_cpu = header.with_needed_header(build.build_cpu)
        codegen.struct_template = re.sub(
            "^CUDA_CALLABLE", "static CUDA_CALLABLE", codegen.struct_template, flags=re.M
        )


def _hash_by_name(by_source: Any) -> Any:
    """A kernel that is named after its code goes into its module's hash by that digest alone."""

    def hash_adjoint(hasher: Any, adjoint: Any) -> bytes:
        digest = getattr(adjoint, "content_digest", None)
        if digest is None:
            return by_source(hasher, adjoint)
        adjoint.get_references()  # also finds how many indices `wp.tid()` has
        return digest

    hash_adjoint.shortened = True
    return hash_adjoint


def _resolve_once(resolve: Any) -> Any:
    """Which of a built-in function's overloads takes some types is looked up once, not for every call.

    Kept for arguments by position that are plain types, or references to them: scalars, vectors, matrices.
    """
    known: dict[tuple, Any] = {}

    def resolve_func(adjoint: Any, function: Any, arg_types: Any, kwarg_types: Any, min_outputs: Any) -> Any:
        key = None if kwarg_types or not function.is_builtin() else _key(function, arg_types, min_outputs)
        if key is None:
            return resolve(adjoint, function, arg_types, kwarg_types, min_outputs)
        if key not in known:
            known[key] = resolve(adjoint, function, arg_types, kwarg_types, min_outputs)
        return known[key]

    return resolve_func


def _know_plain_types() -> None:
    """Types of scalars, vectors and matrices are told by one look, before all else that may be asked."""
    of_any, value_of_any, strip_any, name_any = (
        codegen.get_arg_type,
        codegen.get_arg_value,
        codegen.strip_reference,
        Var.type_to_ctype,
    )
    names: dict[type, str] = {}

    def get_arg_type(arg: Any) -> Any:
        kind = strip_reference(arg.type) if arg.__class__ is Var else arg
        return kind if isinstance(kind, type) else of_any(arg)

    def get_arg_value(arg: Any) -> Any:
        if arg.__class__ is Var and isinstance(arg.type, type):
            return arg if arg.constant is None else arg.constant
        return value_of_any(arg)

    def strip_reference(arg: Any) -> Any:
        if arg.__class__ is Reference:
            return arg.value_type
        return arg if arg.__class__ is Var or isinstance(arg, type) else strip_any(arg)

    def type_to_ctype(kind: Any, value_type: bool = False) -> str:
        if not isinstance(kind, type):
            return name_any(kind, value_type)
        if kind not in names:
            names[kind] = name_any(kind, value_type)
        return names[kind]

    codegen.get_arg_type, codegen.get_arg_value = get_arg_type, get_arg_value
    codegen.strip_reference = types.strip_reference = strip_reference
    Var.type_to_ctype = staticmethod(type_to_ctype)


def _key(function: Any, arg_types: Any, min_outputs: Any) -> tuple | None:
    parts = [function, min_outputs]
    for kind in arg_types:
        plain = kind.value_type if isinstance(kind, Reference) else kind
        if not isinstance(plain, type):
            return None
        parts += [plain, plain is kind]
    return tuple(parts)
