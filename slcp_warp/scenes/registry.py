"""The named scenes by name; a new one is listed here."""

from collections.abc import Callable

from ..description.scene import Scene
from .bodies import ball_drop, box_toss, particle, rolling_disc, sliding_block, slope
from .finger import flicking_finger
from .heaps import heap, tumbling_boxes
from .legged import hopper, walker
from .manipulation import grasp, push_block
from .pendulums import cart_pole, pendulum_chain
from .trials import beam, opposing_limits, painleve_rod, stack, two_balls

NAMED: dict[str, Callable[..., Scene]] = {
    make.__name__: make
    for make in (
        flicking_finger,
        ball_drop,
        sliding_block,
        particle,
        grasp,
        pendulum_chain,
        stack,
        painleve_rod,
        slope,
        two_balls,
        box_toss,
        rolling_disc,
        beam,
        opposing_limits,
        hopper,
        walker,
        cart_pole,
        push_block,
        heap,
        tumbling_boxes,
    )
}
