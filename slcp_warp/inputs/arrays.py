"""Arrays of NumPy, torch, JAX and Warp at the door: one clear error for bad input, out as they came in."""

import math
import sys
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import warp as wp

from . import checks, streams
from .checks import numeric, shown
from .errors import ArgumentError

Array: TypeAlias = Any
"""An array of NumPy, torch, JAX or Warp: results are of the kind that the caller's arguments were."""


class ArrayError(ArgumentError):
    """An array of the wrong kind, shape or dtype; the message names it, what came and what is needed."""


@dataclass(frozen=True)
class Batch:
    """An argument on the device: `array` has the batch axis; `batched` tells whether the caller gave one."""

    array: wp.array
    kind: str
    batched: bool

    @property
    def worlds(self) -> int:
        """Length of the batch axis."""
        return int(self.array.shape[0])

    def give(self, array: wp.array) -> Array:
        """A result in the kind of this argument, with a batch axis if this one had it."""
        return from_batch(array, self.kind, self.batched)


def zeros(shape: tuple[int, ...], dtype: Any, device: Any) -> wp.array:
    """A zeroed array; an ArgumentError instead of one that cannot fit into the device's memory."""
    if math.prod(shape) > checks.FEW:
        size = wp.types.type_size_in_bytes(dtype)
        checks.memory(f"an array {shape}", math.prod(shape), size, device)
    return wp.zeros(shape, dtype=dtype, device=device)


def kind_of(value: Any) -> str:
    """Return "warp", "torch", "jax" or "numpy"."""
    if type(value) is np.ndarray:
        return "numpy"
    if isinstance(value, wp.array):
        return "warp"
    for library, kind in (("torch", "Tensor"), ("jax", "Array")):
        if isinstance(value, getattr(sys.modules.get(library), kind, ())):
            return library
    return "numpy"


def device_of(value: Any) -> str | None:
    """The device that an array is on, as Warp names it; None where NumPy or a user chooses none."""
    kind = kind_of(value)
    if kind == "jax":
        return str(wp.device_from_jax(min(value.devices(), key=lambda device: device.id)))
    return None if kind == "numpy" else str(value.device)


def to_numpy(array: Array) -> np.ndarray:
    """An array of any of the kinds as a NumPy array."""
    kind = kind_of(array)
    if kind == "torch":
        return np.asarray(array.detach().cpu().numpy())
    return np.asarray(array.numpy() if kind == "warp" else array)


def to_batch(name: str, value: Any, shape: tuple[int | str, ...], dtype: Any, device: Any) -> Batch:
    """Put an argument on the device with a leading batch axis.

    Args:
        name: the argument's name, for errors.
        shape: expected shape without the batch axis; a string stands for any size.

    Raises:
        ArrayError: not numbers, or another shape.
    """
    kind = kind_of(value)
    if kind in ("numpy", "jax"):
        value = _numbers(name, value, kind, dtype)
    given = tuple(value.shape)
    batched = len(given) == len(shape) + 1
    trailing = given[1:] if batched else given
    if len(trailing) != len(shape) or any(
        not isinstance(want, str) and want != got for want, got in zip(shape, trailing, strict=True)
    ):
        need = ", ".join(str(n) for n in shape)
        raise ArrayError(f"{name} has shape {given}; (B, {need}) or ({need}) is needed")
    if math.prod(given) > checks.FEW:
        checks.memory(name, math.prod(given), wp.types.type_size_in_bytes(dtype), wp.get_device(device))
    if kind in ("numpy", "jax"):
        full = value if batched else value[None]
        return Batch(wp.array(np.ascontiguousarray(full), dtype=dtype, device=device), kind, batched)
    if kind == "torch":
        import torch

        if value.requires_grad:
            raise ArrayError(
                f"{name} is a torch tensor that requires a gradient; for gradients use slcp_warp.torch, "
                f"otherwise pass {name}.detach()"
            )
        if value.is_complex() or value.dtype == torch.bool or value.layout != torch.strided or value.is_meta:
            raise ArrayError(
                f"{name} is a torch tensor of {value.dtype}, {value.layout} on {value.device}; "
                "a dense one of numbers is needed"
            )
        tensor = value.detach().to(device=wp.device_to_torch(device), dtype=getattr(torch, dtype.__name__))
        tensor = (tensor if batched else tensor[None]).contiguous()
        streams.wait_for_torch(device)
        shared: Any = wp.from_torch(tensor, dtype=dtype)
        return Batch(shared, kind, batched)
    if value.dtype is not dtype or value.device != wp.get_device(device):
        raise ArrayError(
            f"{name} is a Warp array of {value.dtype.__name__} on {value.device}; "
            f"{dtype.__name__} on {device} is needed"
        )
    if not batched and not value.is_contiguous:
        raise ArrayError(f"{name} is a Warp array with gaps between its numbers; a contiguous one is needed")
    if value.size and value.strides[-1] != wp.types.type_size_in_bytes(dtype):
        value = value.contiguous()  # recorded on a tape; generic kernels read an axis without strides
    return Batch(value if batched else value.reshape((1, *given)), kind, batched)


