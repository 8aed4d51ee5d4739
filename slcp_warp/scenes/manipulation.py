"""Bodies that others hold and push."""

import math

from ..description.parts import Actuator, Body, Contact, Shape, box, touching
from ..description.scene import Scene
from .arguments import checked
from .pieces import GROUND


@checked
def grasp(friction: float = 0.5) -> Scene:
    """Section II: two fingers hold a disc against gravity.

    Controls: the fingers' horizontal forces (left, right).
    """
    radius, finger = 0.1, 0.05
    return Scene(
        name="grasp",
        bodies=(
            Body("left", 0.5, 1e-3, joint="prismatic", anchor=(-radius - finger, 0.0), damping=1.0),
            Body("right", 0.5, 1e-3, joint="prismatic", anchor=(radius + finger, 0.0), damping=1.0),
            Body("object", 1.0, 0.5 * radius**2, joint="free"),
        ),
        shapes=(
            Shape("left", "left", "disc", finger),
            Shape("right", "right", "disc", finger),
            Shape("object", "object", "disc", radius),
        ),
        contacts=(Contact("left", "object", friction), Contact("right", "object", friction)),
        actuators=(Actuator("left"), Actuator("right")),
        step_size=0.01,
    )


@checked
def push_block(friction: float = 0.4) -> Scene:
    """A pusher (disc of radius .05 m, 1 kg, on a rail) pushes a block (.3 m x .2 m, 1 kg) over the ground.

    State: pusher x, block (x, y, angle), then rates. Control: force on the pusher [N]. The pusher touches the
    block's left face, a half-plane fixed to the block. It starts .2 m before the block at 1.5 m/s.
    """
    corners = box("corner", "block", 0.3, 0.2)
    face = Shape("face", "block", "halfplane", offset=(-0.15, 0.0), angle=math.pi)
    return Scene(
        name="push_block",
        bodies=(
            Body("pusher", 1.0, 1e-3, joint="prismatic", anchor=(-0.4, 0.08), damping=0.5),
            Body("block", 1.0, (0.3**2 + 0.2**2) / 12.0, joint="free"),
        ),
        shapes=(Shape("pusher", "pusher", "disc", 0.05), *corners, face, GROUND),
        contacts=(*touching(corners[:2], (GROUND,), friction), Contact("face", "pusher", 0.3)),
        actuators=(Actuator("pusher"),),
        step_size=0.01,
        sigma=0.01,
        initial_state=(0.0, 0.0, 0.1, 0.0, 1.5, 0.0, 0.0, 0.0),
    )
