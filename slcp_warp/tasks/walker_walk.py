"""Walk on two legs."""

from dataclasses import replace

from .. import measures, scenes
from ..costs import Term, effort, terms
from .disturbances import Disturbances
from .task import Task


def walker_walk() -> Task:
    """The walker moves forwards at half a metre a second and stays up; a run ends where it falls. Its springs
    are explicit here, the rule to which the task's published figures belong.
    """
    scene = replace(scenes.walker(), step_size=0.01, sigma=0.05, implicit_stiffness=False)
    running = [
        Term("square", 5.0, state="torso.vx", target=0.5),
        Term("square", 50.0, state="torso.angle"),
        Term("square", 20.0, state="torso.y", target=0.85),
        effort(2e-4),
    ]
    way, lowest = measures.final("torso.x"), measures.smallest("torso.y")
    return Task(
        name="walker_walk",
        scene=scene,
        cost=terms(scene, running),
        horizon=100,
        control_limits=(-80.0, 80.0),
        disturbances=Disturbances(velocity=0.2, torque=8.0, parameters={"mass": 0.15, "friction": 0.3}),
        measures={"way": way, "lowest": lowest, "tilt": measures.largest("torso.angle")},
        failure=measures.state("torso.y") < 0.6,
        success=(way > 0.2) & (lowest > 0.6),
    )