def _numbers(name: str, value: Any, kind: str, dtype: Any) -> np.ndarray:
    """A NumPy array of a precision; a JAX array comes over the host."""
    if kind == "jax":
        if isinstance(value, sys.modules["jax"].core.Tracer):
            raise ArrayError(
                f"{name} is traced by JAX; inside jax.jit, grad or vmap use the functions of slcp_warp.jax"
            )
        value = np.asarray(value)
    found = value if type(value) is np.ndarray and value.dtype.kind in "iuf" else numeric(value)
    if found is None:
        raise ArrayError(f"{name} is {shown(value)}; an array of numbers is needed")
    with np.errstate(over="ignore"):  # infinite in float32: the world's status says so
        return np.asarray(found, dtype=wp.dtype_to_numpy(dtype))


def with_batch(name: str, value: Any, shape: tuple[int | None, ...]) -> Any:
    """An array of any library with a batch axis, (B, *shape); None stands for steps, at least one.

    Raises:
        ArrayError: another shape.
    """
    batched = value if value.ndim == len(shape) + 1 else value[None]
    if batched.ndim != len(shape) + 1 or any(
        want is not None and want != got for want, got in zip(shape, batched.shape[1:])
    ):
        need = ", ".join("N" if n is None else str(n) for n in shape)
        raise ArrayError(f"{name} has shape {tuple(value.shape)}; (B, {need}) or ({need}) is needed")
    if None in shape and not batched.shape[1]:
        raise ArrayError(f"{name} has shape {tuple(value.shape)}; at least one step is needed")
    return batched


def same_worlds(name: str, given: int, worlds: int) -> None:
    """Raise ArrayError where an argument is for another number of worlds than the state."""
    if given != worlds:
        raise ArrayError(f"{name} is given for {given} worlds, the state for {worlds}")


def for_all(name: str, given: Batch, worlds: int) -> wp.array:
    """What is given for every world, or once for all of them; of Warp, whose arrays a tape adds gradients to,
    for every world.
    """
    if worlds == 1 or given.batched or given.kind == "warp":
        same_worlds(name, given.worlds, worlds)
        return given.array
    dtype, device = given.array.dtype, wp.get_device(given.array.device)
    checks.memory(name, worlds * given.array.size, wp.types.type_size_in_bytes(dtype), device)
    return wp.array(np.repeat(given.array.numpy(), worlds, axis=0), dtype=dtype, device=device)


def from_batch(array: wp.array, kind: str, batched: bool) -> Array:
    """A result in the caller's kind, without the batch axis if the caller gave none."""
    if kind == "warp":
        if batched or array.ndim == 1:  # Warp has no arrays without an axis: a status stays (1,)
            return array
        return array.reshape(array.shape[1:])
    if kind == "torch":
        streams.let_torch_wait(array.device)
        out = wp.to_torch(array)
        return out if batched else out[0]
    if kind == "jax":
        out = wp.to_jax(array)  # in float32, unless JAX was told of float64
        return out if batched else out[0]
    out = array.numpy()
    return out if batched else out[0]
