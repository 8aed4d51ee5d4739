"""How chains of plans are propagated (`receding.py`)."""

from dataclasses import dataclass
from typing import Any

from slcp_warp.inputs.checks import instance, number, whole
from slcp_warp.inputs.errors import ArgumentError

from ..options import Options


@dataclass(frozen=True)
class RecedingOptions:
    """How chains are propagated.

    Attributes:
        offset: steps d of a shift.
        chains: independent chains, one batch.
        recalled: starts from earlier good plans.
        noisy: starts from smoothed noise, per chain and shift.
        noise: standard deviation of that noise [control units].
        noise_time: its correlation time [steps].
        perturb_every: kick the velocities every so many steps (0: never).
        perturb_variance: of the kick (the paper's 4).
        unperturbed: the first so many chains are never kicked.
        passes: DDP passes of a shift.
        first_passes: of the first plan.
        first: controls (N, nu) that first plans are made from, too, in place of zeros: of a plan that is
            there. None: zeros.
        entries: controllers stored of every plan, at its steps 0, 1, .. (at most the offset).
        seed: of all random numbers.
        solver: `Options` of DDP; `passes` stand in the place of its max_iterations. None: eight step sizes,
            by the problem's `quick_method`.
    """

    offset: int = 4
    chains: int = 1
    recalled: int = 2
    noisy: int = 1
    noise: float = 1.0
    noise_time: float = 8.0
    perturb_every: int = 15
    perturb_variance: float = 4.0
    unperturbed: int = 0
    passes: int = 10
    first_passes: int = 200
    first: Any = None
    entries: int = 1
    seed: int = 0
    solver: Options | None = None

    def __post_init__(self) -> None:
        for name, low in (
            ("offset", 1),
            ("chains", 1),
            ("recalled", 0),
            ("noisy", 0),
            ("passes", 1),
            ("entries", 1),
            ("first_passes", 0),
            ("perturb_every", 0),
            ("unperturbed", 0),
            ("seed", 0),
        ):
            whole(f"RecedingOptions.{name}", getattr(self, name), low)
        if self.entries > self.offset:
            raise ArgumentError(
                f"RecedingOptions.entries is {self.entries}; at most the offset {self.offset}"
            )
        for name in ("perturb_variance", "noise", "noise_time"):
            number(f"RecedingOptions.{name}", getattr(self, name), 0.0, above=name == "noise_time")
        instance("RecedingOptions.solver", self.solver, Options | None, "a ddp.Options")
