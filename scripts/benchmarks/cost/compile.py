"""`slcp bench compile`: where the CPU time of a cold compile goes.

Making is what the package does to declare a kernel: its functions, and the digest that names it. Translating
is Warp's Python, from syntax trees to C++; compiling is clang. A first kernel for each set of compiler flags
also pays for Warp's precompiled header.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer
import warp as wp
from warp._src import build
from warp._src.context import Module

import slcp_warp as slcp

from ...stages.ahead import WHAT, compile_ahead
from ...support.simulators import default_scaling
from ..shared.machine import machine
from ..shared.timing import Rows

KINDS = ("step", "rollout", "linearize", "second", "gradient")


@contextmanager
def _timed(owner: Any, name: str, spent: dict[str, float], part: str) -> Iterator[None]:
    """Add the CPU time of every call of a function to a part."""
    function: Callable[..., Any] = getattr(owner, name)

    def run(*args: Any, **kwargs: Any) -> Any:
        begin = time.process_time()
        try:
            return function(*args, **kwargs)
        finally:
            spent[part] += time.process_time() - begin

    setattr(owner, name, run)
    try:
        yield
    finally:
        setattr(owner, name, function)


def bench_compile(scene: slcp.Scene, dtype: str = "float64") -> Rows:
    """CPU seconds of the parts of a cold compile, of a scene's kernels and of the generic ones."""
    rows: Rows = []
    folder = wp.config.kernel_cache_dir
    with tempfile.TemporaryDirectory() as empty:
        wp.config.kernel_cache_dir = empty
        try:
            for strategy, kinds in (("specialised", KINDS), ("generic", KINDS[:2])):
                for kind in kinds:
                    rows.append(_compiled(scene, dtype, strategy, kind))
        finally:
            wp.config.kernel_cache_dir = folder
    return rows


def _compiled(scene: slcp.Scene, dtype: str, strategy: str, kind: str) -> dict[str, Any]:
    assert kind in WHAT
    options = slcp.Options(scaling=default_scaling(scene))
    spent = {"translate": 0.0, "compile": 0.0}
    begin = time.process_time()
    sim = slcp.Simulator(scene, options, device="cpu", dtype=dtype, strategy=strategy)
    with (
        _timed(Module, "_run_codegen", spent, "translate"),
        _timed(build, "build_cpu", spent, "compile"),
    ):
        kernels = compile_ahead(lambda dtype: sim, [kind]).kernels
    whole = time.process_time() - begin
    seconds = {"make": whole - sum(spent.values()), **spent, "all": whole}
    names = "; ".join(kernel.kernel for kernel in kernels if kernel.compiled)
    typer.echo(f"{names}: " + ", ".join(f"{part} {value:.2f}" for part, value in seconds.items()))
    row = {"benchmark": "compile", "scene": scene.name, "dtype": dtype, "strategy": strategy, "kind": kind}
    return row | {f"{part}_seconds": value for part, value in seconds.items()} | machine()
