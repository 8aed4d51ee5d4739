"""The kernels of a simulator: those that step, and the specialised ones for all that only they can do."""

from typing import Any

import warp as wp

from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.structure import MOST_ROWS

from ..gradients import tape
from .arrays import Controls
from .generic import GenericKernels
from .host import Asked
from .specialised import SpecialisedKernels, taped_policy
from .strategy import StrategyError, choose, takes_fast_path


class Kernels:
    """Kernels by strategy, for one scene, precision and method, on one device.

    Attributes:
        strategy: which kernels step.
        stepping: these kernels.
        fast_path: whether specialised kernels without last resorts step first.
    """

    def __init__(
        self, scene_name: str, spec: Specialisation, device: Any, strategy: str, fast_path: bool | None
    ) -> None:
        s = spec.structure
        self.strategy = choose(strategy, s, spec.method, device)
        self._name, self._spec = scene_name, spec
        self.fast_path = takes_fast_path(fast_path, s, spec.method, device)
        self._specialised = SpecialisedKernels(spec, device, self.fast_path)
        generic = self.strategy == "generic"
        self._only_generic = generic and (strategy != "auto" or s.nr > MOST_ROWS)
        self.stepping: SpecialisedKernels | GenericKernels = (
            GenericKernels(spec, device) if generic else self._specialised
        )

    def specialised(self, what: str) -> SpecialisedKernels:
        """The specialised kernels, which `what` needs.

        Raises:
            StrategyError: the scene has none, or was not meant to use them.
        """
        if self._only_generic:
            s = self._spec.structure
            raise StrategyError(
                f"{what} needs specialised kernels; scene {self._name!r} ({s.nv} degrees of freedom, {s.nr} "
                "rows) runs with the generic ones"
            )
        return self._specialised

    def rolling_out(
        self, controls: Controls, table: wp.array, x0: wp.array
    ) -> SpecialisedKernels | GenericKernels:
        """The kernels that roll out with these controls: under a policy specialised ones, if any."""
        if isinstance(controls.policy, Asked):
            return self.stepping
        if controls.us is None:
            if self._only_generic and not taped_policy(controls, x0, table):
                return self.stepping
            return self.specialised("a gradient on a wp.Tape")
        return self.stepping_from(table, x0, controls.us)

    def stepping_from(self, *arrays: wp.array) -> SpecialisedKernels | GenericKernels:
        """The kernels that step from these arrays: the specialised ones where a tape follows them."""
        if self.stepping is not self._specialised and tape.wants_gradient(*arrays):
            return self.specialised("a gradient on a wp.Tape")
        return self.stepping
