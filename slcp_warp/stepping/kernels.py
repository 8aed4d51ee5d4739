"""The kernels of a simulator: those that step, and the specialised ones for all that only they can do."""

from typing import Any

from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.structure import MOST_ROWS

from .generic import GenericKernels
from .specialised import SpecialisedKernels
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
        self.fast_path = takes_fast_path(fast_path, s, spec.method, device, self.strategy)
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
