"""Differential dynamic programming over batches of problems; receding horizon, libraries and policies."""

from . import costs
from .continuation import solve_continuation
from .costs import Cost
from .dynamics import Dynamics, DynamicsFunctions, Parameters, WarpDynamics, linear_system
from .multistart import Multistart, solve_multistart
from .options import Options, Regularization
from .problem import Problem
from .result import Result, Trace
from .solver import Workspace, solve
from .status import Status

__all__ = [
    "Cost",
    "Dynamics",
    "DynamicsFunctions",
    "Multistart",
    "Options",
    "Parameters",
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
    "solve_continuation",
    "solve_multistart",
]
