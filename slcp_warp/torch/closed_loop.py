"""Rollouts under a policy, differentiable by the start, the policy's numbers and physical parameters."""

from collections.abc import Mapping
from typing import Any

import torch
import warp as wp
from torch import Tensor

from slcp_warp.kernels.structure import STEP_SIZE

from ..gradients.tape import Recorded, adjoint, derivatives_exist
from ..inputs.arrays import ArrayError
from ..inputs.checks import attribute, flag, instance, whole
from ..inputs.errors import ArgumentError
from ..policies.function import Function
from ..policies.network import Network
from ..simulator import Simulator
from ..stepping.arguments import at_step_size
from .adjoint_check import check_adjoint
from .followed import Followed, Memory, filled, followed, innermost, leaves_of
from .functions import Outcome, given
from .network import of_same_kind, roll_out, under_module
from .operators import check_values, once, share, stream
from .table import Values, parameter_table


def closed_loop(
    sim: Simulator,
    x0: Tensor,
    policy: Any,
    steps: int,
    params: Values = None,
    arrays: Mapping[str, Tensor] | None = None,
    check: bool = True,
) -> Outcome:
    """Step every world N times under a policy; differentiable by x0, its numbers and the physical parameters
    that are tensors; once.

    A user's function is differentiated by Warp, which does so wrongly for some code: its adjoint is compared
    with differences in float64 at states of the first rollout that asks for a gradient.

    Args:
        sim, params: as for `rollout`.
        x0: (B, nx) or (nx,).
        policy: a torch.nn.Sequential as of `policies.Network`, of the simulator's precision, on its device;
            or one of `policies`: Function, Network, Linear, or Around one of these; or a `ddp.TrackingPolicy`
            of NumPy arrays, whose own numbers collect no gradient here.
        steps: N.
        arrays: tensors by name in place of a function's arrays.
        check: whether values of parameters are looked at (on a GPU this waits for them).

    Raises:
        ArrayError: another shape, dtype or device.
        ParameterError: an unknown name or an illegal value. Other errors of the policy and of `rollout`.
        ArgumentError: a function's adjoint by Warp is wrong.
        ArgumentTypeError: a policy through which no gradient flows.
    """
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    derivatives_exist(sim.options.method)
    steps, x = whole("steps", steps), given(sim, "x0", x0, (sim.nx,))
    table = parameter_table(sim, params, x)
    if len(table) not in (1, len(x)):
        raise ArrayError(f"params are given for {len(table)} worlds, x0 for {len(x)}")
    instance("arrays", arrays, Mapping | None, "a dict of tensors by name")
    flag("check", check)
    if check and isinstance(params, Mapping) and params:  # `Parameters` were looked at before
        check_values(sim, table)
    states: Any
    if isinstance(policy, torch.nn.Module):
        if arrays:
            raise ArgumentError("arrays are given, but the policy is a module, which has weights of its own")
        states, status = under_module(sim, x, policy, steps, table)
    else:
        leaves = leaves_of(policy, arrays or {})
        if isinstance(attribute(policy, "step_size"), float):  # a plan's; on a GPU this waits for the table
            policy = at_step_size(policy, table[:, STEP_SIZE].detach().cpu().numpy())
        if isinstance(innermost(policy), Network):
            of_same_kind(innermost(policy).module, x)
        wanted = torch.is_grad_enabled() and any(t.requires_grad for t in (x, table, *leaves.values()))
        states, status = UnderPolicy.apply(
            x, table, sim, policy, steps, wanted, tuple(leaves), *leaves.values()
        )
    return Outcome(states, status) if x0.ndim == 2 else Outcome(states[0], status[0])


