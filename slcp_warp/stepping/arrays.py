"""The arrays of a step and of a rollout, as their kernels take them."""

from dataclasses import dataclass, fields
from typing import Any

import warp as wp

from slcp_warp.kernels.policies.contract import PolicyKernel

from .host import Asked


@dataclass(frozen=True)
class StepArrays:
    """What the kernels of a step read and write, in their order."""

    table: wp.array  # (1 or B, P) parameters
    x: wp.array  # (B, nx)
    u: wp.array  # (B, nu)
    external: wp.array  # (0 or B, 3 nb)
    warm: wp.array  # (0 or B, nr + 2 pairs)
    state: wp.array  # out (B, nx)
    impulse: wp.array  # out (B, nr)
    gap: wp.array  # out (B, nr)
    multiplier: wp.array  # out (B, nr + 2 pairs)
    status: wp.array  # out (B,)

    @property
    def worlds(self) -> int:
        """B."""
        return int(self.x.shape[0])

    def in_order(self) -> list[Any]:
        """As the kernels take them."""
        return [getattr(self, field.name) for field in fields(self)]


@dataclass(frozen=True)
class Controls:
    """Where the controls of a rollout come from.

    Attributes:
        policy: what the kernel evaluates, OPEN_LOOP for given controls; or a policy on the host.
        struct: its arrays.
        steps: N.
        us: the given controls (B, N, nu), None under a policy.
    """

    policy: PolicyKernel | Asked
    struct: Any
    steps: int
    us: wp.array | None = None


@dataclass(frozen=True)
class RolloutArrays:
    """What the kernels of a rollout read and write; `controls`, `impulse` and `gap` may be of no worlds."""

    table: wp.array  # (1 or B, P) parameters
    x0: wp.array  # (B, nx)
    external: wp.array  # (0 or B, 3 nb)
    states: wp.array  # out (B, N+1, nx)
    controls: wp.array  # out (0 or B, N, nu)
    impulse: wp.array  # out (0 or B, N, nr)
    gap: wp.array  # out (0 or B, N, nr)
    status: wp.array  # in and out (B,)

    @property
    def worlds(self) -> int:
        """B."""
        return int(self.x0.shape[0])

    def in_order(self, control: Any) -> list[Any]:
        """As the kernels take them, with a policy's struct or given controls."""
        outputs = [self.states, self.controls, self.impulse, self.gap, self.status]
        return [self.table, self.x0, control, self.external, *outputs]
