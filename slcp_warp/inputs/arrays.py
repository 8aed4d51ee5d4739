"""NumPy, torch and Warp arrays at the door: one clear error for bad input, the same kind out as came in."""

import math
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.step.rollout import POLICIES

from . import checks
from .checks import numeric, shown
from .errors import ArgumentError, ArgumentTypeError


class ArrayError(ArgumentError):
    """An array of the wrong kind, shape or dtype; the message names it, what came and what is needed."""


@dataclass(frozen=True)
class Batch:
    """An argument on the device: `array` has the batch axis; `batched` tells whether the caller gave one."""

    array: wp.array
    kind: str
    batched: bool


def kind_of(value: Any) -> str:
    """Return "warp", "torch" or "numpy"."""
    if isinstance(value, wp.array):
        return "warp"
    torch = sys.modules.get("torch")
    return "torch" if torch is not None and isinstance(value, torch.Tensor) else "numpy"


def to_batch(name: str, value: Any, shape: tuple[int | str, ...], dtype: Any, device: Any) -> Batch:
    """Put an argument on the device with a leading batch axis.

    Args:
        name: the argument's name, for errors.
        shape: expected shape without the batch axis; a string stands for any size.

    Raises:
        ArrayError: not numbers, or another shape.
    """
    kind = kind_of(value)
    if kind == "numpy":
        plain = isinstance(value, np.ndarray) and value.dtype.kind in "iuf"
        found = value if plain else numeric(value)
        if found is None:
            raise ArrayError(f"{name} is {shown(value)}; an array of numbers is needed")
        with np.errstate(over="ignore"):  # infinite in float32: the world's status says so
            value = np.asarray(found, dtype=wp.dtype_to_numpy(dtype))
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
    if kind == "numpy":
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
        shared: Any = wp.from_torch(tensor, dtype=dtype)
        return Batch(shared, kind, batched)
    if value.dtype is not dtype or value.device != wp.get_device(device):
        raise ArrayError(
            f"{name} is a Warp array of {value.dtype.__name__} on {value.device}; "
            f"{dtype.__name__} on {device} is needed"
        )
    if not batched and not value.is_contiguous:
        raise ArrayError(f"{name} is a Warp array with gaps between its numbers; a contiguous one is needed")
    return Batch(value if batched else value.reshape((1, *given)), kind, batched)


def same_worlds(name: str, given: int, worlds: int) -> None:
    """Raise ArrayError where an argument is for another number of worlds than the state."""
    if given != worlds:
        raise ArrayError(f"{name} is given for {given} worlds, the state for {worlds}")


def from_batch(array: wp.array, kind: str, batched: bool) -> Any:
    """A result in the caller's kind, without the batch axis if the caller gave none."""
    if kind == "warp":
        if batched or array.ndim == 1:  # Warp has no arrays without an axis: a status stays (1,)
            return array
        return array.reshape(array.shape[1:])
    if kind == "torch":
        out = wp.to_torch(array)
        return out if batched else out[0]
    out = array.numpy()
    return out if batched else out[0]


def policy_arrays(policy: Any, sim: Any, worlds: int | None) -> tuple[str, Any]:
    """Kernel name and struct of a policy, for so many worlds (None: for any number)."""
    if isinstance(policy, type) or not callable(checks.attribute(policy, "arrays")):
        raise ArgumentTypeError(
            f"policy is a {type(policy).__name__}; a policy is needed, library.policy() or ddp.TrackingPolicy"
        )
    given_arrays = policy.arrays(sim)
    if not isinstance(given_arrays, tuple) or len(given_arrays) != 2:
        raise ArgumentTypeError(f"policy.arrays gave {shown(given_arrays)}; (name, struct) is needed")
    name, struct = given_arrays
    if not isinstance(name, str) or name not in POLICIES:
        raise ArgumentError(f"policy.arrays gave the name {shown(name)}; choose one of {list(POLICIES)}")
    kind = POLICIES[name](sim.nx, sim.nu, sim.dtype).Struct
    if getattr(struct, "_cls", None) is not kind:
        raise ArgumentTypeError(
            f"policy.arrays gave {shown(struct)} with the name {name!r}; the struct of kernels.policy for "
            f"{sim.nx} states, {sim.nu} controls and {sim.dtype.__name__} is needed"
        )
    given = struct.us.shape[0] if name == "tracking" else 1
    if given not in (1, worlds):
        need = "one for all" if worlds is None else f"1 or {worlds}"
        raise ArrayError(f"policy holds {given} trajectories; {need} is needed, one per world")
    return name, struct