class UnderPolicy(torch.autograd.Function):
    """A rollout in one launch; backward step by step, as what a policy remembers demands."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, table: Tensor, sim: Simulator, policy: Any, steps: int, wanted: bool,
                names: tuple[str, ...], *leaves: Tensor) -> tuple[Tensor, Tensor]:  # fmt: skip
        """States and status."""
        states, controls, status = roll_out(
            sim, x, filled(policy, sim, dict(zip(names, leaves))), steps, table
        )
        if wanted and isinstance(innermost(policy), Function):
            check_adjoint(innermost(policy), sim, states)
        ctx.save_for_backward(x, table, states, controls, status, *leaves)
        ctx.sim, ctx.policy, ctx.names = sim, policy, names
        ctx.mark_non_differentiable(status)
        return states, status

    @staticmethod
    @once
    def backward(ctx: Any, by_states: Tensor, _by_status: Any) -> tuple[Tensor | None, ...]:
        """Gradients by the start, the table and the policy's numbers."""
        sim = ctx.sim
        x0, table, states, controls, status, *leaves = ctx.saved_tensors
        leaves = [leaf.detach().requires_grad_() for leaf in leaves]
        repeated = followed(ctx.policy, sim, x0, dict(zip(ctx.names, leaves)))
        memories = _memories(repeated, states)
        by_table, by_leaves = torch.zeros_like(table), [torch.zeros_like(leaf) for leaf in leaves]
        by_x, by_memory = by_states[:, -1], [torch.zeros_like(m) for m in memories[-1]]
        for k in reversed(range(controls.shape[1] if len(x0) else 0)):
            by_x, by_u = _step_back(sim, table, by_table, states, controls, status, k, by_x)
            through, by_memory, by_own = _ask_back(
                repeated, k, states[:, k], memories[k], leaves, by_u, by_memory
            )
            by_x = by_states[:, k] + by_x + through
            for total, own in zip(by_leaves, by_own):
                total += own
        return (by_x, by_table, *(None,) * 5, *by_leaves)


def _memories(repeated: Followed, states: Tensor) -> list[Memory]:
    """What the policy remembers before every step and after the last."""
    with torch.no_grad():
        found = [repeated.start(states[:, 0])]
        if not any(kept.numel() for kept in found[0]):
            return found * states.shape[1]
        for k in range(states.shape[1] - 1):
            found.append(repeated(k, states[:, k], found[-1])[1])
    return found


def _step_back(sim: Simulator, table: Tensor, by_table: Tensor, states: Tensor, controls: Tensor,
               status: Tensor, k: int, by_after: Tensor) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Gradients by state and controls of step k from that by the state after it; adds to the table's."""
    x, u = states[:, k], controls[:, k : k + 1]
    found = [torch.zeros_like(t, memory_format=torch.contiguous_format) for t in (x, u)]
    slopes = torch.stack([torch.zeros_like(by_after), by_after], 1)
    with stream(x):
        start, us, numbers, two, by_two = arrays = share(sim, x, u, table, states[:, k : k + 2], slopes)
        for array, gradient in zip(arrays, (*found, by_table)):
            array.grad = wp.from_torch(gradient, dtype=sim.dtype)
            array.requires_grad = True
        code: Any = wp.from_torch(status)
        adjoint(Recorded(sim.kernels.stepping, numbers, start, us, sim.empty(0, 0), two, code), by_two)
    return found[0], found[1][:, 0]


def _ask_back(repeated: Followed, k: int, x: Tensor, memory: Memory, leaves: list[Tensor], by_u: Tensor,
              by_after: list[Tensor]) -> tuple[Tensor, list[Tensor], list[Tensor]]:  # fmt: skip
    """Gradients by state, memory and numbers of the policy from those by its controls and what it keeps."""
    with torch.enable_grad():
        x = x.detach().requires_grad_()
        before = tuple(m.detach().requires_grad_() for m in memory)
        kept = repeated.start(x) if k == 0 else before
        u, after = repeated(k, x, kept)
        outputs = [(out, slope) for out, slope in zip((u, *after), (by_u, *by_after)) if out.requires_grad]
        inputs = (x, *before, *leaves)
        found: list[Any] = [None] * len(inputs)
        if outputs:
            found = list(
                torch.autograd.grad(
                    [o for o, _ in outputs], inputs, [s for _, s in outputs], allow_unused=True
                )
            )
    full = [torch.zeros_like(t) if g is None else g for t, g in zip(inputs, found)]
    count = 1 + len(memory)
    return full[0], full[1:count], full[count:]
