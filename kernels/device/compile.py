"""Declaring kernels that are named after their code.

Warp 1.19 leaves functions reached through `wp.static(f[k])(...)` with a loop index k out of a module's
content hash, so two scenes, or two versions of this package, could share one cached binary. So a digest of
everything that determines a kernel's code (`digest.py`) goes into its name. The name says it all: Warp need
not translate a kernel, for seconds, to find the values of such expressions before it can look for it in its
cache, nor hash texts in which every comment counts.

On a CPU the compiler may fuse a b + c, divide by multiplying with a reciprocal and drop additions of zero: a
step costs a fifth less (docs/performance.md). It must not reassociate sums, which would undo the
compensation of log(1 + e). Functions are inlined up to more than twice the size that Warp asks for: a step's
parts lie near that limit, where a line more in a part that is seldom run cost all steps a twelfth.

The environment variable SLCP_CPU_FLAGS replaces all flags of the CPU's compiler, these and Warp's:
"-ffp-contract=off" rounds as a processor without fused operations does. Flags go into a
kernel's hash, so that caches do not mix; `.ci/full rounding` runs all tests that way. SLCP_STRIDES, where
set, has a CPU's kernels read all arrays by their strides, as a GPU's do. SLCP_CUDA_REGISTERS is
the number of registers that the fast kernels (`relay.py`) may take on a GPU, to be tried where one is.

For a GPU large programs are compiled with optimisation level 2, which leaves functions apart that 3 puts into
one another: minutes less, and about as fast where worlds differ (docs/performance.md). SLCP_CUDA_LEVEL=3
takes these minutes. A CPU's compiler has level 2 anyway, and Warp asks for 3 of what is small.
"""

import os
import re
from collections.abc import Callable
from typing import Any

import warp as wp
from warp._src.context import ModuleBuilder

from . import patches
from .digest import OpaqueError, content_digest, own_alone

CPU_ARITHMETIC = "-ffp-contract=fast -freciprocal-math -fno-signed-zeros"
INLINING = re.compile(r"(-inline(?:-cold-callsite)?-threshold=)\d+")
INLINED = r"\g<1>20000"
FAST_REGISTERS = 128  # of a thread: what spills for it costs less than more warps bring (docs/performance.md)
LEVELS, LARGE = ("1", "2", "3"), "2"
# C++ that a CPU's compiler makes less of: an array's element without a stride and without looking whether its
# index counts from the end; a loop over a range that is too large for two registers, in which the compiler
# loses sight of a step of one
PACKED = """
namespace wp {
template <typename T> inline T* address(const array_t<T>& a, int i) { return a.data + i; }
template <typename T> inline T* address(const array_t<T>& a, int i, int j)
{
    return data_at_byte_offset(a, i * stride(a, 0)) + j;
}
template <typename T> inline T* address(const array_t<T>& a, int i, int j, int k)
{
    return data_at_byte_offset(a, i * stride(a, 0) + j * stride(a, 1)) + k;
}
template <typename T> inline void array_store(const array_t<T>& a, int i, T value) { *address(a, i) = value; }
template <typename T> inline void array_store(const array_t<T>& a, int i, int j, T value)
{
    *address(a, i, j) = value;
}
template <typename T> inline void array_store(const array_t<T>& a, int i, int j, int k, T value)
{
    *address(a, i, j, k) = value;
}
struct wide_range_t : range_t { long long more; };
inline wide_range_t wide_range(int start, int end, int step)
{
    wide_range_t r;
    r.start = r.i = start;
    r.end = end;
    r.step = step;
    return r;
}
inline wide_range_t wide_range(int start, int end) { return wide_range(start, end, 1); }
inline wide_range_t wide_range(int end) { return wide_range(0, end, 1); }
}
#define range_t wide_range_t
#define range wide_range
"""
MOST_UNROLLED = 128  # passes of a loop whose adjoint is wanted: of loops that are not unrolled it is wrong


def cpu_compiler_flags() -> str:
    """Flags for the CPU's compiler: SLCP_CPU_FLAGS where set, else Warp's present ones and this package's."""
    given = os.environ.get("SLCP_CPU_FLAGS")
    if given is not None:
        return given
    flags = wp.config.cpu_compiler_flags
    return f"{'-march=native' if flags is None else INLINING.sub(INLINED, flags)} {CPU_ARITHMETIC}"


def large_options() -> dict[str, Any]:
    """Options of large programs: how far a GPU's compiler goes with them, where Warp is told nothing."""
    text = os.environ.get("SLCP_CUDA_LEVEL", LARGE).strip()
    if text not in LEVELS:
        raise ValueError(f"SLCP_CUDA_LEVEL is {text!r}; one of {', '.join(LEVELS)} is needed")
    level = {} if wp.config.optimization_level is not None else {"optimization_level": int(text)}
    return {"cpu_compiler_flags": cpu_compiler_flags()} | level


def specialised(function: Callable) -> wp.Kernel:
    """Decorator: a forward-only kernel with this package's arithmetic on a CPU, named after its code."""
    return named_by_code(cpu_compiler_flags=cpu_compiler_flags())(function)


