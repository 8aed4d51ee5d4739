"""Policies repeated along recorded states by PyTorch, for their derivatives.

Each is start(x) -> memory and (k, x, memory) -> (u, memory) of all worlds, the same numbers as in a kernel.
"""

import copy
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import torch
import warp as wp
from torch import Tensor

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.policies.around import make_noise_kernel

from ..inputs import checks
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..inputs.limits import bounded, limit_rows
from ..policies.around import Around
from ..policies.arrays import period_of
from ..policies.function import Function
from ..policies.linear import Linear
from ..policies.network import Network
from ..simulator import Simulator
from .asked import AskedFunction
from .operators import stream

Memory = tuple[Tensor, ...]


class Followed(Protocol):
    """A policy that can be followed."""

    def start(self, x: Tensor) -> Memory:
        """What is remembered before the first step."""

    def __call__(self, k: int, x: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
        """Controls (B, nu) of step k, and what is remembered then."""


class FollowedNetwork:
    """A network with weights by name."""

    def __init__(self, policy: Network, weights: Mapping[str, Tensor]) -> None:
        self._module, self._weights = policy.module, dict(weights)

    def start(self, x: Tensor) -> Memory:
        """Nothing."""
        return ()

    def __call__(self, k: int, x: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
        """See `Followed`."""
        return torch.func.functional_call(self._module, self._weights, (x,)), memory


class FollowedLinear:
    """Linear feedback about a state."""

    def __init__(self, policy: Linear, sim: Simulator, like: Tensor) -> None:
        period = period_of(policy.period, sim)
        self.K, self.x, self.u, self.period = (
            _like(like, values) for values in (policy.K, policy.x_ref, policy.u_ref, period)
        )
        self.lower, self.upper = (_like(like, values) for values in policy.limits)

    def start(self, x: Tensor) -> Memory:
        """Nothing."""
        return ()

    def __call__(self, k: int, x: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
        """See `Followed`."""
        return self._about(x, self.x, self.u, self.K), memory

    def _about(self, x: Tensor, at: Tensor, u: Tensor, gain: Tensor) -> Tensor:
        """u + K (x - x_ref), the nearest x_ref there is, within the limits."""
        off = x - at
        safe = torch.where(self.period > 0.0, self.period, 1.0)
        off = off - torch.where(self.period > 0.0, safe * torch.round(off / safe), 0.0).detach()
        return torch.clamp(u + (gain @ off[:, :, None])[:, :, 0], self.lower, self.upper)


class FollowedPlan(FollowedLinear):
    """Linear feedback along a trajectory, whose last step is held, as a `ddp.TrackingPolicy` has it."""

    def __init__(self, policy: Any, sim: Simulator, like: Tensor) -> None:
        period = period_of(policy.period, sim)
        self.K, self.x, self.u, self.period = (
            _like(like, values) for values in (policy.K, policy.xs, policy.us, period)
        )
        self.lower, self.upper = (_like(like, values) for values in policy.limits)

    def __call__(self, k: int, x: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
        """See `Followed`."""
        at = min(k, self.u.shape[1] - 1)
        return self._about(x, self.x[:, at], self.u[:, at], self.K[:, at]), memory


def _like(like: Tensor, values: Any) -> Tensor:
    return torch.tensor(np.asarray(values), dtype=like.dtype, device=like.device)


def is_plan(policy: Any) -> bool:
    """Whether a policy tracks a plan of NumPy arrays."""
    arrays = [checks.attribute(policy, name) for name in ("us", "xs", "K")]
    return all(isinstance(a, np.ndarray) for a in arrays) and hasattr(policy, "limits")


class FollowedAround:
    """Another policy behind a noisy sensor, a hold, a delay and limits; memory: the step after the one in
    which it was asked last, what is held, what is on the way, the other's.
    """

    def __init__(self, policy: Around, inner: Followed, sim: Simulator, like: Tensor) -> None:
        self.inner, self.delay, self.hold, self.seed = inner, policy.delay, policy.hold, policy.seed
        self._sim, self._stream = sim, policy.stream(sim.nx)
        self._before = torch.tensor(policy.controls_before(sim.nu), dtype=like.dtype, device=like.device)
        self._noise: Any = wp.array(policy.deviations(sim), dtype=sim.dtype, device=sim.device)
        self._noisy = bool(policy.deviations(sim).any())
        lower, upper = limit_rows(policy.limits, sim.nu)
        self._bounded = bounded(lower, upper)
        self._limits = [torch.tensor(a[0], dtype=like.dtype, device=like.device) for a in (lower, upper)]

    def start(self, x: Tensor) -> Memory:
        """See `Followed`."""
        zeros = x.new_zeros((len(x), self._sim.nu))
        way = (self._before.expand(len(x), -1),) * self.delay
        return (x.new_zeros(()), zeros, *way, *self.inner.start(self._seen(0, x)))

    def _seen(self, k: int, x: Tensor) -> Tensor:
        if not self._noisy:
            return x
        kernel = make_noise_kernel(self._sim.nx, self._sim.dtype)
        with stream(x):
            noise = self._sim.empty(*x.shape)
            launch(kernel, len(x), [k, self.seed, self._stream, self._noise, noise], self._sim.device)
            return x + wp.to_torch(noise)

    def __call__(self, k: int, x: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
        """See `Followed`."""
        follows, (last, *way), inside = int(memory[0]), memory[1 : 2 + self.delay], memory[2 + self.delay :]
        held = last
        if not follows or k // self.hold != (follows - 1) // self.hold:
            held, inside = self.inner(k, self._seen(k, x), inside)
        for _ in range(min(k - follows, self.delay)):  # steps in which nobody asked
            way = [*way[1:], last]
        u, *way = (*way, held)  # the oldest arrives
        if self._bounded:
            u = torch.clamp(u, *self._limits)
        return u, (x.new_tensor(k + 1), held, *way, *inside)


def innermost(policy: Any) -> Any:
    """The policy inside all `Around`s."""
    while isinstance(policy, Around):
        policy = policy.policy
    return policy


def leaves_of(policy: Any, arrays: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The tensors that a policy can be differentiated by: those of `arrays`, or a network's weights.

    Raises:
        ArgumentTypeError: a policy through which no gradient flows.
        ArgumentError: arrays for one that has none.
    """
    inner = innermost(policy)
    if not isinstance(inner, Function | Network | Linear) and not is_plan(inner):
        raise ArgumentTypeError(
            f"policy is a {type(inner).__name__}, through which no gradient flows; a torch.nn.Sequential, or "
            "policies.Function, Network, Linear, a ddp.TrackingPolicy or Around of these is needed (by the "
            "numbers of a plan that is tracked: rollouts on a wp.Tape, docs/understand/gradients.md)"
        )
    if arrays and not isinstance(inner, Function):
        raise ArgumentError(f"arrays are given, but a {type(inner).__name__} has none; a Function has")
    return dict(inner.module.named_parameters()) if isinstance(inner, Network) else dict(arrays)


def followed(policy: Any, sim: Simulator, like: Tensor, leaves: Mapping[str, Tensor]) -> Followed:
    """A policy to follow, with these tensors of `leaves_of`."""
    if isinstance(policy, Around):
        return FollowedAround(policy, followed(policy.policy, sim, like, leaves), sim, like)
    if isinstance(policy, Function):
        return AskedFunction(policy, sim, leaves)
    if isinstance(policy, Network):
        return FollowedNetwork(policy, leaves)
    if isinstance(policy, Linear):
        return FollowedLinear(policy, sim, like)
    return FollowedPlan(policy, sim, like)


def filled(policy: Any, sim: Simulator, leaves: Mapping[str, Tensor]) -> Any:
    """A policy for the kernels, with tensors in place of a function's arrays."""
    if isinstance(policy, Around):
        out = copy.copy(policy)
        out.policy = filled(policy.policy, sim, leaves)
        return out
    if isinstance(policy, Function):
        return AskedFunction(policy, sim, leaves).filled(leaves.values())
    return policy
