"""Arguments of a simulator's calls, checked, as arrays of its sizes and precision on its device."""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP, make_open_loop
from slcp_warp.kernels.structure import Structure

from ..gradients import tape
from ..inputs import checks
from ..inputs.arrays import ArrayError, Batch, for_all, same_worlds, to_batch, zeros
from ..inputs.checks import shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from .arrays import Controls
from .by_world import check_rows
from .host import acts_on_host


class Arguments:
    """What the calls of one simulator are given.

    Attributes:
        none: an array of no worlds: forces, multipliers that were not given.
    """

    def __init__(self, structure: Structure, dtype: Any, device: wp.Device) -> None:
        self.structure, self.dtype, self.device = structure, dtype, device
        self.nx, self.nu = 2 * structure.nv, structure.nu
        self.none = wp.zeros((0, 0), dtype=dtype, device=device)

    def empty(self, *shape: int) -> wp.array:
        """A zeroed array."""
        return zeros(shape, self.dtype, self.device)

    def unknown(self, worlds: int, steps: int, size: int) -> wp.array:
        """An array (B, N, size) for what steps leave behind, NaN until one has; of no size (B, N, 1), 0."""
        out = self.empty(worlds, steps, max(size, 1))
        if size:
            out.fill_(np.nan)
        return out

    def status(self, worlds: int) -> wp.array:
        """A status (B,), SOLVED."""
        return wp.zeros(worlds, dtype=wp.int32, device=self.device)

    def batch(self, name: str, value: Any, *shape: int | str) -> Batch:
        """An argument of a shape, not counting its batch axis."""
        return to_batch(name, value, shape, self.dtype, self.device)

    def external_force(self, given: Any, worlds: int) -> wp.array:
        """Forces and torques (B, 3 bodies), none of (0, 0)."""
        if given is None:
            return self.none
        nb = self.structure.nb
        force = self.batch("external_force", given, nb, 3).array
        tape.refuse("external_force", "forces have none: give them as controls of an actuator", force)
        same_worlds("external_force", force.shape[0], worlds)
        return force.contiguous().reshape((worlds, 3 * nb))

    def control(self, given: Any, worlds: int) -> wp.array:
        """Controls of one step (B, max(nu, 1)), zero where none are given."""
        if given is None:
            return self.empty(worlds, max(self.nu, 1))
        control = for_all("u", self.batch("u", given, self.nu), worlds)
        return control if self.nu else self.empty(worlds, 1)

    def warm_start(self, given: Any, worlds: int) -> wp.array:
        """Multipliers (B, nr + 2 pairs), none of (0, 0)."""
        if given is None:
            return self.none
        width = self.structure.nr + 2 * len(self.structure.pairs)
        warm = self.batch("warm_start", given, width).array
        same_worlds("warm_start", warm.shape[0], worlds)
        return warm

    def nothing(self, steps: Any, worlds: int) -> np.ndarray:
        """The controls of a scene without actuators, (B, N, 0)."""
        steps = checks.whole("steps", steps)
        checks.memory(f"steps = {steps}: the states", worlds * (steps + 1) * self.nx, 8, self.device)
        return np.zeros((worlds, steps, 0))

    def open_loop(self, given: Any, steps: Any, worlds: int) -> Controls:
        """Controls of a rollout (B, N, nu); steps: N again, or None."""
        us = for_all("controls", self.batch("controls", given, "N", self.nu), worlds)
        struct = make_open_loop(self.nx, self.nu, self.dtype).Struct()
        struct.us = us
        if steps is not None and checks.whole("steps", steps) != us.shape[1]:
            raise ArgumentError(f"steps is {steps}, but controls are given for {us.shape[1]}; leave it out")
        if us.shape[1] < 1:
            raise ArrayError(f"controls has shape {us.shape}; at least one step is needed")
        return Controls(OPEN_LOOP, struct, us.shape[1], us)


def checked_kernel(policy: Any, sim: Any) -> tuple[PolicyKernel, Any]:
    """Kernel and struct of a policy."""
    if acts_on_host(policy):
        raise ArgumentTypeError(
            f"policy is a {type(policy).__name__}, which acts on the host: it runs by itself, in rollouts "
            "and sweeps; one that runs in a kernel is needed"
        )
    if isinstance(policy, type) or not callable(checks.attribute(policy, "kernel")):
        raise ArgumentTypeError(
            f"policy is a {type(policy).__name__}; a policy is needed, one of slcp_warp.policies, "
            "ddp.TrackingPolicy(plan) or library.policy()"
        )
    given = policy.kernel(sim)
    if not isinstance(given, tuple) or len(given) != 2 or not isinstance(given[0], PolicyKernel):
        raise ArgumentTypeError(f"policy.kernel gave {shown(given)}; (PolicyKernel, struct) is needed")
    kernel, struct = given
    if getattr(struct, "_cls", None) is not kernel.functions(sim.nx, sim.nu, sim.dtype).Struct:
        raise ArgumentTypeError(
            f"policy.kernel gave {shown(struct)} with {kernel.key!r}; the Struct of its functions for "
            f"{sim.nx} states, {sim.nu} controls and {sim.dtype.__name__} is needed"
        )
    return kernel, struct


def at_step_size(policy: Any, step_sizes: Any) -> Any:
    """A policy for steps of these sizes [s]; a plan that was made for another one is followed in time.

    Raises:
        ArgumentError: a plan of a step size, and worlds of several.
    """
    own, sizes = checks.attribute(policy, "step_size"), np.ravel(step_sizes)
    if not isinstance(own, float) or np.allclose(sizes, own, rtol=1e-6, atol=0.0):
        return policy
    if np.ptp(sizes) > 0.0:
        raise ArgumentError(
            f"policy is a plan of steps of {own:g} s; the worlds' are {sizes.min():g} to {sizes.max():g} s, "
            "and one for all is needed"
        )
    return policy.at(float(sizes[0]))


def policy_arrays(policy: Any, sim: Any, worlds: int | None) -> tuple[PolicyKernel, Any]:
    """Kernel and struct of a policy, for so many worlds (None: for any number)."""
    kernel, struct = checked_kernel(policy, sim)
    check_rows(kernel, struct, sim, worlds)
    return kernel, struct
