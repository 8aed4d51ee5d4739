"""Discrete-time dynamics: what the solver asks of them, a simulator's, a user's own."""

from .protocol import Dynamics
from .simulated import SimulatorDynamics, dynamics_of
from .user import DynamicsFunctions, Parameters, WarpDynamics, linear_system

__all__ = [
    "Dynamics",
    "DynamicsFunctions",
    "Parameters",
    "SimulatorDynamics",
    "WarpDynamics",
    "dynamics_of",
    "linear_system",
]
