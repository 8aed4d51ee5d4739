"""Chains and carts with poles."""

import math

from ..description.parts import Actuator, Body, Contact, Shape
from ..description.scene import Scene
from .arguments import checked


@checked
def pendulum_chain(links: int = 3, length: float = 0.5, mass: float = 1.0) -> Scene:
    """A chain of uniform rods without contact or damping; every joint is driven."""
    bodies = [
        Body(f"link{i}", mass, mass * length**2 / 12.0, parent=f"link{i - 1}" if i else None,
             anchor=(length, 0.0) if i else (0.0, 0.0), com=(length / 2, 0.0))
        for i in range(links)
    ]  # fmt: skip
    return Scene("pendulum_chain", tuple(bodies), actuators=tuple(Actuator(b.name) for b in bodies))


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
