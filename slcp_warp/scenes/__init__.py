"""Named scenes. Each function returns a `Scene`; its numbers can be replaced at run time through the
parameters. `NAMED` has them by name.
"""

from .bodies import ball_drop, box_toss, particle, rolling_disc, sliding_block, slope
from .finger import flicking_finger
from .heaps import heap, tumbling_boxes
from .legged import hopper, walker
from .manipulation import grasp, push_block
from .pendulums import cart_pole, pendulum_chain
from .registry import NAMED
from .trials import beam, opposing_limits, painleve_rod, stack, two_balls

__all__ = [
    "NAMED",
    "ball_drop",
    "beam",
    "box_toss",
    "cart_pole",
    "flicking_finger",
    "grasp",
    "heap",
    "hopper",
    "opposing_limits",
    "painleve_rod",
    "particle",
    "pendulum_chain",
    "push_block",
    "rolling_disc",
    "sliding_block",
    "slope",
    "stack",
    "tumbling_boxes",
    "two_balls",
    "walker",
]
