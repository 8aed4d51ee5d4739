"""A rollout and a step as functions of tensors."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
import warp as wp
from torch import Tensor

from ..gradients.tape import derivatives_exist
from ..inputs.arrays import ArrayError, with_batch
from ..inputs.checks import flag, instance, whole
from ..simulator import Simulator
from .operators import RolloutFunction, handle_of, rollout_op
from .table import Values, parameter_table


class Outcome(NamedTuple):
    """states (B, N+1, nx), or the next state (B, nx) of a step; status (B,), as `slcp_warp.Status`."""

    states: Tensor
    status: Tensor


def rollout(
    sim: Simulator,
    x0: Tensor,
    controls: Tensor,
    params: Values = None,
    *,
    external_force: Tensor | None = None,
    checkpoint: int | None = None,
    check: bool = True,
) -> Outcome:
    """Step every world N times; differentiable by x0, controls and the parameters that are tensors.

    Args:
        sim: a simulator on the tensors' device and of their dtype.
        x0: (B, nx) or (nx,).
        controls: (B, N, nu) or (N, nu).
        params: `Parameters`, or tensors by name for those that differ from `sim.params`: a scalar, the
            parameter's own shape, (B,) or (B, *shape).
        external_force: as in `Simulator.rollout`; no gradient.
        checkpoint: keep every k-th state only, as in `Simulator.rollout`.
        check: whether values of parameters are looked at (on a GPU this waits for them).

    Raises:
        ArrayError: another shape, dtype or device.
        ParameterError: an unknown name or an illegal value.
        OptionError: a gradient by parameters that the options do not have.
    """
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    derivatives_exist(sim.options.method)
    flag("check", check)
    x, us = given(sim, "x0", x0, (sim.nx,)), given(sim, "controls", controls, (None, sim.nu))
    batched = x0.ndim == 2
    if len(x) != len(us) or us.shape[1] < 1:
        raise ArrayError(f"controls has shape {tuple(controls.shape)}; ({len(x)}, N, {sim.nu}) is needed")
    checkpoint = None if checkpoint is None else whole("checkpoint", checkpoint)
    bodies = sim.scene.structure.nb
    force = x.new_zeros((0, 3 * bodies))
    if external_force is not None:
        if isinstance(external_force, Tensor) and external_force.requires_grad:
            raise ArrayError("external_force requires a gradient, which does not exist; detach it")
        force = given(sim, "external_force", external_force, (bodies, 3)).reshape(-1, 3 * bodies)
        if len(force) != len(x):
            raise ArrayError(f"external_force is given for {len(force)} worlds, x0 for {len(x)}")
    table = parameter_table(sim, params, x)
    if len(table) not in (1, len(x)):
        raise ArrayError(f"params are given for {len(table)} worlds, x0 for {len(x)}")
    apply: Any = rollout_op if torch.compiler.is_compiling() else RolloutFunction.apply
    check = check and isinstance(params, Mapping) and len(params) > 0  # `Parameters` were looked at before
    states, status = apply(x, us, table, force, handle_of(sim), checkpoint or 0, check)
    return Outcome(states, status) if batched else Outcome(states[0], status[0])


def step(
    sim: Simulator, x: Tensor, u: Tensor | None = None, params: Values = None, **options: Any
) -> Outcome:
    """One step: a rollout of length one.

    Args:
        sim, params, options: as for `rollout`.
        x: (B, nx) or (nx,).
        u: (B, nu) or (nu,), None: zero.
    """
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    given(sim, "x", x, (sim.nx,))
    u = x.new_zeros((*x.shape[:-1], sim.nu)) if u is None else u
    given(sim, "u", u, (sim.nu,))
    states, status = rollout(sim, x, u.unsqueeze(-2), params, **options)
    return Outcome(states[..., 1, :], status)


def given(sim: Simulator, name: str, value: Tensor, shape: tuple[int | None, ...]) -> Tensor:
    """A checked tensor with a batch axis."""
    dtype, device = getattr(torch, sim.dtype.__name__), torch.device(wp.device_to_torch(sim.device))
    if not isinstance(value, Tensor) or value.dtype != dtype or value.device != device:
        came = (
            f"{value.dtype} on {value.device}" if isinstance(value, Tensor) else f"a {type(value).__name__}"
        )
        raise ArrayError(f"{name} is {came}; a tensor of {dtype} on {device} is needed")
    batched: Tensor = with_batch(name, value, shape)
    return batched
