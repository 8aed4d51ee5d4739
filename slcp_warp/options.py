"""Options that select a kernel, and the status of a world."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

from slcp_warp.kernels import status
from slcp_warp.kernels.method import Method

from .inputs.checks import choice, number, numeric, shown
from .inputs.errors import ArgumentError

CHOICES: dict[str, tuple[Any, ...]] = {
    "residual": ("rem-logistic", "rem-normal", "erm-logistic", "erm-normal", "hard"),
    "scaling": ("inertia", "none"),
    "friction": ("anitescu", "coulomb"),
    "integrator": ("euler", "trapezoidal", "leapfrog"),
    "noise": ("row", "state"),
    "deviation": (None, "scale", "standard-deviation"),
    "gap": ("start", "end"),
}
TOLERANCES = (1e-15, 0.1)  # least and largest of Options.tolerance


class OptionError(ArgumentError):
    """An option that is not offered; the message names it, what came and what there is."""


class Status(IntEnum):
    """How the step of a world ended; anything but SOLVED leaves the world in its last valid state.

    SOLVED: the impulses and v' that are returned satisfy M dv = J' lambda and the contact law, to an accuracy
    that is relative to what the data sets (J v_free, d/h, sigma, of bodies that hang together or touch),
    never to the answer. INFEASIBLE: no velocity opens the rows: limits and normal rows, with Anitescu's
    friction the rows J_n +- mu J_t. JAMMED: some velocity opens limits and normal rows, but Coulomb's
    friction holds against every impulse, so that the problem of the paper's [8] has no solution
    (docs/understand/friction.md says how that is proved). NONFINITE: a state or force that is no number, or a
    mass matrix (or that of the trapezoidal method) without digits. NOT_CONVERGED: the solver gave up; there
    may be a solution or none.
    """

    SOLVED = status.SOLVED
    NOT_CONVERGED = status.NOT_CONVERGED
    INFEASIBLE = status.INFEASIBLE
    NONFINITE = status.NONFINITE
    JAMMED = status.JAMMED


@dataclass(frozen=True)
class Options:
    """What the step solves; equations (M..) are those of docs/understand/mathematics.md.

    Attributes:
        residual: "rem-logistic", the smoothed problem (17), (M9); "rem-normal", its twin for normal noise
            (footnote 3); "erm-normal" (15) and "erm-logistic" (footnote 3), the least expected square (M10),
            not convex; or "hard", the original one (3), sigma = 0.
        scaling: "inertia": D = diag(A) (M17), so that both arguments of the residual are velocities and
            results do not depend on the unit of mass; "none": D = 1, the paper's.
        friction: "anitescu", the relaxed planar model (M7), the paper's [9]: convex, lifts sliding contacts;
            "coulomb", exact planar friction (M8), the paper's [8], for the hard problem only.
        integrator: "euler" (M1), first order; "trapezoidal" (M23), (M24), the linearly implicit method of
            footnote 1 (the paper's [6]), second order where motion is smooth, in specialised kernels;
            "leapfrog" (M63), Euler's with the mean of the Coriolis forces before and after the step: only
            forces and contacts change momentum, to second order. Its velocities are those half a step before
            its places. In generic kernels.
        noise: "row", a constant sigma for every row; "state", eq. (18), (M18): sigma follows in every step
            from the parameters position_covariance and velocity_covariance, (nv, nv).
        deviation: what sigma is to a logistic residual, the distribution's "scale" or its
            "standard-deviation" (scale = sqrt(3)/pi of it). None: the scale for noise "row" (the paper's use
            of (17)), the standard deviation for "state", as (18) gives it. Other residuals always take a
            standard deviation.
        tolerance: residual, relative to the size of its terms, at which Newton's iteration stops, in
            [1e-15, 0.1]; never below rounding. None: rounding (2e-14, float32: 1e-6). A coarser one makes v',
            lambda and all derivatives as coarse. For REM and hard residuals with Anitescu's friction.
        gap: "start", w = J v' + d/h (M2): the gap and its slope at the start of the step; "end", w =
            d(q + h v')/h (M25), to 1e-8 m/s (float32: 3e-5, and 4e-7 m/h of positions' rounding) by at most
            24 corrections, else NOT_CONVERGED: curved shapes that slide on each other do not sink in. For the
            hard problem; no derivatives.
        depenetration_speed: None, an overlap is pushed out in one step, w = J v' + d/h (M2), and rows that
            find no way are INFEASIBLE or JAMMED; or a largest speed of it [m/s, limits of joints rad/s],
            finite and not negative, w = J v' + max(d/h, -speed) (M60), and where the rows of bodies that hang
            together or touch find no way, their overlaps stay for the step, w = J v' + max(d/h, 1e-4 sigma).
            Offered by the generic kernels alone.
    """

    residual: str = "rem-logistic"
    scaling: str = "inertia"
    friction: str = "anitescu"
    integrator: str = "euler"
    noise: str = "row"
    deviation: str | None = None
    tolerance: float | None = None
    gap: str = "start"
    depenetration_speed: float | None = None

    def __post_init__(self) -> None:
        for name, choices in CHOICES.items():
            choice(f"Options.{name}", getattr(self, name), choices, error=OptionError)
        if self.noise == "state" and (self.method.hard or self.method.erm):
            why = "has no noise" if self.method.hard else "has no derivatives by sigma here"
            raise OptionError(
                f"Options.noise is 'state' with residual {self.residual!r}, which {why}; use a rem- residual"
            )
        if self.friction == "coulomb" and self.residual != "hard":
            raise OptionError(
                f"Options.friction is 'coulomb' with residual {self.residual!r}; Coulomb's friction has no "
                "smoothed form here: use residual='hard', or friction='anitescu'"
            )

        if self.gap == "end" and self.residual != "hard":
            raise OptionError(
                f"Options.gap is 'end' with residual {self.residual!r}; it is offered for residual='hard'"
            )
        self._check_tolerance()
        if self.depenetration_speed is not None:
            speed = number("Options.depenetration_speed", self.depenetration_speed, 0.0, error=OptionError)
            object.__setattr__(self, "depenetration_speed", speed)

    def _check_tolerance(self) -> None:
        """Raise OptionError for a tolerance out of range, or of a solver that has none."""
        tolerance = self.tolerance
        if tolerance is None:
            return
        found = numeric(tolerance)
        low, high = TOLERANCES
        if found is None or found.ndim or not low <= found <= high:
            raise OptionError(
                f"Options.tolerance is {shown(tolerance)}; a number in [{low:g}, {high:g}] or None is needed"
            )
        if self.method.erm or self.method.coulomb:
            which = f"friction {self.friction!r}" if self.method.coulomb else f"residual {self.residual!r}"
            raise OptionError(
                f"Options.tolerance is {tolerance!r} with {which}, whose solver has a tolerance of its own; "
                "leave it None"
            )

    @property
    def method(self) -> Method:
        """The options as the kernels take them."""
        deviation = self.deviation or ("standard-deviation" if self.noise == "state" else "scale")
        tolerance = None if self.tolerance is None else float(self.tolerance)
        return Method(self.residual, self.scaling, self.friction, self.integrator, self.noise, deviation,
                      tolerance, self.gap, self.depenetration_speed)  # fmt: skip

    def with_residual(self, residual: str) -> "Options":
        """The same with another residual, without what is not offered with it."""
        own: dict[str, Any] = {"residual": residual}
        hard, erm = residual == "hard", residual.startswith("erm")
        own |= {"noise": "row"} if hard or erm else {}
        own |= {"deviation": None} if hard else {"friction": "anitescu", "gap": "start"}
        own |= {"tolerance": None, "depenetration_speed": None} if erm else {}
        own |= {"integrator": "euler"} if erm and self.integrator == "leapfrog" else {}
        return replace(self, **own)

    @property
    def hard(self) -> bool:
        """Whether sigma = 0."""
        return self.method.hard
