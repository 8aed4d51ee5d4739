"""Policies that are asked about the state in which their control acts, and know of no delay themselves."""

from typing import Any

from ...inputs.checks import attribute
from ...inputs.errors import ArgumentError


def foreseeing(policy: Any, late: float) -> Any:
    """A policy whose steps are those in which its controls act, of one that sends them `late` seconds before.

    Raises:
        ArgumentError: one that foresees by itself, or that sends its controls earlier or later than that.
    """
    if attribute(policy, "lag"):
        raise ArgumentError(
            f"foresee is True, and policy is a {type(policy).__name__} with a lag of {policy.lag}: it looks "
            "ahead by itself; foresee=False, or a policy without a lag, is needed"
        )
    early = (attribute(policy, "early") or 0) * (attribute(policy, "step_size") or 0.0)
    if not early:
        return policy
    if abs(early - late) > 1e-9 + 1e-6 * late:
        raise ArgumentError(
            f"policy is a plan whose controls act {early:g} s after they are sent, and by lag {late:g} s "
            "after; the same is needed"
        )
    return policy.foreseeing()
