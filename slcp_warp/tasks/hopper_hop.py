"""Hop forwards on one leg."""

from dataclasses import replace

from .. import measures, scenes
from ..costs import Term, effort, terms
from .disturbances import Disturbances
from .task import Task


def hopper_hop() -> Task:
    """The hopper moves forwards at .6 m/s and stays upright; a run ends where it falls."""
    scene = replace(scenes.hopper(), step_size=0.01, sigma=0.05)
    running = [
        Term("square", 5.0, state="torso.y", target=0.95),
        Term("square", 2.0, state="torso.vx", target=0.6),
        Term("square", 20.0, state="torso.angle"),
        Term("square", 0.05, state="torso.vangle"),
        effort(1e-4),
    ]
    speed, lowest = measures.mean("torso.vx"), measures.smallest("torso.y")
    return Task(
        name="hopper_hop",
        scene=scene,
        cost=terms(scene, running),
        horizon=120,
        control_limits=(-200.0, 200.0),
        disturbances=Disturbances(velocity=0.1, torque=10.0, parameters={"mass": 0.1, "friction": 0.2}),
        measures={
            "speed": speed,
            "lowest": lowest,
            "tilt": measures.largest("torso.angle"),
            "contact_share": measures.contact_share("ground/foot"),
        },
        failure=measures.state("torso.y") < 0.4,
        success=(speed > 0.2) & (lowest > 0.4),
    )
