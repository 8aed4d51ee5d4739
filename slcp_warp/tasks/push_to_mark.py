"""Push a block to a mark and leave it there."""

from dataclasses import replace

from .. import measures, scenes
from ..costs import Term, effort, terms
from .disturbances import Disturbances, Normal, Push, Uniform
from .task import Task


def push_to_mark(mark: float = 0.6) -> Task:
    """The block comes to rest with its centre at most .05 m from `mark` [m]."""
    scene = replace(scenes.push_block(), step_size=0.02, sigma=0.05)
    final = [
        Term("square", 200.0, state="block.x", target=mark),
        Term("square", 20.0, state="block.vx"),
        Term("square", 5.0, state="block.angle"),
        Term("square", 20.0, state="block.vangle"),
    ]
    place, speed = measures.final("block.x"), measures.final("block.vx")
    return Task(
        name="push_to_mark",
        scene=scene,
        cost=terms(scene, [effort(1e-4)], final),
        horizon=80,
        control_limits=(-20.0, 20.0),
        start={"pusher.vshift": 0.0},
        disturbances=Disturbances(
            velocity=0.02,
            torque=0.2,
            parameters={"mass": 0.1, "friction": 0.1},
            pushes=(Push("block", Uniform(0.2, 1.0), 0.1, (Normal(6.0), 0.0)),),
        ),
        measures={"place": place, "speed": speed, "push": measures.impulse("face/pusher")},
        success=place.between(mark - 0.05, mark + 0.05) & speed.between(-0.1, 0.1),
    )
