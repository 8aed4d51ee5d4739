"""Steps and rollouts as differentiable PyTorch functions: `import slcp_warp.torch`.

Forward and backward are one opaque operator each: `torch.compile` keeps them whole, `torch.func` sees them;
tensors are shared with Warp, not copied. Backward is the implicit adjoint of `slcp_warp.gradients.tape`:
exact to solver tolerance where a world's status is SOLVED, NaN where it is not. It can be taken once: asking
for a second derivative is an error.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import torch
import warp as wp
from torch import Tensor

from ..gradients.tape import derivatives_exist
from ..inputs.arrays import ArrayError
from ..inputs.checks import array, flag, instance, names, shown, whole
from ..inputs.errors import ArgumentTypeError
from ..inputs.rules import COVARIANCES
from ..parameters import ParameterError, Parameters
from ..simulator import Simulator
from .operators import RolloutFunction, handle_of, rollout_op, table_op

__all__ = ["Outcome", "Rollout", "rollout", "step"]

Values = Parameters | Mapping[str, Tensor] | None


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
        sim: a simulator with specialised kernels, on the tensors' device and of their dtype.
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
        StrategyError: generic kernels.
    """
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    sim.need_derivatives("slcp_warp.torch")
    flag("check", check)
    x, us = _given(sim, "x0", x0, (sim.nx,)), _given(sim, "controls", controls, (None, sim.nu))
    batched = x0.ndim == 2
    if len(x) != len(us) or us.shape[1] < 1:
        raise ArrayError(f"controls has shape {tuple(controls.shape)}; ({len(x)}, N, {sim.nu}) is needed")
    checkpoint = None if checkpoint is None else whole("checkpoint", checkpoint)
    bodies = sim.scene.structure.nb
    force = x.new_zeros((0, 3 * bodies))
    if external_force is not None:
        if isinstance(external_force, Tensor) and external_force.requires_grad:
            raise ArrayError("external_force requires a gradient, which does not exist; detach it")
        force = _given(sim, "external_force", external_force, (bodies, 3)).reshape(-1, 3 * bodies)
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
    _given(sim, "x", x, (sim.nx,))
    u = x.new_zeros((*x.shape[:-1], sim.nu)) if u is None else u
    _given(sim, "u", u, (sim.nu,))
    states, status = rollout(sim, x, u.unsqueeze(-2), params, **options)
    return Outcome(states[..., 1, :], status)


class Rollout(torch.nn.Module):
    """Rollouts with learnable physical parameters.

    Args:
        sim: a simulator.
        learn: names of the parameters that become `torch.nn.Parameter` of this module, one value for all
            worlds, beginning where `sim.params` is.
        checkpoint: as in `rollout`.
    """

    def __init__(self, sim: Simulator, learn: Sequence[str] = (), checkpoint: int | None = None) -> None:
        super().__init__()
        self.sim: Simulator = instance("sim", sim, Simulator, "a slcp_warp.Simulator")
        self.checkpoint = None if checkpoint is None else whole("checkpoint", checkpoint)
        learn = names("learn", learn, sim.params.names, error=ParameterError)
        dtype, device = getattr(torch, sim.dtype.__name__), wp.device_to_torch(sim.device)
        self.physical = torch.nn.ParameterDict(
            {n: torch.nn.Parameter(torch.tensor(sim.params[n], dtype=dtype, device=device)) for n in learn}
        )

    def forward(self, x0: Tensor, controls: Tensor) -> Outcome:
        """States and status, as `rollout`."""
        return rollout(self.sim, x0, controls, self.values(), checkpoint=self.checkpoint)

    def values(self) -> dict[str, Tensor]:
        """The learned parameters by name.

        A disc has one radius, twice: its gradient is that of the first number.
        """
        out = dict(self.physical.items())
        if "radius" in out:
            discs = [[shape.kind == "disc"] for shape in self.sim.scene.shapes]
            both = torch.tensor(discs, device=out["radius"].device)
            out["radius"] = torch.where(both, out["radius"][:, :1], out["radius"])
        return out


