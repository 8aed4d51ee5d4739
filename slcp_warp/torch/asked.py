"""A user's Warp function asked once in every world, as a differentiable function of tensors."""

import copy
from collections.abc import Iterable, Mapping
from typing import Any

import torch
import warp as wp
from torch import Tensor

from slcp_warp.kernels.device.cache import block_of, load
from slcp_warp.kernels.policies.pull import make_asked_kernel, make_begun_kernel

from ..inputs.arrays import ArrayError
from ..inputs.checks import shown
from ..inputs.errors import ArgumentError
from ..policies.arrays import put
from ..policies.function import Function
from ..simulator import Simulator
from .operators import blank, once, share, stream


class AskedFunction:
    """A `policies.Function` with some of its arrays as tensors.

    Attributes:
        tensors: by name; what it gives can be differentiated by them.
        memory: how many numbers it keeps.

    Raises:
        ArgumentError, ArrayError: names that it has not got, tensors of another type or another number of
            axes.
    """

    def __init__(self, policy: Function, sim: Simulator, tensors: Mapping[str, Tensor]) -> None:
        self._sim, self.tensors, self.memory = sim, dict(tensors), policy.memory
        for name, value in self.tensors.items():
            _check(name, value, policy, sim)
        self._policy = copy.copy(policy)
        self._policy.arrays = {
            name: value if isinstance(value, wp.array) or not value.ndim else put(sim, value)
            for name, value in policy.arrays.items()
        }
        self._kernel = policy.kernel(sim)[0]
        size = sim.nx, sim.nu, sim.dtype
        self._asked = make_asked_kernel(self._kernel, *size)
        starts = self._kernel.functions(*size).start is not None
        self._begun = make_begun_kernel(self._kernel, *size) if starts else None

    def start(self, x: Tensor) -> tuple[Tensor, ...]:
        """What is remembered before the first step, of states (B, nx)."""
        if not self.memory:
            return ()
        if self._begun is None:
            return (x.new_zeros((len(x), self.memory)),)
        found: tuple[Tensor, ...] = WarpCall.apply(self, -1, x, x.new_zeros((0, 0)), *self.tensors.values())
        return found[:1]

    def __call__(self, k: int, x: Tensor, memory: tuple[Tensor, ...]) -> tuple[Tensor, tuple[Tensor, ...]]:
        """Controls (B, nu) of step k and what is remembered then."""
        kept = memory[0] if memory else x.new_zeros((len(x), 0))
        u, after = WarpCall.apply(self, k, x, kept, *self.tensors.values())
        return u, ((after,) if memory else ())

    def filled(self, tensors: Iterable[Tensor]) -> Function:
        """The policy with tensors in place of its arrays."""
        return self._with(share(self._sim, *tensors))

    def _with(self, arrays: list[Any]) -> Function:
        out = copy.copy(self._policy)
        out.arrays = self._policy.arrays | dict(zip(self.tensors, arrays))
        return out

    def launch(self, k: int, inputs: list[Any], outputs: list[Any], arrays: list[Any], back: bool) -> None:
        """The kernel of step k, or of the start for k = -1, or its adjoint, on Warp arrays."""
        kernel = self._begun if k < 0 else self._asked
        assert kernel is not None
        struct = self._with(arrays).kernel(self._sim)[1]
        given = [struct, *inputs] if k < 0 else [k, struct, *inputs]
        device = self._sim.device
        load(kernel, device)
        more: dict[str, Any] = {"block_dim": block_of(device)}
        if back:
            slopes = struct._cls()  # of arrays without a gradient: empty ones
            for name, array in zip(self.tensors, arrays):
                setattr(slopes, name, array.grad)
            by = [slopes if each is struct else getattr(each, "grad", 0) for each in given]
            more |= {"adjoint": True, "adj_inputs": by, "adj_outputs": [each.grad for each in outputs]}
        wp.launch(kernel, len(inputs[0]), given, outputs, device=device, record_tape=False, **more)

    def _shapes(self, k: int, worlds: int) -> list[tuple[int, int]]:
        """Of the outputs of step k, or of the start for k = -1."""
        return [(worlds, self.memory)] if k < 0 else [(worlds, self._sim.nu), (worlds, self.memory)]

    def run(self, k: int, given: list[Tensor], slopes: list[Tensor] | None = None) -> list[Tensor]:
        """Outputs of states, memory and arrays; with slopes by these, the gradients by the given."""
        x, back = given[0], slopes is not None
        with stream(x):
            arrays = share(self._sim, *given)
            room = [blank(shape, x) for shape in self._shapes(k, len(x))]
            outputs = share(self._sim, *room)
            found = room
            if slopes is not None:
                found = [blank(t.shape, t) for t in given]
                for array, gradient in zip([*arrays, *outputs], [*found, *(s.contiguous() for s in slopes)]):
                    array.requires_grad = True
                    array.grad = wp.from_torch(gradient, dtype=self._sim.dtype)
            self.launch(k, arrays[: 1 if k < 0 else 2], outputs, arrays[2:], back)
        return found


class WarpCall(torch.autograd.Function):
    """`AskedFunction.run`, with Warp's adjoint as its derivative; once."""

    @staticmethod
    def forward(ctx: Any, asked: AskedFunction, k: int, *given: Tensor) -> tuple[Tensor, ...]:
        """Controls and memory."""
        ctx.save_for_backward(*given)
        ctx.asked, ctx.k = asked, k
        return tuple(asked.run(k, [t.detach().contiguous() for t in given]))

    @staticmethod
    @once
    def backward(ctx: Any, *slopes: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients by states, memory and arrays."""
        given = [t.detach().contiguous() for t in ctx.saved_tensors]
        found = ctx.asked.run(ctx.k, given, list(slopes))
        return None, None, *(f if want else None for f, want in zip(found, ctx.needs_input_grad[2:]))


def _check(name: str, value: Any, policy: Function, sim: Simulator) -> None:
    if name not in policy.arrays:
        raise ArgumentError(
            f"arrays names {shown(name)}; the policy has {', '.join(policy.arrays) or 'none'}"
        )
    own = policy.arrays[name]
    dtype, device = getattr(torch, sim.dtype.__name__), torch.device(wp.device_to_torch(sim.device))
    if not isinstance(value, Tensor) or value.dtype != dtype or value.device != device:
        came = (
            f"{value.dtype} on {value.device}" if isinstance(value, Tensor) else f"a {type(value).__name__}"
        )
        raise ArrayError(f"arrays[{name!r}] is {came}; a tensor of {dtype} on {device} is needed")
    if value.ndim != own.ndim or not own.ndim:
        need = f"{own.ndim} axes are needed" if own.ndim else "by a number there is none: make it an array"
        raise ArrayError(f"arrays[{name!r}] has shape {tuple(value.shape)}; {need}")
    if isinstance(own, wp.array) and own.dtype is wp.int32:
        raise ArrayError(f"arrays[{name!r}] is of whole numbers in the policy, by which there is no gradient")
