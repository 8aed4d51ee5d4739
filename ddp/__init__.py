"""Differential dynamic programming over batches of problems; receding horizon, libraries and policies."""

from . import costs
from .continuation import solve_continuation
from .costs import Cost
from .dynamics import Dynamics, DynamicsFunctions, Parameters, WarpDynamics, linear_system
from .library.entries import LibraryError
from .library.library import Library, concatenate
from .library.nearest import NearestPolicy
from .library.receding import build_library
from .library.receding_options import RecedingOptions
from .library.refinement import build_refined, stuck_states, turning
from .mpc.mpc import MPC
from .mpc.recorded import library_of_runs
from .mpc.starts import Policy as StartPolicy
from .mpc.starts import Situation
from .multistart import Multistart, solve_multistart
from .options import Options, Regularization
from .planning import plan, problem_of
from .policies import TrackingPolicy
from .problem import Problem
from .results.result import Result
from .results.status import Status
from .results.trace import Trace
from .robust import Robust, plan_in_worlds
from .sampling.options import Sampling
from .sampling.sampler import Sampled, Sampler, sample
from .solver import solve
from .workspace import Workspace

__all__ = [
    "MPC",
    "Cost",
    "Dynamics",
    "DynamicsFunctions",
    "Library",
    "LibraryError",
    "Multistart",
    "NearestPolicy",
    "Options",
    "Parameters",
    "Problem",
    "RecedingOptions",
    "Regularization",
    "Result",
    "Robust",
    "Sampled",
    "Sampler",
    "Sampling",
    "Situation",
    "StartPolicy",
    "Status",
    "TrackingPolicy",
    "Trace",
    "WarpDynamics",
    "Workspace",
    "build_library",
    "build_refined",
    "concatenate",
    "costs",
    "library_of_runs",
    "linear_system",
    "plan",
    "plan_in_worlds",
    "problem_of",
    "sample",
    "solve",
    "solve_continuation",
    "solve_multistart",
    "stuck_states",
    "turning",
]
