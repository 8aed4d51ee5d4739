"""A simulator's steps as dynamics."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from slcp_warp import Simulator
from slcp_warp.gradients import launches
from slcp_warp.gradients.tape import derivatives_exist
from slcp_warp.inputs.checks import attribute
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.kernels.control.backward.riccati_parts import WEIGHED
from slcp_warp.kernels.control.generic_rollouts import FOLLOW
from slcp_warp.kernels.derivatives.curvature import in_closed_form
from slcp_warp.kernels.step.rollout import make_transition
from slcp_warp.stepping.generic import GenericKernels

from .protocol import REQUIRED


class SimulatorDynamics:
    """The `Dynamics` of a simulator: its step, and the implicit derivatives of its solution."""

    def __init__(self, sim: Simulator) -> None:
        self.sim, self.params = sim, sim.params
        self.nx, self.nu, self.nw = sim.nx, sim.nu, launches.curved_outputs(sim.spec)
        self.dtype, self.device = sim.dtype, sim.device

    @property
    def second_is_dear(self) -> bool:
        """Whether second derivatives take several times as long as all else in a pass: where they are
        differences of the first, 4 (nx + nu) times as long as these.
        """
        return not in_closed_form(self.sim.options.method)

    def step_function(self) -> Any:
        """See `Dynamics`.

        Raises:
            StrategyError, OptionError: the simulator's steps have no derivatives.
        """
        self.sim.need_derivatives("the protocol of slcp_warp.ddp")
        return make_transition(self.sim.spec).advance

    def handed(self) -> tuple[Any, Any] | None:
        """The fast step and the full one behind it, as `make_transition` gives them; None: one for all."""
        both = getattr(self.sim.kernels.stepping, "both", None)
        return None if both is None else (make_transition(both[0]), make_transition(both[1]))

    def initial_carry(self) -> Any:
        """See `Dynamics`: a cold start."""
        return make_transition(self.sim.spec).cold_carry

    def linearize_into(self, *arrays: Any) -> None:
        """See `Dynamics`."""
        self.prepare_linearize(*arrays)()

    def prepare_linearize(
        self, xs: Any, us: Any, params: Any, fx: Any, fu: Any, second: Any, status: Any, active: Any
    ) -> Callable[[], None]:
        """See `Dynamics`."""
        derivatives_exist(self.sim.options.method)
        nowhere = wp.zeros((0, 0), dtype=self.dtype, device=self.device)
        fzz = wp.zeros((0, 0, 0, 0), dtype=self.dtype, device=self.device) if second is None else second
        outputs, wanted = (fx, fu, fzz, status), second is not None
        return self.sim.kernels.stepping.prepare_linearize(params, xs, us, nowhere, active, outputs, wanted)

    def lift_into(self, params: Any, lift: Any) -> None:
        """See `Dynamics`: of x' = (q + h v*, v') the outputs v* and v' are curved."""
        values = np.broadcast_to(launches.lift(self.sim.spec, params.numpy()[:, 0]), lift.shape)
        lift.assign(values.astype(wp.dtype_to_numpy(self.dtype)))

    def parameter_array(self, params: Any, batch: int) -> Any:
        """See `Dynamics`."""
        return self.sim.parameter_array(params, batch)


class GenericDynamics(SimulatorDynamics):
    """With generic kernels, whose step keeps a world in a workspace: they roll out themselves, and weigh
    second derivatives.
    """

    second_is_dear = True  # two to four times as long as all else in a pass

    def __init__(self, sim: Simulator) -> None:
        super().__init__(sim)
        self.nw = WEIGHED

    def lift_into(self, params: Any, lift: Any) -> None:
        """See `Dynamics`: nothing is left to be weighed."""

    def prepare_linearize(
        self, xs: Any, us: Any, params: Any, fx: Any, fu: Any, second: Any, status: Any, active: Any
    ) -> Callable[[], None]:
        """See `Dynamics`.

        Raises:
            ArgumentError: second derivatives that nobody weighs.
        """
        if second is not None:
            raise ArgumentError(
                f"second is an array of shape {second.shape}; None is needed: generic kernels weigh second "
                "derivatives, see prepare_weighed"
            )
        return super().prepare_linearize(xs, us, params, fx, fu, None, status, active)

    def prepare_weighed(
        self, xs: Any, us: Any, params: Any, fx: Any, fu: Any, second: Any, status: Any, active: Any,
        weights: Any, asked: Any,
    ) -> tuple[Callable[[], None], Callable[[], None]]:  # fmt: skip
        """See `Dynamics`."""
        kernels = self._kernels()
        derivatives_exist(self.sim.options.method)

        def none(*shape: int) -> Any:
            return wp.zeros(shape, dtype=self.dtype, device=self.device)

        given, own = (params, xs, us, none(0, 0)), wp.zeros_like(status)
        first = kernels.prepare_curvature(*given, active, none(0, 0, 0), (fx, fu, none(0, 0, 0, 0), status))
        outputs = none(1, 1, 0, 0), none(1, 1, 0, 0), second, own
        return first, kernels.prepare_curvature(*given, asked, weights, outputs)

    def _kernels(self) -> GenericKernels:
        kernels = self.sim.kernels.stepping
        assert isinstance(kernels, GenericKernels)
        return kernels

    def prepare_candidates(
        self, problems: int, items: int, offset: int, policy: Any, candidates: Any, params: Any,
        *, x0: Any, active: Any, mode: int = FOLLOW,
    ) -> Callable[[], None]:  # fmt: skip
        """A repeatable launch of rollouts offset, .., as of `kernels/control/generic_rollouts.py`."""
        nowhere = wp.zeros((0, 0), dtype=self.dtype, device=self.device)
        arrays = [problems, x0, policy, candidates, params, nowhere, active]
        return self._kernels().prepare_candidates(items, offset, mode, arrays)


def dynamics_of(given: Any) -> Any:
    """The `Dynamics` of what a problem is given: of a simulator its own, else the object itself.

    Raises:
        ArgumentTypeError: an object that is none.
    """
    if isinstance(given, Simulator):
        own = isinstance(given.kernels.stepping, GenericKernels)
        return GenericDynamics(given) if own else SimulatorDynamics(given)
    for name in REQUIRED:
        if attribute(given, name) is None:
            raise ArgumentTypeError(
                f"dynamics must have {name!r} (see ddp.Dynamics), {type(given).__name__} has not"
            )
    return given
