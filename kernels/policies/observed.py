"""A policy that sees something of the state instead of all of it."""

from functools import partial
from typing import Any, NamedTuple

import warp as wp

from ..device.compile import digest_of, specialised, translate
from ..factories import cached
from .contract import PolicyFunctions, PolicyKernel, make_policy
from .function import made_of


class Seen(NamedTuple):
    """How many numbers a policy sees; a user's function of the state, or its maker, or None: components."""

    size: int
    function: Any = None


def observed_kernel(inner: PolicyKernel, seen: Seen) -> PolicyKernel:
    """The kernel of a policy that sees so much."""
    own = "" if seen.function is None else f" by {digest_of(seen.function)}"
    key = f"{inner.in_words}, which sees {seen.size} numbers:{own}{inner.key}"
    return PolicyKernel(key, partial(make_observed, inner, seen), inner, apart=inner.apart)


@cached
def make_observed(inner: PolicyKernel, seen: Seen, nx: int, nu: int, dtype: type) -> PolicyFunctions:
    """Kept is the policy's memory."""
    asked = make_policy(inner, seen.size, nu, dtype)
    Inner, size = asked.Struct, asked.size
    VX, VY = wp.types.vector(nx, dtype), wp.types.vector(seen.size, dtype)
    Memory = wp.types.vector(max(size, 1), dtype)
    function = made_of("observation", seen.function, [dtype, VX, VY])

    @wp.struct
    class Observed:
        inner: Inner
        places: wp.array(dtype=wp.int32)  # (size,) of the components

    @wp.func
    def observe(data: Observed, x: VX):
        y = VY()
        if wp.static(function is None):
            for j in range(wp.static(seen.size)):
                y[j] = x[data.places[j]]
        else:
            y = function(x)
        return y

    @wp.func
    def start(data: Observed, world: int, x: VX):
        return asked.begin(data.inner, world, observe(data, x))

    @wp.func
    def alone(data: Observed, world: int, step: int, x: VX):
        u, _memory = asked.ask(data.inner, world, step, observe(data, x), Memory())
        return u

    @wp.func
    def remembering(data: Observed, world: int, step: int, x: VX, memory: Memory):
        u, after = asked.ask(data.inner, world, step, observe(data, x), memory)
        return u, after

    if size == 0:
        return PolicyFunctions(Observed, alone)
    return PolicyFunctions(Observed, remembering, size, start)


@cached
def seen_function(seen: Seen, nx: int, dtype: type) -> wp.Function:
    """A user's function of the state, or an error where it is none: it is translated on its own."""
    VX, VY = wp.types.vector(nx, dtype), wp.types.vector(seen.size, dtype)
    function = made_of("observation", seen.function, [dtype, VX, VY])

    @wp.func
    def first(y: VY):
        return y[0]

    def shown(x: VX, out: wp.array(dtype=dtype)):
        out[0] = first(function(x))

    translate(shown)
    return function


@cached
def make_observation_kernel(seen: Seen, nx: int, dtype: type) -> wp.Kernel:
    """What a user's function shows of many states."""
    VX, VY = wp.types.vector(nx, dtype), wp.types.vector(seen.size, dtype)
    function = made_of("observation", seen.function, [dtype, VX, VY])

    @specialised
    def observation_kernel(
        first: int,
        state: wp.array2d(dtype=dtype),  # (B, nx)
        shown: wp.array2d(dtype=dtype),  # out (B, size)
    ):
        i = first + wp.tid()
        x = VX()
        for j in range(nx):
            x[j] = state[i, j]
        y = function(x)
        for j in range(wp.static(seen.size)):
            shown[i, j] = y[j]

    return observation_kernel
