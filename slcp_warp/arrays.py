"""NumPy, torch and Warp arrays at the door: one clear error for bad input, the same kind out as came in."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from .errors import ArgumentError


class ArrayError(ArgumentError):
    """An array argument of the wrong kind, shape or dtype; the message names it, what came and what is
    needed.
    """


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
    return "torch" if type(value).__module__.split(".")[0] == "torch" else "numpy"


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
        try:
            if np.asarray(value).dtype.kind not in "biuf":
                raise TypeError("not real numbers")
            value = np.asarray(value, dtype=wp.dtype_to_numpy(dtype))
        except (TypeError, ValueError) as error:
            raise ArrayError(f"{name} is {value!r:.80}; an array of numbers is needed") from error
    given = tuple(value.shape)
    batched = len(given) == len(shape) + 1
    trailing = given[1:] if batched else given
    if len(trailing) != len(shape) or any(
        not isinstance(want, str) and want != got for want, got in zip(shape, trailing, strict=True)
    ):
        need = ", ".join(str(n) for n in shape)
        raise ArrayError(f"{name} has shape {given}; (B, {need}) or ({need}) is needed")
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
        tensor = value.detach().to(device=wp.device_to_torch(device), dtype=getattr(torch, dtype.__name__))
        tensor = (tensor if batched else tensor[None]).contiguous()
        shared: Any = wp.from_torch(tensor, dtype=dtype)
        return Batch(shared, kind, batched)
    if value.dtype is not dtype or value.device != wp.get_device(device):
        raise ArrayError(
            f"{name} is a Warp array of {value.dtype.__name__} on {value.device}; "
            f"{dtype.__name__} on {device} is needed"
        )
    return Batch(value if batched else value.reshape((1, *given)), kind, batched)


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
    if not hasattr(policy, "arrays"):
        raise TypeError(
            f"policy is a {type(policy).__name__}; a policy is needed, library.policy() or ddp.TrackingPolicy"
        )
    name, struct = policy.arrays(sim)
    given = struct.us.shape[0] if name == "tracking" else 1
    if given not in (1, worlds):
        need = "one for all" if worlds is None else f"1 or {worlds}"
        raise ArrayError(f"policy holds {given} trajectories; {need} is needed, one per world")
    return name, struct
