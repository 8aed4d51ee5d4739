"""Declaring specialised kernels.

Warp 1.19 leaves functions reached through `wp.static(f[k])(...)` with a loop index k out of a module's
content hash, so two scenes, or two versions of this package, could share one cached binary. `specialised`
puts the specialisation and a digest of this package's sources into the kernel's name, and with it into the
hash.

On a CPU the compiler may fuse a b + c, divide by multiplying with a reciprocal and drop additions of zero: a
step costs a fifth less (docs/performance.md). It must not reassociate sums, which would undo the
compensation of log(1 + e).
"""

import functools
import hashlib
import pathlib
from collections.abc import Callable
from typing import Any

import warp as wp

CPU_ARITHMETIC = "-ffp-contract=fast -freciprocal-math -fno-signed-zeros"


def cpu_compiler_flags() -> str:
    """Warp's present flags for the CPU's compiler and this package's."""
    flags = wp.config.cpu_compiler_flags
    return f"{'-march=native' if flags is None else flags} {CPU_ARITHMETIC}"


@functools.cache
def source_digest() -> str:
    """Digest of every source file of the kernels."""
    digest = hashlib.sha256()
    for path in sorted(pathlib.Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def specialised(*key: Any) -> Callable[[Callable], wp.Kernel]:
    """Decorator: a forward-only kernel in a module of its own, named after the values it was specialised on.

    Args:
        key: everything the kernel's factory was called with; each value needs a repr that determines it.
    """
    text = "|".join(k.__name__ if isinstance(k, type) else repr(k) for k in key) + source_digest()
    tag = hashlib.sha256(text.encode()).hexdigest()[:12]

    def declare(function: Callable) -> wp.Kernel:
        function.__qualname__ = f"{function.__name__}_{tag}"
        options = {"cpu_compiler_flags": cpu_compiler_flags()}
        return wp.kernel(function, module="unique", enable_backward=False, module_options=options)

    return declare
