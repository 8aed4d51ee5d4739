"""Differential dynamic programming over batches of problems, receding horizon, trajectory libraries and policies."""

from . import costs
from .costs import Cost
from .dynamics import Dynamics, DynamicsFunctions, WarpDynamics, linear_system
from .options import Options, Regularization
from .problem import Problem
from .result import Result, Trace
from .solver import Workspace, solve
from .status import Status

__all__ = [
    "Cost",
    "Dynamics",
    "DynamicsFunctions",
    "Options",
    "Problem",
    "Regularization",
    "Result",
    "Status",
    "Trace",
    "WarpDynamics",
    "Workspace",
    "costs",
    "linear_system",
    "solve",
]