def parameter_table(sim: Simulator, params: Values, like: Tensor) -> Tensor:
    """The kernels' table of parameters, (1 or B, width), with gradients to the tensors that went in."""
    if not isinstance(params, Parameters | Mapping | None):
        raise ArgumentTypeError(
            f"params is a {type(params).__name__}; Parameters or a dict of tensors by name is needed"
        )
    base = params if isinstance(params, Parameters) else sim.params
    if base.scene is not sim.scene:
        raise ParameterError(
            f"params belong to scene {base.scene.name!r}; this simulator has {sim.scene.name!r}"
        )
    if isinstance(params, Parameters) and params.requires_grad:
        raise ParameterError(
            "params are tracked, which is for wp.Tape; for gradients in PyTorch give tensors by name, "
            'as params={"friction": tensor}'
        )
    table = _base_table(base, like.dtype, like.device)
    if params is None or isinstance(params, Parameters):
        return table
    if any(isinstance(value, Tensor) and value.requires_grad for value in params.values()):
        derivatives_exist(sim.options.method)
    unknown = [name for name in params if name not in base.names]
    if unknown:
        raise ParameterError(f"no parameter {shown(unknown)}; there are {list(base.names)}")
    columns = []
    for name, start, shape in base.layout.columns:
        size = math.prod(shape)
        kept = table[:, start : start + size]
        columns.append(_column(name, params[name], shape, size, like) if name in params else kept)
    rows = {len(c) for c in columns} - {1}
    if len(rows) > 1:
        raise ParameterError(f"params disagree on the number of worlds: {sorted(rows)}")
    count = rows.pop() if rows else 1
    return torch.cat([c.expand(count, -1) for c in columns], 1)


def _base_table(params: Parameters, dtype: torch.dtype, device: torch.device) -> Tensor:
    if torch.compiler.is_compiling():
        return table_op(handle_of(params), dtype, device)
    return torch.as_tensor(params.table(), dtype=dtype, device=device)


def _column(name: str, value: Any, shape: tuple[int, ...], size: int, like: Tensor) -> Tensor:
    if not isinstance(value, Tensor):
        value = value if type(value) in (int, float) else array(name, value, error=ParameterError)
        value = torch.as_tensor(value, dtype=like.dtype, device=like.device)
    if value.dtype != like.dtype or value.device != like.device:
        raise ParameterError(
            f"{name} is a tensor of {value.dtype} on {value.device}; {like.dtype} on {like.device} is needed"
        )
    if name in COVARIANCES and value.ndim < 2:  # times the identity, as in `Parameters.replace`
        value = value[..., None, None] * torch.eye(shape[0], dtype=like.dtype, device=like.device)
    if value.shape == shape or value.ndim == 0:
        return value.reshape(1, -1).expand(1, size)
    if value.shape[1:] == shape:
        return value.reshape(len(value), size)
    if value.ndim == 1:
        return value[:, None].expand(-1, size)
    need = ", ".join(["B", *map(str, shape)])
    raise ParameterError(f"{name} has shape {tuple(value.shape)}; give a scalar, {shape}, (B,) or ({need})")


def _given(sim: Simulator, name: str, value: Tensor, shape: tuple[int | None, ...]) -> Tensor:
    """A checked tensor with a batch axis."""
    dtype, device = getattr(torch, sim.dtype.__name__), torch.device(wp.device_to_torch(sim.device))
    if not isinstance(value, Tensor) or value.dtype != dtype or value.device != device:
        came = (
            f"{value.dtype} on {value.device}" if isinstance(value, Tensor) else f"a {type(value).__name__}"
        )
        raise ArrayError(f"{name} is {came}; a tensor of {dtype} on {device} is needed")
    batched = value if value.ndim == len(shape) + 1 else value.unsqueeze(0)
    if batched.ndim != len(shape) + 1 or any(w not in (None, g) for w, g in zip(shape, batched.shape[1:])):
        need = ", ".join("N" if n is None else str(n) for n in shape)
        raise ArrayError(f"{name} has shape {tuple(value.shape)}; (B, {need}) or ({need}) is needed")
    return batched
