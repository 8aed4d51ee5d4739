"""Named scenes with actuators: hopper, walker, cart-pole, pushing."""

import math

from ..description.scene import Actuator, Body, Contact, Scene, Shape, box, touching
from .arguments import checked

GROUND = Shape("ground", None, "halfplane", angle=math.pi / 2)


@checked
def hopper(friction: float = 0.8, stiffness: float = 2000.0) -> Scene:
    """A one-legged planar hopper: torso, a leg turning at the hip, and a foot sliding out of it on a spring.

    State: torso (x, y, angle), hip angle, leg extension [m], then rates; at zero the leg hangs straight down
    and the foot is .6 m below the torso's centre. Controls: hip torque [N m], leg thrust [N] (out is
    positive). It falls .3 m at .6 m/s and hops on the leg's spring; without control it then tips over.
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


@checked
def cart_pole(wall: float = 0.6) -> Scene:
    """A cart (1 kg) on a rail with a pole (.2 kg, .6 m) between two walls at x = +-`wall` [m].

    State: cart x, pole's angle from upright (counter-clockwise), then rates. Control: force on the cart [N].
    The pole's tip touches the walls; the rail ends .3 m before them. It starts falling to the right.
    """
    up = math.pi / 2
    return Scene(
        name="cart_pole",
        bodies=(
            Body("cart", 1.0, 0.01, joint="prismatic", damping=0.1, lower=0.3 - wall, upper=wall - 0.3),
            Body("pole", 0.2, 0.2 * 0.36 / 12.0, parent="cart", angle=up, com=(0.3, 0.0), damping=0.002),
        ),
        shapes=(
            Shape("tip", "pole", "disc", 0.03, offset=(0.6, 0.0)),
            Shape("left_wall", None, "halfplane", offset=(-wall, 0.0)),
            Shape("right_wall", None, "halfplane", offset=(wall, 0.0), angle=math.pi),
        ),
        contacts=(Contact("left_wall", "tip"), Contact("right_wall", "tip")),
        actuators=(Actuator("cart"),),
        step_size=0.01,
        sigma=0.02,
        initial_state=(0.0, -0.1, 0.0, -0.5),
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


SCENES = (hopper, walker, cart_pole, push_block)
