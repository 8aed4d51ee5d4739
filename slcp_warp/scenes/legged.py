"""Legged robots: a hopper and a walker."""

import math

from ..description.parts import Actuator, Body, Contact, Shape
from ..description.scene import Scene
from .arguments import checked
from .pieces import GROUND


@checked
def hopper(friction: float = 0.8, stiffness: float = 2000.0) -> Scene:
    """A one-legged planar hopper: torso, a leg turning at the hip, and a foot sliding out of it on a spring.

    State: torso (x, y, angle), hip angle, leg extension [m], then rates; at zero the leg hangs straight down
    and the foot is .6 m below the torso's centre. Controls: hip torque [N m], leg thrust [N] (out is
    positive). It falls .3 m at .6 m/s and hops on the leg's spring; without control it then tips over. The
    springs are explicit, the rule to which its published figures belong: h < .02 s.
    """
    down = -math.pi / 2
    return Scene(
        name="hopper",
        bodies=(
            Body("torso", 5.0, 0.15, joint="free"),
            Body("leg", 0.5, 0.01, parent="torso", angle=down, com=(0.2, 0.0), damping=0.2, stiffness=40.0,
                 lower=-1.2, upper=1.2),
            Body("foot", 0.2, 0.002, parent="leg", joint="prismatic", anchor=(0.4, 0.0), com=(0.1, 0.0),
                 stiffness=stiffness, damping=2.0, lower=-0.3, upper=0.05),
        ),
        shapes=(
            Shape("torso", "torso", "capsule", (0.1, 0.15)),
            Shape("foot", "foot", "disc", 0.04, offset=(0.2, 0.0)),
            GROUND,
        ),
        contacts=(Contact("ground", "foot", friction), Contact("ground", "torso", friction)),
        actuators=(Actuator("leg"), Actuator("foot")),
        step_size=0.005,
        sigma=0.02,
        initial_state=(0.0, 0.94, 0.0, 0.1, 0.0, 0.6, 0.0, 0.0, 0.0, 0.0),
        implicit_stiffness=False,
    )  # fmt: skip


@checked
def walker(friction: float = 0.8) -> Scene:
    """A planar biped: torso, two thighs, two shanks with round feet. 20 kg, 1.25 m tall.

    State: torso (x, y, angle) at the hip, left hip, left knee, right hip, right knee, then rates; at zero it
    stands straight. Controls: torques [N m] at these four joints. It starts in a stride just above the
    ground; joint springs hold the posture, so that it lands and stands.
    """
    down, mass, link = -math.pi / 2, 2.0, 0.4
    posture = {"left": (0.35, -0.25), "right": (-0.25, -0.25)}
    bodies = [Body("torso", 12.0, 0.4, joint="free", com=(0.0, 0.2))]
    shapes, contacts = [Shape("torso", "torso", "capsule", (0.08, 0.15), offset=(0.0, 0.22), angle=down)], []
    for side, (hip, knee) in posture.items():
        inertia = mass * link**2 / 12.0
        bodies += [
            Body(f"{side}_thigh", mass, inertia, parent="torso", angle=down, com=(link / 2, 0.0),
                 stiffness=300.0, rest=hip, damping=2.5),
            Body(f"{side}_shank", mass, inertia, parent=f"{side}_thigh", anchor=(link, 0.0),
                 com=(link / 2, 0.0), stiffness=300.0, rest=knee, damping=2.5, lower=-2.4, upper=0.0),
        ]  # fmt: skip
        shapes.append(Shape(f"{side}_foot", f"{side}_shank", "disc", 0.05, offset=(link, 0.0)))
        contacts.append(Contact("ground", f"{side}_foot", friction))
    joints = [angle for pair in posture.values() for angle in pair]
    return Scene(
        name="walker",
        bodies=tuple(bodies),
        shapes=(*shapes, GROUND),
        contacts=tuple(contacts),
        actuators=tuple(Actuator(b.name) for b in bodies[1:]),
        step_size=0.005,
        sigma=0.02,
        initial_state=(0.0, 0.87, 0.0, *joints, *(0.0,) * 7),
    )