def packed(function: Callable) -> wp.Kernel:
    """Decorator: as `specialised`; the kernel's arrays have no gaps along their last axis (`launch` looks).

    On a CPU an element is then found without a stride and without looking whether its index counts from the
    end: kernels whose state is in arrays take little more than half as long. A user's function may do either,
    so that a kernel that calls one is as `specialised` makes it. Not for loops over columns in which few call
    a function of the library: the compiler then calls it for all of them, in vectors.
    """
    return _packed(function)


def large(function: Callable) -> wp.Kernel:
    """Decorator: as `packed`; a program of some hundred functions, which a GPU's compiler leaves apart."""
    return _packed(function, options=large_options())


def of_any_scene(contacts: bool) -> Callable[[Callable], wp.Kernel]:
    """Decorator: as `packed`; kernels that serve any scene are `large` where they solve contacts."""
    return large if contacts else packed


def whole(pairs: int) -> Callable[[Callable], wp.Kernel]:
    """Decorator: as `specialised`; kernels with last resorts are `large` where several pairs may touch."""
    return named_by_code(**large_options()) if pairs > 1 else specialised


def fitted(fast: bool, pairs: int = 1) -> Callable[[Callable], wp.Kernel]:
    """Decorator: as `packed`; kernels that step all worlds, `fast` ones, have few registers on a GPU, others
    are `large` where several pairs may touch.
    """
    most = int(os.environ.get("SLCP_CUDA_REGISTERS", FAST_REGISTERS))
    if fast:
        return lambda function: _packed(function, most)
    return large if pairs > 1 else packed


def _packed(
    function: Callable, registers: int | None = None, options: dict[str, Any] | None = None
) -> wp.Kernel:
    own = own_alone(function) and not os.environ.get("SLCP_STRIDES")
    options = options or {"cpu_compiler_flags": cpu_compiler_flags()}
    kernel = _declare(function, options, registers=registers, preamble=PACKED if own else None)
    kernel.packed = own
    return kernel


def with_adjoint(function: Callable) -> wp.Kernel:
    """Decorator: a kernel with Warp's adjoint, whose loops of a fixed length are unrolled."""
    options = {
        "cpu_compiler_flags": cpu_compiler_flags(),
        "enable_backward": True,
        "max_unroll": MOST_UNROLLED,
    }
    return _declare(function, options, True)


def named_by_code(**options: Any) -> Callable[[Callable], wp.Kernel]:
    """Decorator: a forward-only kernel in a module of its own, named after its code.

    Args:
        options: Warp's options of the module.
    """
    return lambda function: _declare(function, options)


def _declare(
    function: Callable,
    options: dict[str, Any],
    backward: bool = False,
    registers: int | None = None,
    preamble: str | None = None,
) -> wp.Kernel:
    more: dict[str, Any] = {} if registers is None else {"most": registers}
    if preamble is not None:
        more["preamble"] = preamble
    digest = code_digest(function, **options, **more)
    if preamble is not None:
        options = options | {"extra_build_options": wp.ModuleBuildOptions(extra_cpu_preamble=preamble)}
    function.__qualname__ = f"{function.__name__}_{digest[:12]}"
    module = wp.get_module(f"{__package__}.{function.__qualname__}")
    wp.set_module_options(options, module)
    kernel = wp.kernel(function, module=module, enable_backward=backward, cuda_max_registers=registers)
    kernel.adj.content_digest = bytes.fromhex(digest)
    module.has_unresolved_static_expressions = False
    return kernel


def code_digest(function: Callable, **options: Any) -> str:
    """Digest of a kernel's code and of all that it calls, with the values of its `wp.static` expressions."""
    try:
        return content_digest(function, options)
    except OpaqueError:  # a user's function and an object of theirs: what Warp makes of it tells
        return _translated_digest(function, options)


def digest_of(*values: Any) -> str:
    """Digest of functions and other values; of what it cannot tell, the place in this process."""
    try:
        return content_digest(_nothing, values)
    except OpaqueError:
        return "at " + " ".join(f"{id(value):x}" for value in values)


def seen_by(make: Callable) -> str:
    """Digest of a function with the globals and enclosed values that it names; "" of what it cannot tell."""
    found = digest_of(make)
    return "" if found.startswith("at ") else found


def _nothing() -> None:
    """In place of a function, where values alone are told."""


def translate(function: Callable) -> None:
    """Have Warp translate a kernel's function and all that it calls, for its errors only."""
    module = type(wp.get_module(__name__))(function.__name__, None)
    wp.kernel(function, module=module, enable_backward=False)
    options = module.resolve_options(wp.config, block_dim=1) | {"output_arch": None, "block_dim": 1}
    ModuleBuilder(module, options, target="cpu")


def _translated_digest(function: Callable, options: dict[str, Any]) -> str:
    """As `code_digest`, from Warp's translation of the kernel, which takes seconds."""
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


patches.apply()
