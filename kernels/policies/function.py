"""A user's own function as a policy."""

from typing import Any

import warp as wp

from ..device.compile import digest_of, translate
from ..factories import cached
from .contract import PolicyFunctions, PolicyKernel

Fields = tuple[tuple[str, int, Any], ...]  # name, axes, and wp.int32 or None for the simulator's dtype
ARRAYS = (None, wp.array, wp.array2d, wp.array3d, wp.array4d)


@cached
def make_data(fields: Fields, dtype: type) -> Any:
    """Struct of a user's numbers and arrays."""
    kinds = {
        name: (own or dtype) if axes == 0 else ARRAYS[axes](dtype=own or dtype) for name, axes, own in fields
    }
    return wp.struct(type("Data", (), {"__annotations__": kinds}))


def function_kernel(control: Any, start: Any, memory: int, fields: Fields, name: str) -> PolicyKernel:
    """The kernel of a user's control, and of the start of its memory.

    Args:
        control: a Warp function, see `contract.PolicyFunctions`, or a maker of one,
            ``make(dtype, VX, VU, Data)``, with memory ``make(dtype, VX, VU, Data, Memory)``.
        start: the same, or None.
        memory: numbers that it keeps from step to step.
        fields: of its struct.
        name: for people.
    """

    def make(nx: int, nu: int, dtype: type) -> PolicyFunctions:
        Data = make_data(fields, dtype)
        types = [dtype, wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype), Data]
        if memory:
            types.append(wp.types.vector(memory, dtype))
        functions = [made_of("control", control, types), made_of("start", start, types)]
        check(functions[0], functions[1], types)
        return PolicyFunctions(Data, functions[0], memory, functions[1])

    return PolicyKernel(f"function {name}:{digest_of(control, start, memory, fields)}", make)


def made_of(name: str, given: Any, types: list[Any]) -> Any:
    """The Warp function itself, or what a maker makes; TypeError for anything else."""
    if given is None or isinstance(given, wp.Function):
        return given
    function = given(*types)
    if not isinstance(function, wp.Function):
        raise TypeError(f"{name} made a {type(function).__name__}; a Warp function (@wp.func) is needed")
    return function


def check(control: wp.Function, start: Any, types: list[Any]) -> None:
    """An error where the functions are no policy: they are translated on their own, in milliseconds."""
    dtype, VX, VU, Data, *memory = types
    Memory = memory[0] if memory else VU
    starts = start is not None

    @wp.func
    def as_control(u: VU):
        return u[0]

    @wp.func
    def as_memory(memory: Memory):
        return memory[0]

    def asked(data: Data, x: VX, out: wp.array(dtype=dtype)):
        if wp.static(len(memory) > 0):
            kept = Memory()
            if wp.static(starts):
                kept = start(data, 0, x)
                out[1] = as_memory(kept)
            u, after = control(data, 0, 0, x, kept)
            out[0] = as_control(u) + as_memory(after)
        else:
            u = control(data, 0, 0, x)
            out[0] = as_control(u)

    translate(asked)
