"""What a policy sees: some components of the state, or a user's function of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.policies.observed import (
    Seen,
    make_observation_kernel,
    observed_kernel,
    seen_function,
)

from ..description.names import index_of
from ..inputs.checks import attribute, function, shown, whole
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..inputs.user_code import Known, check_indices, of_user
from ..simulator import Simulator
from ..stepping.arguments import checked_kernel
from ..stepping.by_world import alike
from .saved import Content, content_of, policy_of

MOST = 1024  # numbers that a policy sees


@dataclass(frozen=True)
class Observation:
    """A user's function of the state, ``f(x) -> y``.

    Attributes:
        function: a Warp function of a vector x (nx,) that gives a vector (size,), or a function
            ``make(dtype, VX, VY) -> Warp function`` that gets the numbers' type and the two vector types.
        size: how many numbers it gives.
    """

    function: wp.Function | Callable[..., Any]
    size: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", whole("Observation.size", self.size, 1, MOST))
        if not isinstance(self.function, wp.Function):
            function("Observation.function", self.function, 3)
        elif len(self.function.input_types) != 1:
            came = ", ".join(self.function.input_types)
            raise ArgumentTypeError(f"Observation.function takes ({came}); (x) is needed")

    def of(self, x: np.ndarray) -> np.ndarray:
        """What it shows (B, size) of states (B, nx), computed on the CPU in their precision.

        Raises:
            ArgumentTypeError: a function that cannot be used.
        """
        dtype = wp.dtype_from_numpy(x.dtype)
        state: wp.array = wp.array(x, dtype=dtype, device="cpu")
        out: wp.array = wp.zeros((len(x), self.size), dtype=dtype, device="cpu")
        self.check(x.shape[1], dtype)
        kernel = make_observation_kernel(Seen(self.size, self.function), x.shape[1], dtype)
        launch(kernel, len(x), [state, out], "cpu")
        shown_of: np.ndarray = out.numpy()
        return shown_of

    def check(self, nx: int, dtype: Any) -> None:
        """Raise ArgumentTypeError, or of an index ArgumentError, for no function of so many states."""
        with of_user(f"Observation.function is no f(x) -> y of {nx} states for {dtype.__name__}"):
            function = seen_function(Seen(self.size, self.function), nx, dtype)
        check_indices("Observation.function", function, Known(nx))


class Observed:
    """A policy that sees an observation in place of the state; it is made for as many states as that has.

    Args:
        policy: any that a kernel evaluates and that is no follower of states (a plan, a library).
        of: names of states, or an `Observation`.

    Raises:
        ArgumentError, ArgumentTypeError: what is neither; with a simulator: names that its scene has not got.
    """

    def __init__(self, policy: Any, of: Any) -> None:
        if attribute(policy, "sees_states"):
            raise ArgumentError(
                f"policy is a {type(policy).__name__}, which follows states: it sees all of them; "
                "policies.Estimated gives it estimates of those that no sensor shows"
            )
        self.policy, self.of = policy, checked("of", of)
        self.worlds = attribute(policy, "worlds")

    @property
    def alike(self) -> bool:
        """Whether it acts by state and time alone in all worlds."""
        return alike(self.policy)

    def kernel(self, sim: Simulator) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator."""
        if isinstance(self.of, Observation):
            self.of.check(sim.nx, sim.dtype)
            seen, places = Seen(self.of.size, self.of.function), []
            names: Sequence[str] = [str(i) for i in range(self.of.size)]
        else:
            names, places = self.of, [sim.scene.state_index(name) for name in self.of]
            seen = Seen(len(places))
        inner, inside = checked_kernel(self.policy, _view(sim, names))
        kernel = observed_kernel(inner, seen)
        struct = kernel.functions(sim.nx, sim.nu, sim.dtype).Struct()
        struct.inner = inside
        struct.places = wp.array(np.array(places, np.int32), dtype=wp.int32, device=sim.device)
        return kernel, struct

    def content(self) -> Content:
        """What it is made from, see `saved`."""
        if isinstance(self.of, Observation):
            raise ArgumentError("policy sees a function of the state, which is no data")
        inside = content_of(self.policy).within("policy")
        return Content({"of": list(self.of)} | inside.values, inside.arrays)

    @classmethod
    def of_content(cls, content: Content) -> "Observed":
        """From what `content` gave."""
        return cls(policy_of(content.below("policy")), content.values["of"])


def checked(label: str, of: Any) -> Any:
    """An observation: names of states in a tuple, or an `Observation`."""
    if isinstance(of, Observation):
        return of
    if not isinstance(of, list | tuple) or not of or not all(isinstance(name, str) for name in of):
        raise ArgumentTypeError(
            f"{label} is {shown(of)}; names of states, or a policies.Observation, are needed"
        )
    if len(set(of)) < len(of):
        raise ArgumentError(f"{label} names a state twice: {shown(of)}")
    return tuple(of)


def _view(sim: Simulator, names: Sequence[str]) -> Any:
    """A simulator as a policy meets it whose states are these."""
    period = dict(zip(sim.scene.state_names, sim.scene.state_period))
    scene = SimpleNamespace(
        name=f"{sim.scene.name} (as observed)",
        state_period=np.array([period.get(name, 0.0) for name in names]),
        state_names=tuple(names),
        state_index=lambda which: index_of("observed component", which, names),
    )
    return SimpleNamespace(nx=len(names), nu=sim.nu, dtype=sim.dtype, device=sim.device, scene=scene)
