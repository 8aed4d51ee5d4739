"""What a robustness sweep varies and measures, checked when it is written down."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..inputs import checks
from ..inputs.checks import shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..inputs.rules import PERTURBABLE
from ..options import Options


@dataclass(frozen=True)
class SweepSpec:
    """What is varied (M41) and measured; every number is reproducible from `seed` and the world's index.

    Attributes:
        worlds: per case.
        duration: simulated [s].
        residuals, step_sizes: their product makes the cases.
        start: (M, nx) states, one drawn per world; None: the scene's.
        position_sd, velocity_sd: normal noise on it.
        parameter_sd: name -> standard deviation of the logarithm of a factor on it (one factor per body,
            shape, contact or degree of freedom; mass and inertia of a body share theirs where both are
            named); a drawn step size is at most sample_every. The drawn values are columns of the
            report's table.
        parameters: name -> other base value (Simulator.params.replace).
        torque_sd: white noise on the controls.
        kick_times, kick_sd: normal velocity kicks [s; rad/s, m/s].
        observe: state component whose rate is judged.
        threshold: "spinning" [1/s].
        window: of the moving rate [s].
        sample_every: [s].
    """

    worlds: int = 4096
    duration: float = 20.0
    residuals: tuple[str, ...] = ("rem-logistic", "hard")
    step_sizes: tuple[float, ...] = (0.05,)
    start: np.ndarray | None = None
    position_sd: float = 0.0
    velocity_sd: float = 0.0
    parameter_sd: dict[str, float] = field(default_factory=dict)
    parameters: dict[str, Any] = field(default_factory=dict)
    torque_sd: float = 0.0
    kick_times: tuple[float, ...] = ()
    kick_sd: float = 2.0
    observe: int = 0
    threshold: float = 0.5
    window: float = 4.0
    sample_every: float = 0.5
    seed: int = 0

    def __post_init__(self) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        def label(name: str) -> str:
            return f"SweepSpec.{name}"

        put("worlds", checks.whole(label("worlds"), self.worlds))
        put("seed", checks.whole(label("seed"), self.seed, 0))
        put("observe", checks.whole(label("observe"), self.observe, 0))
        for name in ("duration", "window", "sample_every"):
            put(name, checks.number(label(name), getattr(self, name), 0.0, above=True))
        for name in ("position_sd", "velocity_sd", "torque_sd", "kick_sd"):
            put(name, checks.number(label(name), getattr(self, name), 0.0))
        put("threshold", checks.number(label("threshold"), self.threshold))
        if self.start is not None:
            put("start", np.atleast_2d(checks.array(label("start"), self.start)))
        self._check_cases()
        self._check_parameters()
        self._check_kicks()

    def _check_cases(self) -> None:
        for name in ("residuals", "step_sizes", "kick_times"):
            value = getattr(self, name)
            listed = isinstance(value, Sequence) and not isinstance(value, str | bytes)
            if not listed and not (isinstance(value, np.ndarray) and value.ndim == 1):
                raise ArgumentError(f"SweepSpec.{name} is {shown(value)}; a tuple is needed")
            object.__setattr__(self, name, tuple(value))
        if not self.residuals or not self.step_sizes:
            raise ArgumentError("SweepSpec.residuals and step_sizes must name at least one case")
        for name, values in (("residuals", self.residuals), ("step_sizes", self.step_sizes)):
            if any(value in values[:i] for i, value in enumerate(values)):
                raise ArgumentError(f"SweepSpec.{name} is {shown(values)}; each of them once is needed")
        for residual in self.residuals:
            Options(residual=residual)
        if self.sample_every > self.duration / 2.0:
            raise ArgumentError(
                f"SweepSpec.sample_every is {self.sample_every}; at most half the duration {self.duration}"
            )
        for h in self.step_sizes:
            found = checks.numeric(h)
            if found is None or found.ndim or not 0.0 < found <= self.sample_every:
                raise ArgumentError(
                    f"SweepSpec.step_sizes contains {shown(h)}; in (0, sample_every = {self.sample_every}] "
                    "please"
                )
            if not self.duration / found <= checks.MOST:
                raise ArgumentError(
                    f"SweepSpec.duration is {self.duration}, {self.duration / found:.3g} steps of {h} s; "
                    f"at most {checks.MOST} are possible"
                )

    def _check_parameters(self) -> None:
        checks.instance("SweepSpec.parameter_sd", self.parameter_sd, Mapping, "a dict of numbers by name")
        checks.instance("SweepSpec.parameters", self.parameters, Mapping, "a dict of values by name")
        unknown = [name for name in self.parameter_sd if name not in PERTURBABLE]
        if unknown:
            raise ArgumentError(f"SweepSpec.parameter_sd names {shown(unknown)}; choose from {PERTURBABLE}")
        for name, value in self.parameter_sd.items():
            found = checks.numeric(value)
            if found is None or found.ndim or not 0.0 <= found < 2.0:
                raise ArgumentError(
                    f"SweepSpec.parameter_sd[{name!r}] is {shown(value)}; a number in [0, 2) is needed"
                )
        odd = [name for name in self.parameters if not isinstance(name, str)]
        if odd:
            raise ArgumentTypeError(
                f"SweepSpec.parameters names {shown(odd)}; names of parameters are needed"
            )
        if "step_size" in self.parameters:
            raise ArgumentError("SweepSpec.parameters names step_size; the cases' are given by step_sizes")

    def _check_kicks(self) -> None:
        times = checks.numeric(self.kick_times)
        inside = times is not None and times.ndim == 1 and ((times >= 0.0) & (times < self.duration)).all()
        if times is None or not inside or (np.diff(times) < 0.0).any():
            raise ArgumentError(
                f"SweepSpec.kick_times is {shown(self.kick_times)}; rising times in [0, {self.duration}) are "
                "needed"
            )
        if len(times) and times[-1] + self.window > self.duration:
            raise ArgumentError(
                f"SweepSpec.kick_times ends at {times[-1]}; recovery needs window = {self.window} after it, "
                f"within duration = {self.duration}"
            )
