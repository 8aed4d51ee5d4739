"""Rollouts under a network, differentiable by its weights.

The states come from one launch with the network inside the kernel. Backward, the network is its tangent at
each recorded state, a feedback: the adjoint of a tracking policy gives the gradient by every control, with
all that follows from it through later controls, and PyTorch carries these to the weights.
"""

from typing import Any

import torch
import warp as wp
from torch import Tensor

from slcp_warp.kernels.device.tables import laid_out
from slcp_warp.kernels.policies.tracking import make_tracking

from ..gradients.tape import Recorded, adjoint
from ..inputs.arrays import ArrayError
from ..policies.network import Network
from ..simulator import Simulator
from ..stepping.arguments import policy_arrays
from ..stepping.arrays import Controls, RolloutArrays
from .operators import blank, once, share, stream


def under_module(
    sim: Simulator, x: Tensor, module: torch.nn.Module, steps: int, table: Tensor
) -> tuple[Tensor, Tensor]:
    """States (B, N+1, nx) and status of worlds that begin in x (B, nx), under u = module(x)."""
    policy = Network(module)
    of_same_kind(module, x)
    states, controls, status = roll_out(sim, x, policy, steps, table)
    before = states[:, :-1]
    asked, gain = module(before), _slopes(module, before)
    followed: Any = ClosedLoop.apply(x, table, asked, controls, gain, states, status, sim)
    return followed, status


def of_same_kind(module: torch.nn.Module, x: Tensor) -> None:
    """Raise ArrayError for weights of another precision or device than the states'."""
    for name, weight in module.named_parameters():
        if weight.dtype != x.dtype or weight.device != x.device:
            raise ArrayError(
                f"module has {name} of {weight.dtype} on {weight.device}; {x.dtype} on {x.device} is needed"
            )


def roll_out(
    sim: Simulator, x: Tensor, policy: Any, steps: int, table: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """States (B, N+1, nx), controls (B, N, nu), status (B,)."""
    worlds = len(x)
    states, controls = (blank((worlds, *each), x) for each in ((steps + 1, sim.nx), (steps, sim.nu)))
    status = blank((worlds,), x, torch.int32)
    with stream(x):
        kernel, struct = policy_arrays(policy, sim, worlds)
        source = Controls(kernel, struct, steps)
        numbers, start, out, us = share(sim, table, x, states, controls)
        none = sim.empty(0, steps, 1)
        code: Any = wp.from_torch(status)
        arrays = RolloutArrays(laid_out(numbers), start, sim.empty(0, 0), out, us, none, none, code)
        sim.kernels.stepping.rollout(arrays, source, ())
    return states, controls, status


def _slopes(module: torch.nn.Module, states: Tensor) -> Tensor:
    """Derivatives (B, N, nu, nx) of the controls by the state."""
    with torch.enable_grad():
        x = states.detach().requires_grad_()
        u = module(x)
        rows = [torch.autograd.grad(u[..., i].sum(), x, retain_graph=True)[0] for i in range(u.shape[-1])]
    return torch.stack(rows, -2)


class ClosedLoop(torch.autograd.Function):
    """The recorded states, with their derivatives by x0, the table and what the module gives."""

    @staticmethod
    def forward(ctx: Any, x0: Tensor, table: Tensor, asked: Tensor, controls: Tensor, gain: Tensor,
                states: Tensor, status: Tensor, sim: Simulator) -> Tensor:  # fmt: skip
        """The states."""
        ctx.save_for_backward(x0, table, controls, gain, states, status)
        ctx.sim = sim
        return states.clone()

    @staticmethod
    @once
    def backward(ctx: Any, by_states: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients by x0, the table and the controls."""
        sim, wanted = ctx.sim, ctx.needs_input_grad
        x0, table, controls, gain, states, status = ctx.saved_tensors
        found = [blank(t.shape, t) for t in (x0, table, controls)]
        if not len(x0):
            return (*(f if want else None for f, want in zip(found, wanted)), None, None, None, None, None)
        with stream(x0):
            start, numbers, us, slopes, out, by_out = arrays = share(
                sim, x0, table, controls, gain, states, by_states
            )
            for array, gradient, want in zip(arrays, found, wanted):
                if want:
                    array.grad = wp.from_torch(gradient, dtype=sim.dtype)
                    array.requires_grad = True
            struct = make_tracking(sim.nx, sim.nu, sim.dtype).Struct()
            struct.us, struct.xs, struct.gain, struct.period = us, out, slopes, sim.empty(sim.nx)
            code: Any = wp.from_torch(status)
            run = Recorded(sim.kernels.stepping, numbers, start, us, sim.empty(0, 0), out, code, struct)
            adjoint(run, by_out)
        return (*(f if want else None for f, want in zip(found, wanted)), None, None, None, None, None)
