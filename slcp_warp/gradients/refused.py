"""A loss of impulses or gaps, through which no gradient flows, is an error; in a graph the gradients are NaN.

Nothing waits for the device while a tape goes back: kernels look whether a loss asks for them, and their
answer is read once, when the last of a tape's backward passes is done. The replay of a graph reads nothing.
"""

import weakref
from collections.abc import Mapping
from typing import Any, NamedTuple

import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.gradients.refusal import make_refusal_kernel

from ..inputs.errors import ArgumentError

REFUSED = ("impulse", "gap")  # as the kernel's flags are


class _Read(NamedTuple):
    """The flags of a tape's backward passes on a device, and where on the tape they are read."""

    place: int
    read: Any
    flags: wp.array


_reads: "weakref.WeakKeyDictionary[wp.Tape, dict[str, _Read]]" = weakref.WeakKeyDictionary()


class Refused:
    """Outputs of one launch that collect what a loss asks of them, to be refused.

    Made before the launch's own backward pass is recorded, on the tape that records.
    """

    def __init__(self, tape: wp.Tape, outputs: Mapping[str, wp.array], device: Any) -> None:
        self.outputs, self.device = dict(outputs), wp.get_device(device)
        for array in self.outputs.values():
            array.requires_grad = True
        self.flags = _flags(tape, self.device) if self.outputs else None

    @property
    def arrays(self) -> list[wp.array]:
        """The outputs."""
        return list(self.outputs.values())

    def spoil(self, slopes: wp.array) -> None:
        """Make the gradients by the last states (B, nx) NaN where a loss asks for what there is not."""
        if self.flags is None:
            return
        none = wp.zeros((0, 0), dtype=slopes.dtype, device=self.device)
        asked = [none, none]
        for name, array in self.outputs.items():
            asked[REFUSED.index(name)] = array.grad.reshape((array.shape[0], -1))
        launch(make_refusal_kernel(slopes.dtype), slopes.shape[0], [*asked, slopes, self.flags], self.device)


def _flags(tape: wp.Tape, device: wp.Device) -> wp.array:
    """The flags of a tape, which are read at the end of its backward pass."""
    found = _reads.setdefault(tape, {})
    known = found.get(device.alias)
    if known is not None and known.place < len(tape.launches) and tape.launches[known.place] is known.read:
        return known.flags
    flags: wp.array = wp.zeros(len(REFUSED), dtype=wp.int32, device=device)

    def read() -> None:
        if device.is_capturing:
            return
        names = [name for name, asked in zip(REFUSED, flags.numpy()) if asked]
        if names:
            flags.zero_()
            raise ArgumentError(
                f"the loss depends on {names[0]}, through which no gradient flows; use the states"
            )

    found[device.alias] = _Read(len(tape.launches), read, flags)
    tape.record_func(read, arrays=[])
    return flags
