"""A function of this package is translated once for all the kernels that call it.

Warp 1.19 makes C++ of every function that a kernel calls anew for each kernel: of a rollout that is compiled
after a step, nine tenths are what it made before. A function's translation is kept, with its C++, as long as
the digest of the function and of all that it calls (`digest.py`), Warp's options and the target are the same.
Users' functions, whose names may come to mean something else, and what calls `wp.grad` are always translated.
"""

from typing import Any, NamedTuple

from warp._src import codegen
from warp._src.context import Function, ModuleBuilder

COMPILERS = ("cpu_compiler_flags", "extra_cpu_preamble", "optimization_level")  # options of its own


class Kept(NamedTuple):
    """What a translation was made for, the structs that it names, and its C++ (once asked for)."""

    key: tuple
    structs: tuple
    code: list[str]


def keep() -> None:
    """Have Warp keep translations."""
    build_struct = ModuleBuilder.build_struct_recursive
    named: list[dict] = []  # structs, of each function that is being translated

    def build_struct_recursive(builder: Any, struct: Any) -> None:
        if named:
            named[-1][struct] = None
        build_struct(builder, struct)

    ModuleBuilder.build_struct_recursive = build_struct_recursive
    codegen.Adjoint.build = _translating(codegen.Adjoint.build)
    Function.build = _keeping(Function.build, named)
    codegen.codegen_func = _written_once(codegen.codegen_func)


def _translating(translate: Any) -> Any:
    def build(adjoint: Any, *arguments: Any, **named: Any) -> None:
        adjoint.kept = None
        translate(adjoint, *arguments, **named)

    return build


def _keeping(translate: Any, named: list[dict]) -> Any:
    def build(function: Any, builder: Any, *arguments: Any) -> None:
        adjoint, key = function.adj, _key(function, builder)
        kept = getattr(adjoint, "kept", None)
        if key is None or kept is None or kept.key != key:
            named.append({})
            try:
                translate(function, builder, *arguments)
            finally:
                structs = named.pop()
            # Warp does not list what `wp.grad` is asked of among the functions called
            if key is not None and not adjoint.uses_grad_call:
                adjoint.kept = Kept(key, tuple(structs), [])
            return
        for struct in kept.structs:
            builder.build_struct_recursive(struct)
        for called in adjoint.called_user_functions:
            if called not in builder.functions:
                builder.build_function(called)
                adjoints = called.custom_grad_func, called.custom_replay_func
                builder.deferred_functions.extend(own for own in adjoints if own)

    return build


def _key(function: Any, builder: Any) -> tuple | None:
    """What a function's translation depends on; None if it is not to be kept."""
    digest = getattr(function.adj, "code_digest", None)
    if digest is None or builder is None or builder.target is None:
        return None
    if function.adj.force_adjoint_codegen or function.adj.custom_reverse_mode:
        return None
    options = sorted((name, repr(value)) for name, value in builder.options.items() if name not in COMPILERS)
    return digest, builder.target, *options


def _written_once(write: Any) -> Any:
    def codegen_func(adjoint: Any, *arguments: Any, forward_only: bool = False, **options: Any) -> str:
        kept = getattr(adjoint, "kept", None)
        if kept is None or not forward_only:
            return write(adjoint, *arguments, forward_only=forward_only, **options)
        if not kept.code:
            kept.code.append(write(adjoint, *arguments, forward_only=True, **options))
        return kept.code[0]

    return codegen_func
