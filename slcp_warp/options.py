"""Options that select a kernel, and the status of a world."""

from dataclasses import dataclass
from enum import IntEnum

from slcp_warp.kernels import solve
from slcp_warp.kernels.method import Method

CHOICES = {
    "residual": ("rem-logistic", "hard"),
    "scaling": ("inertia", "none"),
    "friction": ("anitescu",),
    "integrator": ("euler", "trapezoidal"),
}


class OptionError(ValueError):
    """An option that is not offered; the message names it, what came and what there is."""


class Status(IntEnum):
    """How the step of a world ended; anything but SOLVED leaves the world in its last valid state."""

    SOLVED = solve.SOLVED
    NOT_CONVERGED = solve.NOT_CONVERGED
    INFEASIBLE = solve.INFEASIBLE
    NONFINITE = solve.NONFINITE


@dataclass(frozen=True)
class Options:
    """What the step solves.

    Attributes:
        residual: "rem-logistic", the smoothed problem (17), or "hard", the original one (3), sigma = 0.
        scaling: "inertia": D = diag(A), so that both arguments of the residual are velocities and results do
        not
            depend on the unit of mass; "none": D = 1, the paper's.
        friction: "anitescu", the relaxed planar model (the paper's [9]).
        integrator: "euler", eq. (1), first order; "trapezoidal", the linearly implicit method of footnote 1
            (the paper's [6]), second order where motion is smooth.
    """

    residual: str = "rem-logistic"
    scaling: str = "inertia"
    friction: str = "anitescu"
    integrator: str = "euler"

    def __post_init__(self) -> None:
        for name, choices in CHOICES.items():
            value = getattr(self, name)
            if value not in choices:
                raise OptionError(f"Options.{name} is {value!r}; choose one of {list(choices)}")

    @property
    def method(self) -> Method:
        """The options as the kernels take them."""
        return Method(self.residual, self.scaling, self.friction, self.integrator)

    @property
    def hard(self) -> bool:
        """Whether sigma = 0."""
        return self.method.hard
