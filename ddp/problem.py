"""A batch of optimal control problems that differ in numbers only."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import warp as wp

from slcp_warp import Parameters, Simulator
from slcp_warp.costs.terms import with_points_of
from slcp_warp.inputs.checks import whole
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.inputs.limits import limit_rows
from slcp_warp.policies.around import controls_before
from slcp_warp.results.simulated import Simulated

from .costs import Cost
from .dynamics import dynamics_of


@dataclass(frozen=True, eq=False)
class Problem:
    """Minimise the cost of N steps of a dynamics (M32), from a given state.

    Attributes:
        dynamics: a `slcp_warp.Simulator`, or a `Dynamics`.
        cost: a `Cost`.
        horizon: number of steps N.
        params: the dynamics' numbers, default its own.
        control_limits: (lower, upper), each a number, (nu,) or (B, nu), infinite where there is none; or
            None.
        state_limits: likewise of the states, (nx,) or (B, nx): they hold at every step but the first, to the
            options' ``limit_tolerance``; or None.
        before: controls that act until the first that is sent does, (nu,) or one number for all, where
            controls are late (`Result.delay`, `MPC(lag=)`); None: zero. Within the limits.
    """

    dynamics: Any
    cost: Cost
    horizon: int
    params: Any = None
    control_limits: Any = None
    state_limits: Any = None
    before: Any = None

    def __post_init__(self) -> None:
        dynamics_of(self.dynamics)
        if not isinstance(self.cost, Cost):
            raise ArgumentTypeError(f"cost must be a ddp.Cost, got {type(self.cost).__name__}")
        for name, need in (("nx", self.cost.nx), ("nu", self.cost.nu)):
            if need is not None and need != getattr(self.dynamics, name):
                raise ArgumentError(
                    f"cost is for {name} = {need}, the dynamics has {name} = {getattr(self.dynamics, name)}"
                )
        scene = self.dynamics.scene if isinstance(self.dynamics, Simulator) else None
        if scene is not None and with_points_of(self.cost, scene) is not self.cost:
            raise ArgumentError(
                "cost is of points of bodies with other joints or lengths than those of scene "
                f"{scene.name!r}; make it by costs.terms of this scene"
            )
        object.__setattr__(self, "horizon", whole("horizon", self.horizon))
        if self.cost.nodes is not None and self.cost.nodes != self.horizon + 1:
            raise ArgumentError(
                f"cost is for {self.cost.nodes} nodes, horizon {self.horizon} has {self.horizon + 1}"
            )
        if self.params is None:
            object.__setattr__(self, "params", self.dynamics.params)
        elif not isinstance(self.params, wp.array | type(self.dynamics.params)):
            raise ArgumentTypeError(
                f"params is a {type(self.params).__name__}; parameters of the dynamics are needed"
            )
        if self.cost.windows is not None:
            object.__setattr__(self, "cost", self.cost.in_steps_of(self._step_size()))
        if self.control_limits is not None:
            self.limit_rows()
        if self.state_limits is not None:
            self.state_limit_rows()
        controls_before("before", self.before, self.nu)

    def _step_size(self) -> float:
        """Of all problems [s]; terms of the cost that count for a time need it."""
        sizes = np.unique(self.params["step_size"]) if isinstance(self.params, Parameters) else np.empty(0)
        if len(sizes) != 1:
            raise ArgumentError(
                f"cost has terms for a time, and params {len(sizes)} step sizes; parameters of a Simulator "
                "with one step size are needed"
            )
        return float(sizes[0])

    def differs_by_weights(self, other: "Problem") -> bool:
        """Whether another problem is this one but for numbers of its cost."""
        same = all(
            getattr(self, each.name) is getattr(other, each.name)
            for each in fields(self)
            if each.name not in ("cost", "horizon")
        )
        shapes = self.cost.weights.shape == other.cost.weights.shape
        return same and self.horizon == other.horizon and self.cost.make is other.cost.make and shapes

    @property
    def nx(self) -> int:
        """Number of states."""
        return int(self.dynamics.nx)

    @property
    def nu(self) -> int:
        """Number of controls."""
        return int(self.dynamics.nu)

    @property
    def quick_method(self) -> str:
        """Of `Options.method`: "gauss-newton" where second derivatives take several times as long as all else
        in a pass (generic kernels, and where they are differences of first ones); else "second-order".
        """
        dear = isinstance(self.dynamics, Simulator) and dynamics_of(self.dynamics).second_is_dear
        return "gauss-newton" if dear else "second-order"

    def simulated(self) -> Simulated | None:
        """Scene, options and parameters of a simulator with parameters of its own kind; else None."""
        known = isinstance(self.dynamics, Simulator) and isinstance(self.params, Parameters)
        return Simulated.of(self.dynamics, self.params) if known else None

    def with_params(self, **changes: Any) -> "Problem":
        """The same problem with some of the dynamics' numbers changed; nothing is compiled."""
        return replace(self, params=self.params.replace(**changes))

    def limit_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper control limits (1 or B, nu), infinite where there is none.

        Raises:
            ValueError: wrong shapes, NaN, or a lower limit above an upper one.
        """
        return limit_rows(self.control_limits, self.nu)

    def rest_control(self) -> np.ndarray:
        """(1 or B, nu) the controls before the first one acts: `before`, or zero, within the limits."""
        return np.clip(controls_before("before", self.before, self.nu), *self.limit_rows())

    def state_limit_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of the states (1 or B, nx), infinite where there is none.

        Raises:
            ValueError: as of `limit_rows`.
        """
        return limit_rows(self.state_limits, self.nx, "state_limits")

    def param_array(self, batch: int) -> Any:
        """The dynamics' numbers on the device, (1 or B, P)."""
        given = self.params
        array = given if isinstance(given, wp.array) else self.dynamics.parameter_array(given, batch)
        if array.ndim != 2 or array.shape[0] not in (1, batch):
            raise ArgumentError(f"params must have 1 or {batch} rows, got shape {array.shape}")
        return array
