"""Hold a disc between two fingers against gravity (section II)."""

from dataclasses import replace

from .. import measures, scenes
from ..costs import Term, effort, terms
from .disturbances import Disturbances
from .task import Task


def grasp_hold() -> Task:
    """The disc sinks by less than .05 m."""
    scene = replace(scenes.grasp(), step_size=0.02, sigma=0.02)
    running = [
        Term("square", 50.0, state="object.y"),
        Term("square", 50.0, state="object.x"),
        Term("square", 1.0, state="object.vy"),
        Term("square", 1.0, state="object.vx"),
        effort(1e-4),
    ]
    lowest = measures.smallest("object.y")
    return Task(
        name="grasp_hold",
        scene=scene,
        cost=terms(scene, running),
        horizon=60,
        control_limits=(-60.0, 60.0),
        disturbances=Disturbances(velocity=0.02, torque=1.0, parameters={"mass": 0.1, "friction": 0.1}),
        measures={
            "lowest": lowest,
            "held": measures.share_of_time(measures.contact() > 0.5),
            "squeeze": measures.mean(measures.normal_impulse()),
        },
        success=lowest > -0.05,
    )
