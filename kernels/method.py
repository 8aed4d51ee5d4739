"""What the step solves, as a value that selects a specialised kernel."""

from dataclasses import dataclass

REM = ("rem-logistic", "rem-normal")
ERM = ("erm-logistic", "erm-normal")


@dataclass(frozen=True)
class Method:
    """What `slcp_warp.Options` chooses.

    `part` no user chooses: "fast" kernels lack the last resorts of their solvers, and leave the steps that
    need one to those of the "rest" (`device/relay.py`).
    """

    residual: str = "rem-logistic"
    scaling: str = "inertia"
    friction: str = "anitescu"
    integrator: str = "euler"
    noise: str = "row"
    deviation: str = "scale"
    tolerance: float | None = None
    gap: str = "start"
    depenetration_speed: float | None = None
    part: str = "whole"

    @property
    def fast(self) -> bool:
        """Whether last resorts are left to other kernels."""
        return self.part == "fast"

    @property
    def rest(self) -> bool:
        """Whether few steps are made, so that compiling soon is worth more: last resorts are not inlined."""
        return self.part == "rest"

    @property
    def hard(self) -> bool:
        """Whether sigma = 0, eq. (3)."""
        return self.residual == "hard"

    @property
    def rem(self) -> bool:
        """Whether the residual is the root of an expectation, eq. (17) or footnote 3."""
        return self.residual in REM

    @property
    def erm(self) -> bool:
        """Whether the residual is an expected square, eq. (15) or footnote 3."""
        return self.residual in ERM

    @property
    def inertia_scaling(self) -> bool:
        """Whether D = diag(A); else D = 1."""
        return self.scaling == "inertia"

    @property
    def coulomb(self) -> bool:
        """Whether friction is Coulomb's (the paper's [8]); else Anitescu's relaxation ([9])."""
        return self.friction == "coulomb"

    @property
    def trapezoidal(self) -> bool:
        """Whether the free motion is integrated by the linearly implicit trapezoidal method ([6])."""
        return self.integrator == "trapezoidal"

    @property
    def leapfrog(self) -> bool:
        """Whether Coriolis forces are the mean of those at the velocities before and after a step."""
        return self.integrator == "leapfrog"

    @property
    def end_gap(self) -> bool:
        """Whether rows hold the gap at the end of the step; else its linearisation at the start."""
        return self.gap == "end"

    @property
    def state_noise(self) -> bool:
        """Whether sigma follows from covariances of the state, eq. (18); else it is given for every row."""
        return not self.hard and self.noise == "state"

    @property
    def converts(self) -> bool:
        """Whether sigma is the standard deviation of a logistic distribution and not its scale."""
        return self.residual.endswith("logistic") and self.deviation == "standard-deviation"
