"""What a picture of a named scene shows: a short motion of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..description.scene import Scene


@dataclass(frozen=True)
class Shown:
    """A motion.

    Attributes:
        seconds: its duration.
        controls: constant ones; empty: zeros.
        rates: initial ones by the state's name; the others are the scene's.
    """

    seconds: float = 1.0
    controls: tuple[float, ...] = ()
    rates: Mapping[str, float] = field(default_factory=dict)


SHOWN = {
    "flicking_finger": Shown(1.5), "ball_drop": Shown(0.45), "pendulum_chain": Shown(0.5),
    "sliding_block": Shown(0.35, rates={"block.vx": 1.5}),
    "particle": Shown(0.5, rates={"particle.vx": 1.0, "particle.vy": 2.0}),
    "grasp": Shown(0.6, controls=(20.0, -20.0)), "stack": Shown(0.5), "painleve_rod": Shown(0.6),
    "two_balls": Shown(1.2), "box_toss": Shown(1.2), "rolling_disc": Shown(0.5), "beam": Shown(0.3),
    "opposing_limits": Shown(0.3), "hopper": Shown(0.9), "walker": Shown(0.6), "cart_pole": Shown(0.85),
    "push_block": Shown(0.4), "heap": Shown(0.5, rates={"disc2.vy": -2.0}), "tumbling_boxes": Shown(1.0),
}  # fmt: skip


def shown(scene: Scene) -> tuple[Shown, np.ndarray]:
    """The motion of a scene by its name, of a second where it has none, and the state that it begins in."""
    motion = SHOWN.get(scene.name, Shown())
    return motion, scene.state(motion.rates)
