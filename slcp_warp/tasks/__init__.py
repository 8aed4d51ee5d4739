"""Tasks: what is to be controlled, how it is judged; the named ones, each in a file of its own."""

from .box_topple import box_topple
from .cart_pole_walls import cart_pole_walls
from .catch import catch
from .disturbances import Disturbances
from .files import TaskFileError, load_task, save_task
from .flicking_finger import flicking_finger
from .grasp_hold import grasp_hold
from .hopper_hop import hopper_hop
from .push_to_mark import push_to_mark
from .registry import NAMED
from .task import Task, TaskError
from .walker_walk import walker_walk

__all__ = [
    "Disturbances",
    "NAMED",
    "Task",
    "TaskError",
    "TaskFileError",
    "box_topple",
    "cart_pole_walls",
    "catch",
    "flicking_finger",
    "grasp_hold",
    "hopper_hop",
    "load_task",
    "push_to_mark",
    "save_task",
    "walker_walk",
]
