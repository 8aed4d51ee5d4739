"""The named tasks by name; a new one is listed here."""

from collections.abc import Callable

from .box_topple import box_topple
from .cart_pole_walls import cart_pole_walls
from .catch import catch
from .flicking_finger import flicking_finger
from .grasp_hold import grasp_hold
from .hopper_hop import hopper_hop
from .push_to_mark import push_to_mark
from .task import Task
from .walker_walk import walker_walk

NAMED: dict[str, Callable[..., Task]] = {
    make.__name__: make
    for make in (
        flicking_finger,
        cart_pole_walls,
        push_to_mark,
        grasp_hold,
        hopper_hop,
        walker_walk,
        catch,
        box_topple,
    )
}
