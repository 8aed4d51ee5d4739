"""What a simulator gives back, with what it belongs to: printed, in tables, in files, in pictures."""

from .energies import Energies, energies
from .linearization import Linearization
from .momentum import Momentum, momentum
from .step import Step, contact_impulse
from .trajectory import Trajectory

__all__ = [
    "Energies",
    "Linearization",
    "Momentum",
    "Step",
    "Trajectory",
    "contact_impulse",
    "energies",
    "momentum",
]
