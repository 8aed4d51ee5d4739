"""Times as steps: as many as come nearest to a span, at least one and no more than can be counted."""

import math

from .checks import MOST
from .errors import ArgumentError


def nearest_steps(
    name: str,
    span: float,
    step_size: float,
    of: str = "step_size",
    *,
    error: type[ArgumentError] = ArgumentError,
) -> int:
    """The whole number of steps nearest to a span of time, a half up, as the kernels round.

    Args:
        name, of: what the span and the step size are called, for the error.
        span: [s].
        step_size: [s].
        error: that is raised.

    Raises:
        ArgumentError: less than half a step, so that nothing would run, or more steps than can be counted.
    """
    steps = span / step_size + 0.5
    if steps < 1.0:
        raise error(f"{name} is {span:g} s, less than half a step of {of} = {step_size:g} s; more is needed")
    if not steps <= MOST:
        raise error(
            f"{name} is {span:g} s, {steps:.3g} steps of {of} = {step_size:g} s; at most {MOST} are possible"
        )
    return math.floor(steps)
