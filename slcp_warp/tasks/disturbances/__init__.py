"""What is uncertain in the runs of a task."""

from .distributions import Distribution, LogNormal, Normal, Uniform, UniformFactor
from .disturbances import Disturbances
from .events import Dropout, Push

__all__ = [
    "Distribution",
    "Disturbances",
    "Dropout",
    "LogNormal",
    "Normal",
    "Push",
    "Uniform",
    "UniformFactor",
]
