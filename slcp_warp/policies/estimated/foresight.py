"""Policies that are asked about the state in which their control acts, and know of no delay themselves."""

import math
from typing import Any

from ...inputs.checks import attribute
from ...inputs.errors import ArgumentError


def foreseeing(policy: Any, delay: float) -> Any:
    """A policy whose steps are those in which its controls act, where these are `delay` seconds late.

    Raises:
        ArgumentError: one that foresees by itself, or a plan for another delay.
    """
    if attribute(policy, "lag"):
        raise ArgumentError(
            f"foresee is True, and policy is a {type(policy).__name__} with a lag of {policy.lag}: it looks "
            "ahead by itself; foresee=False, or a policy without a lag, is needed"
        )
    early, h = attribute(policy, "early") or 0, attribute(policy, "step_size")
    if not early or not callable(attribute(policy, "foreseeing")):
        return policy
    steps = early if h is None else math.floor(delay / h + 0.5)
    if steps != early:
        raise ArgumentError(
            f"delay is {delay:g} s, {steps} steps of the plan, whose controls were planned to act {early} "
            "steps after they are sent; the same is needed"
        )
    return policy.foreseeing()
