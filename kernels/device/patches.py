"""Places where Warp 1.19 does more than it needs, done shorter.

All only save time. Another version of Warp is left as it is: kernels are then compiled again after an edit
of a comment, or where others with the same functions came first, and are translated for a third longer, all
of them anew; and the functions of structs that only adjoints need are compiled in kernels without one.
"""

import re
from typing import Any

import warp as wp
from warp._src import codegen
from warp._src.codegen import Adjoint
from warp._src.context import ModuleHasher
from warp._src.types import Reference

from . import translated


def apply() -> None:
    """Make the changes, once."""
    if wp.__version__.startswith("1.19.") and not hasattr(ModuleHasher.hash_adjoint, "shortened"):
        ModuleHasher.hash_adjoint = _hash_by_name(ModuleHasher.hash_adjoint)
        Adjoint.resolve_func = _resolve_once(Adjoint.resolve_func)
        translated.keep()
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


def _key(function: Any, arg_types: Any, min_outputs: Any) -> tuple | None:
    parts = [function, min_outputs]
    for kind in arg_types:
        plain = kind.value_type if isinstance(kind, Reference) else kind
        if not isinstance(plain, type):
            return None
        parts += [plain, plain is kind]
    return tuple(parts)
