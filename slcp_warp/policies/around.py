"""What lies between a policy and its world."""

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.policies.around import SENSOR, Between, around_kernel
from slcp_warp.kernels.policies.contract import PolicyKernel

from ..inputs.checks import array, attribute, number, shown, whole
from ..inputs.errors import ArgumentError
from ..inputs.limits import any_limits, bounded, limit_rows
from ..simulator import Simulator
from ..stepping.arguments import checked_kernel
from ..stepping.by_world import alike
from .saved import Content, content_of, policy_of

LONGEST = 256
DELAYS = (0, 4, 16, 64, LONGEST)  # steps that there are kernels for: shorter delays share them
LIMITS = ("lower", "upper")


def controls_before(name: str, before: Any, nu: int) -> np.ndarray:
    """(nu,) controls from what was given of them, one number for all or none.

    Raises:
        ArgumentError: another number of controls.
    """
    given = np.zeros(()) if before is None else array(name, before)
    if given.shape not in ((), (nu,)):
        raise ArgumentError(f"{name} has shape {given.shape}; a number, or ({nu},), is needed")
    return np.array(np.broadcast_to(given, (nu,)))


class Around:
    """A policy behind a noisy sensor, a hold, a delay and limits, in this order.

    Args:
        policy: any that a kernel evaluates.
        limits: (lower, upper) of the controls, each a number or (nu,); None: none beside a task's.
        delay: steps from a control to its action, at most 256; `before` acts until the first does.
        hold: steps that a control is held; the policy is asked in steps 0, hold, 2 hold, ... only.
        noise: standard deviations of white noise on the state that the policy sees, by state name, (nx,), or
            one for all; None: none.
        seed: of the noise, which depends on it, the world's number, the step, and on how many are inside.
        before: controls (nu,), or one number for all, until the first that is sent acts; None: zero.

    Raises:
        ArgumentError: what is out of range, or with a simulator of another size or unknown.
    """

    def __init__(
        self,
        policy: Any,
        limits: Any = None,
        delay: int = 0,
        hold: int = 1,
        noise: Any = None,
        seed: int = 0,
        before: Any = None,
    ) -> None:
        self.policy, self.limits = policy, any_limits(limits, "limits")
        self.worlds = getattr(policy, "worlds", 1)
        self.step_size = attribute(policy, "step_size")
        self.delay, self.hold = whole("delay", delay, 0, LONGEST), whole("hold", hold)
        self.seed = whole("seed", seed, 0)
        self.before = None if before is None else array("before", before)
        self.noise = noise
        if isinstance(noise, Mapping):
            self.noise = {name: number(f"noise[{name!r}]", sd, 0.0) for name, sd in noise.items()}
        elif noise is not None:
            self.noise = array("noise", noise)
            if (self.noise < 0.0).any() or self.noise.ndim > 1:
                raise ArgumentError(f"noise is {shown(noise)}; standard deviations, not negative, are needed")

    @property
    def alike(self) -> bool:
        """Whether it acts by state and time alone in all worlds: noise follows from a world's number."""
        sds = [*self.noise.values()] if isinstance(self.noise, Mapping) else self.noise
        return alike(self.policy) and (sds is None or not np.any(sds))

    @property
    def early(self) -> int:
        """Steps by which a plan inside sends its controls before they act."""
        return attribute(self.policy, "early") or 0

    def foreseeing(self) -> "Around":
        """The same around a plan that is asked about the states in which its controls act."""
        out = copy.copy(self)
        out.policy = self.policy.foreseeing()
        return out

    def at(self, step_size: float) -> "Around":
        """The same around a plan for steps of another size [s]; delay and hold stay as many steps."""
        out = copy.copy(self)
        out.policy, out.step_size = self.policy.at(step_size), step_size
        return out

    def kernel(self, sim: Simulator, timed: bool = False) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator; `timed`: delay and hold are the most that a world has."""
        inner, inside = checked_kernel(self.policy, sim)
        noise, (lower, upper) = self.deviations(sim), limit_rows(self.limits, sim.nu)
        if len(lower) != 1:
            raise ArgumentError(f"limits are for {len(lower)} worlds; one pair for all is needed")
        most = min(steps for steps in DELAYS if steps >= self.delay)
        kernel = around_kernel(inner, Between(most, self.hold > 1, bool(noise.any())), timed)
        struct = kernel.functions(sim.nx, sim.nu, sim.dtype).Struct()
        struct.inner, struct.delay, struct.hold = inside, self.delay, self.hold
        struct.seed, struct.stream = self.seed, self.stream(sim.nx)
        limits = (lower[0], upper[0]) if bounded(lower, upper) else ([], [])
        before: Any = self.controls_before(sim.nu) if self.before is not None and self.delay else []
        numbers = (("noise", noise), ("lower", limits[0]), ("upper", limits[1]), ("before", before))
        for name, values in numbers:
            setattr(struct, name, wp.array(np.asarray(values, float), dtype=sim.dtype, device=sim.device))
        return kernel, struct

    def stream(self, nx: int) -> int:
        """The first stream of its noise: each inside has its own."""
        inside, policy = 0, self.policy
        while isinstance(policy, Around):
            inside, policy = inside + 1, policy.policy
        return SENSOR + inside * nx

    def content(self) -> Content:
        """What it is made from, see `saved`."""
        values: dict[str, Any] = {"delay": self.delay, "hold": self.hold, "seed": self.seed}
        arrays = {}
        if self.limits is not None:
            arrays = {name: np.asarray(v, float) for name, v in zip(LIMITS, self.limits)}
        if isinstance(self.noise, Mapping):
            values["noise"] = dict(self.noise)
        elif self.noise is not None:
            arrays["noise"] = self.noise
        if self.before is not None:
            arrays["before"] = self.before
        inside = content_of(self.policy).within("policy")
        return Content(values | inside.values, arrays | inside.arrays)

    @classmethod
    def of_content(cls, content: Content) -> "Around":
        """From what `content` gave."""
        values, arrays = content
        limits = tuple(arrays[name] for name in LIMITS) if set(LIMITS) & set(arrays) else None
        between = {name: values[name] for name in ("delay", "hold", "seed")}
        noise = values.get("noise", arrays.get("noise"))
        before = arrays.get("before")
        return cls(policy_of(content.below("policy")), limits, noise=noise, before=before, **between)

    def controls_before(self, nu: int) -> np.ndarray:
        """(nu,) what acts until the first control that is sent does, of a simulator's controls."""
        return controls_before("before", self.before, nu)

    def deviations(self, sim: Simulator) -> np.ndarray:
        """Standard deviations (nx,) of the noise on a simulator's states."""
        out = np.zeros(sim.nx)
        if isinstance(self.noise, Mapping):
            for name, deviation in self.noise.items():
                out[sim.scene.state_index(name)] = deviation
        elif self.noise is not None:
            if self.noise.shape not in ((), (sim.nx,)):
                raise ArgumentError(
                    f"noise has shape {self.noise.shape}; scene {sim.scene.name!r} needs ({sim.nx},)"
                )
            out[:] = self.noise
        return out
