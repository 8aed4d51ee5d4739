"""Launches that hand worlds on: a fast kernel makes the steps that it can, a full one those that it leaves.

The fast kernel stops a world at a step that it does not finish, and the full one makes this step; the fast
one goes on from there. Who waits for the next launch stands in a queue on the device, so that no number comes
back to the host in between, and the launches of a span of steps are the same whatever its worlds do: all
worlds, those that wait (full, one step), those that are left (fast), the full kernel with GROWTH times as
many steps, and so on, until the full kernel makes all steps of a span. So a world whose every step is hard
costs a few fast steps more than with the full kernel alone, and rounds are few.

Which kernel makes a step of a world depends on this world and the span alone: results are the same, bit for
bit, in every batch and order, and on any number of threads. They differ from those of one full kernel by the
rounding of two programs.
"""

from collections.abc import Callable, Sequence
from typing import Any

import warp as wp

from .launch import DEFAULT_GRAIN, Prepared, together

SPAN = 16  # steps in which a world is left to the full kernel once or not at all, mostly
GROWTH = 4


@wp.struct
class Relay:
    """Who makes which step next; row slot mod 2 of the queue holds who waits for launch `slot` of a span."""

    next: wp.array(dtype=wp.int32)  # (B,) step
    queue: wp.array2d(dtype=wp.int32)  # (2, B)
    waiting: wp.array(dtype=wp.int32)  # how many, by slot; slot 0 takes all worlds
    left: wp.array(dtype=wp.int32)  # (B,) steps that the fast kernel left to the full one


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return atomicAdd(&waiting.data[slot], 1);
#else
    return __atomic_fetch_add(&waiting.data[slot], 1, __ATOMIC_RELAXED);
#endif
""")
def join(waiting: wp.array(dtype=wp.int32), slot: int) -> int:
    """A place in a queue; on a CPU, too, one at a time, which Warp's own additions are not."""
    ...


@wp.func
def taken(relay: Relay, slot: int, item: int):
    """The world of an item of a launch, -1 where there is none."""
    if slot == 0:
        return item
    if item < relay.waiting[slot]:
        return relay.queue[slot % 2, item]
    return int(-1)


@wp.func
def hand_on(relay: Relay, slot: int, world: int):
    """Have a world of launch `slot` wait for the next one."""
    if slot % 2 == 0:
        relay.left[world] += 1
    place = join(relay.waiting, slot + 1)
    relay.queue[(slot + 1) % 2, place] = world


def rounds(span: int) -> list[int]:
    """Steps that the full kernel makes at most in its launches of a span: 1, 4, .., span."""
    most = [1]
    while most[-1] < span:
        most.append(min(GROWTH * most[-1], span))
    return most


class Run:
    """All steps of all worlds, however often it is called.

    Args:
        fast, full: kernels of (first, slot, last, most, relay, *inputs), which make steps from `relay.next`
            on, before `last`, and at most so many; `next` is `last` or more where they are done with a world.
        worlds: B.
        steps: of a world, at most.
        inputs: of both kernels.
        device: of the arrays.
        grain: worlds of a launch that are worth a thread.
        span: steps between two launches of all worlds; None: SPAN.
        before: what is launched before the span that begins with a step.

    Attributes:
        relay: its struct.
    """

    def __init__(
        self,
        fast: wp.Kernel,
        full: wp.Kernel,
        worlds: int,
        steps: int,
        inputs: Sequence[Any],
        device: Any,
        grain: int = DEFAULT_GRAIN,
        span: int | None = None,
        before: Callable[[int], None] | None = None,
    ) -> None:
        self._device, self._steps = wp.get_device(device), steps
        self._span = max(1, min(SPAN if span is None else span, steps))
        self._before = before
        self._most, self.relay = rounds(self._span), Relay()
        for name in ("next", "left"):
            setattr(self.relay, name, wp.zeros(worlds, dtype=wp.int32, device=device))
        self.relay.queue = wp.empty((2, worlds), dtype=wp.int32, device=device)
        self.relay.waiting = wp.zeros(2 * len(self._most) + 1, dtype=wp.int32, device=device)
        given = [0, 0, 0, self.relay, *inputs]
        with together():
            self._launches = [Prepared(kernel, worlds, given, device, grain=grain) for kernel in (fast, full)]

    def __call__(self) -> wp.array:
        """Make them; how often each world was left to the full kernel, (B,)."""
        self.relay.next.zero_()
        self.relay.left.zero_()
        for first in range(0, self._steps, self._span):
            if self._before is not None:
                self._before(first)
            self._make_span(min(first + self._span, self._steps))
        return self.relay.left

    def _make_span(self, last: int) -> None:
        look = self._device.is_cpu and not self._device.is_capturing
        waiting = self.relay.waiting
        waiting.zero_()
        for slot in range(2 * len(self._most)):
            if look and slot and not waiting.numpy()[slot]:
                return
            most = self._most[slot // 2] if slot % 2 else self._span
            launch = self._launches[slot % 2]
            for place, value in enumerate((slot, last, most)):
                launch.set_input(place, value)
            launch()
