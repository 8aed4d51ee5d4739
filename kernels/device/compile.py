"""Declaring specialised kernels.

Warp 1.19 leaves functions reached through `wp.static(f[k])(...)` with a loop index k out of a module's
content hash, so two scenes, or two versions of this package, could share one cached binary. `specialised`
puts the specialisation and a digest of this package's sources into the kernel's name, and with it into the
hash.

To find the values of such expressions Warp translates a kernel, for seconds, before it can look for it in its
cache. The name determines the code, so it is told not to: a program that finds its kernels there starts their
work at once.

On a CPU the compiler may fuse a b + c, divide by multiplying with a reciprocal and drop additions of zero: a
step costs a fifth less (docs/understand/performance.md). It must not reassociate sums, which would undo the
compensation of log(1 + e). Functions are inlined up to more than twice the size that Warp asks for: a step's
parts lie near that limit, where a line more in a part that is seldom run cost all steps a twelfth.

The environment variable SLCP_CPU_FLAGS replaces all flags of the CPU's compiler, these and Warp's:
"-march=x86-64-v2 -ffp-contract=off" rounds as a processor without fused operations does. Flags go into a
kernel's hash, so that caches do not mix; `.ci/full rounding` runs all tests that way.
"""

import hashlib
import os
import pathlib
import re
from collections.abc import Callable
from typing import Any

import warp as wp

from ..factories import cached

CPU_ARITHMETIC = "-ffp-contract=fast -freciprocal-math -fno-signed-zeros"
INLINING = re.compile(r"(-inline(?:-cold-callsite)?-threshold=)\d+")
INLINED = r"\g<1>20000"


def cpu_compiler_flags() -> str:
    """Flags for the CPU's compiler: SLCP_CPU_FLAGS where set, else Warp's present ones and this package's."""
    given = os.environ.get("SLCP_CPU_FLAGS")
    if given is not None:
        return given
    flags = wp.config.cpu_compiler_flags
    return f"{'-march=native' if flags is None else INLINING.sub(INLINED, flags)} {CPU_ARITHMETIC}"


@cached
def source_digest() -> str:
    """Digest of every source file of the kernels."""
    digest = hashlib.sha256()
    for path in sorted(pathlib.Path(__file__).parents[1].rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def specialised(*key: Any) -> Callable[[Callable], wp.Kernel]:
    """Decorator: a forward-only kernel in a module of its own, named after the values it was specialised on.

    Args:
        key: everything the kernel's factory was called with; each value needs a repr that determines it
            (`code_digest` of a user's functions).
    """
    text = "|".join(k.__name__ if isinstance(k, type) else repr(k) for k in key) + source_digest()
    tag = hashlib.sha256(text.encode()).hexdigest()[:12]

    return lambda function: _declare(function, tag, {"cpu_compiler_flags": cpu_compiler_flags()})


def named_by_code(**options: Any) -> Callable[[Callable], wp.Kernel]:
    """Decorator: a forward-only kernel in a module of its own, named after its code (`code_digest`).

    For kernels that call functions of a user's. Warp by itself does not see values of `wp.static` in loops of
    these, and would take one cost's kernel for another's.

    Args:
        options: Warp's options of the module.
    """
    return lambda function: _declare(function, code_digest(function, **options)[:12], options)


def _declare(function: Callable, tag: str, options: dict[str, Any]) -> wp.Kernel:
    function.__qualname__ = f"{function.__name__}_{tag}"
    module = wp.get_module(f"{__package__}.{function.__qualname__}")
    wp.set_module_options(options, module)
    kernel = wp.kernel(function, module=module, enable_backward=False)
    _forget(kernel.adj, set())
    module.has_unresolved_static_expressions = False
    module.get_module_hash()
    return kernel


def code_digest(function: Callable, **options: Any) -> str:
    """Digest of a kernel's code and of all that it calls, with the values of its `wp.static` expressions."""
    module = type(wp.get_module(__name__))(function.__name__, None)
    module.options.update(options)
    kernel = wp.kernel(function, module=module, enable_backward=False)
    _forget(kernel.adj, set())
    module.has_unresolved_static_expressions = True  # also those of functions, of which Warp does not ask
    return module.get_module_hash().hex()


def _forget(adjoint: Any, seen: set[int]) -> None:
    """Drop what earlier translations left behind in shared functions: it would go into the hash."""
    if id(adjoint) in seen:
        return
    seen.add(id(adjoint))
    adjoint.deferred_static_expressions = []
    _, _, called = adjoint.get_references()
    static = (v for v in adjoint.resolved_static_expressions.values() if isinstance(v, wp.Function))
    for function in (*called, *static):
        if not function.is_builtin():
            for overload in function.user_overloads.values():
                _forget(overload.adj, seen)
