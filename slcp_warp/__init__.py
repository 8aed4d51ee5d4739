"""slcp-warp: thousands of small contact mechanisms stepped in parallel, differentiable through contact.

The contact problem of every time step is a stochastic complementarity problem (Tassa & Todorov 2010). In
docstrings (17) is an equation of that paper, (M17) one of docs/understand/mathematics.md.
"""

from .storage.installed import require_installed

require_installed(__name__, __path__[0])

from . import costs, measures, policies, runs, scenes, tasks
from .description.assemblies.brakes import brake
from .description.assemblies.pins import pin
from .description.assemblies.polygons import polygon, polygon_mass
from .description.assemblies.ropes import rope
from .description.assemblies.servos import limited_servo, servo
from .description.mjcf import MjcfError, load_mjcf, mjcf_control_limits
from .description.parts import Actuator, Body, Contact, Shape, Spring, Tendon, box, touching
from .description.scene import Scene
from .description.scene_file import SceneFileError, load_scene, save_scene
from .ensembles.episodes import Environment
from .ensembles.outcome import Report
from .ensembles.particles import ParticleRollout, Particles, particle_rollout, particles
from .ensembles.questions.identification.fit import Fit
from .ensembles.questions.identification.identified import Identified
from .ensembles.questions.identification.identify import identify
from .ensembles.questions.identification.log_files import load_log
from .ensembles.questions.rare.failure import FailureShare, failure_share
from .ensembles.questions.rare.falsification import Falsification
from .ensembles.questions.rare.falsify import falsify
from .ensembles.questions.replay import replay
from .ensembles.questions.robustness_map import RobustnessMap, robustness_map
from .ensembles.questions.sensitivity import sensitivity
from .ensembles.questions.sequential import SequentialComparison, compare_sequentially
from .ensembles.questions.tuning.tune import tune
from .ensembles.questions.tuning.tuned import Tuned
from .ensembles.report import SweepReport
from .ensembles.spec import SweepSpec
from .ensembles.statistics.sensitivity import Sensitivity
from .ensembles.stored.report import load_report
from .ensembles.sweep import sweep
from .ensembles.worlds import Worlds, draw_worlds, load_worlds, save_worlds
from .inputs.arrays import ArrayError
from .inputs.errors import ArgumentError, ArgumentTypeError, InputError, SceneError
from .options import OptionError, Options, Status
from .parameters import ParameterError, Parameters
from .results import Energies, Linearization, Momentum, Step, Trajectory, energies, momentum
from .simulator import Simulator
from .simulator.complementarity import Complementarity, solve_complementarity
from .simulator.products import Pullback, Pushforward, jvp, vjp, weighted_hessian
from .simulator.residuals import residual
from .stepping.strategy import StrategyError
from .storage.files import FileError
from .storage.version import __version__ as __version__
from .tasks import Task, TaskError, TaskFileError, load_task, save_task
from .tasks.disturbances import Disturbances, Dropout, LogNormal, Normal, Push, Uniform, UniformFactor

__all__ = [
    "Actuator",
    "ArgumentError",
    "ArgumentTypeError",
    "ArrayError",
    "Body",
    "Complementarity",
    "Contact",
    "Disturbances",
    "Dropout",
    "Energies",
    "Environment",
    "InputError",
    "FailureShare",
    "Fit",
    "Identified",
    "Falsification",
    "FileError",
    "Linearization",
    "LogNormal",
    "MjcfError",
    "Momentum",
    "Normal",
    "OptionError",
    "Options",
    "ParameterError",
    "Parameters",
    "ParticleRollout",
    "Particles",
    "Pullback",
    "Push",
    "Pushforward",
    "Report",
    "RobustnessMap",
    "Scene",
    "SceneError",
    "SceneFileError",
    "Sensitivity",
    "SequentialComparison",
    "Shape",
    "Simulator",
    "Spring",
    "Status",
    "Step",
    "StrategyError",
    "SweepReport",
    "SweepSpec",
    "Task",
    "TaskError",
    "TaskFileError",
    "Trajectory",
    "Tendon",
    "Tuned",
    "Uniform",
    "UniformFactor",
    "Worlds",
    "box",
    "brake",
    "compare_sequentially",
    "costs",
    "draw_worlds",
    "energies",
    "failure_share",
    "load_worlds",
    "save_worlds",
    "falsify",
    "identify",
    "jvp",
    "limited_servo",
    "load_mjcf",
    "load_log",
    "load_report",
    "load_scene",
    "load_task",
    "measures",
    "mjcf_control_limits",
    "momentum",
    "particle_rollout",
    "particles",
    "pin",
    "policies",
    "polygon",
    "polygon_mass",
    "replay",
    "residual",
    "robustness_map",
    "rope",
    "runs",
    "save_scene",
    "save_task",
    "scenes",
    "sensitivity",
    "servo",
    "solve_complementarity",
    "sweep",
    "tasks",
    "touching",
    "tune",
    "vjp",
    "weighted_hessian",
]
