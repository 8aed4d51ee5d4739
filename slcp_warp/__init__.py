"""slcp-warp: thousands of small contact mechanisms stepped in parallel, differentiable through contact.

The contact problem of every time step is a stochastic complementarity problem (Tassa & Todorov 2010).
"""

from . import scenes
from .arrays import ArrayError
from .complementarity import Complementarity, solve_complementarity
from .errors import ArgumentError, ArgumentTypeError, InputError
from .files import FileError
from .mjcf import MjcfError, load_mjcf
from .options import OptionError, Options, Status
from .parameters import ParameterError, Parameters
from .particles import ParticleRollout, Particles, particle_rollout, particles
from .products import Pullback, Pushforward, jvp, vjp, weighted_hessian
from .residuals import residual
from .results import Linearization, Step, Trajectory
from .scene import Actuator, Body, Contact, Scene, SceneError, Shape, Spring, box, touching
from .scene_file import SceneFileError, load_scene, save_scene
from .simulator import Simulator
from .strategy import StrategyError
from .sweep import sweep
from .sweep_report import SweepReport
from .sweep_spec import SweepSpec

__version__ = "0.1.0"

__all__ = [
    "Actuator",
    "ArgumentError",
    "ArgumentTypeError",
    "ArrayError",
    "Body",
    "Complementarity",
    "Contact",
    "InputError",
    "FileError",
    "Linearization",
    "MjcfError",
    "OptionError",
    "Options",
    "ParameterError",
    "Parameters",
    "ParticleRollout",
    "Particles",
    "Pullback",
    "Pushforward",
    "Scene",
    "SceneError",
    "SceneFileError",
    "Shape",
    "Simulator",
    "Spring",
    "Status",
    "Step",
    "StrategyError",
    "SweepReport",
    "SweepSpec",
    "Trajectory",
    "box",
    "jvp",
    "load_mjcf",
    "load_scene",
    "particle_rollout",
    "particles",
    "residual",
    "save_scene",
    "scenes",
    "solve_complementarity",
    "sweep",
    "touching",
    "vjp",
    "weighted_hessian",
]
