"""What a policy is to the kernels that step: u = control(data, world, step, x), by whatever the user likes.

A kernel that asks a policy is made for its `PolicyKernel`. Numbers travel in the policy's struct; what
changes code (sizes of layers, a user's function) makes another key, and with it another kernel.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, NamedTuple

import warp as wp

from ..factories import cached


class PolicyFunctions(NamedTuple):
    """A policy for one size and dtype.

    control(data, world, step, x) -> u; with memory: control(data, world, step, x, memory) -> (u, memory), and
    start(data, world, x) -> memory before the first step (None: zeros). `data` is a Struct, `x` a vector of
    nx, `u` one of max(nu, 1), what is remembered one of that many numbers.
    """

    Struct: Any
    control: wp.Function
    memory: int = 0
    start: wp.Function | None = None


@dataclass(frozen=True)
class PolicyKernel:
    """A kind of policy: equal keys mean equal code.

    Attributes:
        key: of the code that `make` gives: words, and where these are not all, a colon and a digest.
        make: ``make(nx, nu, dtype) -> PolicyFunctions``.
        inner: of the policy in this one, whose struct is the field `inner`.
        by_row: whether it is asked with a world's row of the launch where worlds have numbers.
        apart: whether it takes as long as a step and few registers: on a GPU a kernel of its own asks it.
        timed: whether worlds have delays and holds of their own, in place of those of its struct.
    """

    key: str
    make: Callable[[int, int, type], PolicyFunctions] = field(compare=False, repr=False)
    inner: "PolicyKernel | None" = field(default=None, compare=False, repr=False)
    by_row: bool = field(default=False, compare=False, repr=False)
    apart: bool = field(default=False, compare=False, repr=False)
    timed: bool = field(default=False, compare=False, repr=False)

    @property
    def in_words(self) -> str:
        """The key without a digest at its end."""
        return self.key.partition(":")[0].replace("_", " ")

    def functions(self, nx: int, nu: int, dtype: type) -> PolicyFunctions:
        """For a size and dtype, made once."""
        return _functions(self, nx, nu, dtype)


@cached
def _functions(kernel: PolicyKernel, nx: int, nu: int, dtype: type) -> PolicyFunctions:
    return kernel.make(nx, nu, dtype)


@cached
def make_policy(kernel: PolicyKernel, nx: int, nu: int, dtype: type) -> SimpleNamespace:
    """A policy as kernels ask it, the same with memory or without: Struct, the memory's `size`, functions.

    begin(data, world, x) -> memory, ask(data, world, step, x, memory) -> (u, memory); for launches of single
    steps recall(data, kept, row, world, step, x) -> memory, where step 0 begins, and keep(kept, row, memory).
    Of a timed policy of_row(data, timing, row, h) is the struct with a row's delay and hold [s], in steps h.
    """
    functions = kernel.functions(nx, nu, dtype)
    Struct, size = functions.Struct, functions.memory
    VX, Memory = wp.types.vector(nx, dtype), wp.types.vector(max(size, 1), dtype)
    control, start = functions.control, functions.start
    starts = size > 0 and start is not None

    @wp.func
    def begin(data: Struct, world: int, x: VX):
        memory = Memory()
        if wp.static(starts):
            memory = start(data, world, x)
        return memory

    @wp.func
    def ask(data: Struct, world: int, step: int, x: VX, memory: Memory):
        after = memory
        if wp.static(size > 0):
            u, after = control(data, world, step, x, memory)
        else:
            u = control(data, world, step, x)
        return u, after

    @wp.func
    def recall(data: Struct, kept: wp.array2d(dtype=dtype), row: int, world: int, step: int, x: VX):
        memory = Memory()
        if wp.static(size > 0):
            if step == 0:
                memory = begin(data, world, x)
            else:
                for j in range(size):
                    memory[j] = kept[row, j]
        return memory

    @wp.func
    def keep(kept: wp.array2d(dtype=dtype), row: int, memory: Memory):
        for j in range(size):
            kept[row, j] = memory[j]

    out = SimpleNamespace(Struct=Struct, size=size, begin=begin, ask=ask, recall=recall, keep=keep)
    if kernel.timed:

        @wp.func
        def of_row(data: Struct, timing: wp.array3d(dtype=wp.float64), row: int, h: wp.float64):
            own = data
            if timing.shape[0] > 0:
                own.delay = int(wp.floor(timing[row, 0, 0] / h + wp.float64(0.5)))
                own.hold = wp.max(1, int(wp.floor(timing[row, 0, 1] / h + wp.float64(0.5))))
            return own

        out.of_row = of_row
    return out
