"""Tip a box over its edge by pushing it."""

import math

from .. import measures
from ..costs import Term, effort, terms
from ..description.parts import Actuator, Body, Contact, Shape, box, touching
from ..description.scene import Scene
from .disturbances import Disturbances, Normal, Push, Uniform
from .task import Task

WIDTH, HEIGHT = 0.2, 0.4


def topple_scene() -> Scene:
    """A box on its short side and, high up beside it, a pusher on a rail (1 kg). Control: its force [N]."""
    corners = box("corner", "box", WIDTH, HEIGHT)
    face = Shape("face", "box", "halfplane", offset=(-WIDTH / 2, 0.0), angle=math.pi)
    ground = Shape("ground", None, "halfplane", angle=math.pi / 2)
    return Scene(
        name="topple",
        bodies=(
            Body("pusher", 1.0, 1e-3, joint="prismatic", anchor=(-0.25, 0.33), damping=1.0),
            Body("box", 1.0, (WIDTH**2 + HEIGHT**2) / 12.0, joint="free"),
        ),
        shapes=(Shape("pusher", "pusher", "disc", 0.05), *corners, face, ground),
        contacts=(*touching(corners, (ground,), 0.9), Contact("face", "pusher", 0.2)),
        actuators=(Actuator("pusher"),),
        step_size=0.02,
        sigma=0.05,
        initial_state=(0.0, 0.0, HEIGHT / 2, 0.0, 0.0, 0.0, 0.0, 0.0),
    )


def box_topple() -> Task:
    """The box lies on its long side at the end, whatever pushes it and however the ground grips."""
    scene = topple_scene()
    tilt, lying = "box.angle", -math.pi / 2
    angle = measures.final("box.angle")
    return Task(
        name="box_topple",
        scene=scene,
        cost=terms(
            scene,
            [Term("cosine", 0.5, state=tilt, target=lying), effort(1e-3)],
            [Term("cosine", 50.0, state=tilt, target=lying), Term("square", 1.0, state="box.vangle")],
        ),
        horizon=80,
        control_limits=(-20.0, 20.0),
        disturbances=Disturbances(
            start={"box.x": Uniform(-0.05, 0.1), "box.vangle": 0.3},
            torque=2.0,
            parameters={"mass": 0.3, "friction": Uniform(0.25, 1.0), "box.com": Normal(0.03)},
            pushes=(Push("box", Uniform(0.1, 1.0), 0.15, (Normal(15.0), 0.0), at=(0.0, 0.1)),),
        ),
        measures={
            "angle": angle,
            "lies_from": measures.settled(measures.state("box.angle") < -1.4),
            "way": measures.final("box.x"),
        },
        success=angle.between(-1.75, -1.4),
    )
