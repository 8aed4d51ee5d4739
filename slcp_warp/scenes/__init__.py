"""Named scenes. Each function returns a `Scene`; its numbers can be replaced at run time through the
parameters. Those of loose bodies are in `scenes_contact.py`, those with actuators in `scenes_robots.py`.
"""

import math

from ..description.scene import Actuator, Body, Contact, Scene, Shape
from . import contact as scenes_contact
from . import robots as scenes_robots
from .arguments import checked
from .contact import beam, box_toss, opposing_limits, painleve_rod, rolling_disc, slope, stack, two_balls
from .robots import cart_pole, hopper, push_block, walker

FINGER_RADII = (0.8, 0.25)
FREE_RADII = (0.7, 0.5)


def _ellipse_inertia(radii: tuple[float, float], density: float = 1.0) -> tuple[float, float]:
    a, b = radii
    mass = density * math.pi * a * b
    return mass, mass * (a * a + b * b) / 4.0


@checked
def flicking_finger(gravity: float = -4.0) -> Scene:
    """The paper's system (section V-B): a finger of two ellipses above a third one that spins freely.

    State (theta1, theta2, theta3, rates): theta2 is relative to link 1, theta3 is the free ellipse's major
    axis. A link's joint sits at the tip of its major axis. Density 1, drag .2, .2, .7 (explicit, as in the
    paper's r(q, v)), mu = .5, h = .05, sigma = .1.
    """
    mass, inertia = _ellipse_inertia(FINGER_RADII)
    free_mass, free_inertia = _ellipse_inertia(FREE_RADII)
    long = FINGER_RADII[0]
    return Scene(
        name="flicking_finger",
        bodies=(
            Body("link1", mass, inertia, com=(long, 0.0), damping=0.2, lower=-math.pi, upper=0.0),
            Body("link2", mass, inertia, parent="link1", anchor=(2.0 * long, 0.0), com=(long, 0.0),
                 damping=0.2, lower=-2.0 * math.pi / 3.0, upper=0.0),
            Body("ellipse", free_mass, free_inertia, anchor=(0.0, -3.0), damping=0.7),
        ),
        shapes=(
            Shape("link1", "link1", "ellipse", FINGER_RADII, offset=(long, 0.0)),
            Shape("tip", "link2", "ellipse", FINGER_RADII, offset=(long, 0.0)),
            Shape("free", "ellipse", "ellipse", FREE_RADII),
        ),
        contacts=(Contact("tip", "free", friction=0.5),),
        actuators=(Actuator("link1"), Actuator("link2")),
        gravity=(0.0, gravity),
        step_size=0.05,
        sigma=0.1,
        initial_state=(-0.3, -0.3, 0.4, 0.0, 0.0, 0.0),
        implicit_damping=False,
        period=(None, None, math.pi),
    )  # fmt: skip


@checked
def ball_drop(
    radius: float = 0.1, mass: float = 1.0, height: float = 1.0, friction: float | None = None
) -> Scene:
    """A disc above a horizontal half-plane (y = 0), its lowest point `height` above it."""
    return Scene(
        name="ball_drop",
        bodies=(Body("ball", mass, 0.5 * mass * radius**2, joint="free"),),
        shapes=(Shape("ball", "ball", "disc", radius), Shape("ground", None, "halfplane", angle=math.pi / 2)),
        contacts=(Contact("ground", "ball", friction),),
        initial_state=(0.0, radius + height, 0.0, 0.0, 0.0, 0.0),
    )


@checked
def sliding_block(
    friction: float = 0.5, mass: float = 1.0, slope: float = 0.0, corner_radius: float = 0.0
) -> Scene:
    """A box of 0.4 m x 0.2 m on a half-plane tilted by `slope` [rad]; its corners are discs or points.

    The box starts at rest on the plane, at gap 0. Its frame's origin is the centre.
    """
    width, height = 0.4, 0.2
    corners = [
        (sx * (width / 2 - corner_radius), sy * (height / 2 - corner_radius))
        for sy in (-1, 1)
        for sx in (-1, 1)
    ]
    shapes = [Shape(f"corner{i}", "block", "disc", corner_radius, offset=c) for i, c in enumerate(corners)]
    ground = Shape("ground", None, "halfplane", angle=math.pi / 2 + slope)
    return Scene(
        name="sliding_block",
        bodies=(Body("block", mass, mass * (width**2 + height**2) / 12.0, joint="free"),),
        shapes=(*shapes, ground),
        contacts=tuple(Contact("ground", f"corner{i}", friction) for i in range(4)),
        initial_state=(-math.sin(slope) * height / 2, math.cos(slope) * height / 2, slope, 0.0, 0.0, 0.0),
    )


@checked
def particle(friction: float | None = None, mass: float = 1.0, slope: float = 0.0) -> Scene:
    """A point mass on a half-plane tilted by `slope` [rad], at gap 0; its angle takes no part."""
    return Scene(
        name="particle",
        bodies=(Body("particle", mass, mass, joint="free"),),
        shapes=(
            Shape("particle", "particle", "disc"),
            Shape("ground", None, "halfplane", angle=math.pi / 2 + slope),
        ),
        contacts=(Contact("ground", "particle", friction),),
    )


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
def pendulum_chain(links: int = 3, length: float = 0.5, mass: float = 1.0) -> Scene:
    """A chain of uniform rods without contact or damping; every joint is driven."""
    bodies = [
        Body(f"link{i}", mass, mass * length**2 / 12.0, parent=f"link{i - 1}" if i else None,
             anchor=(length, 0.0) if i else (0.0, 0.0), com=(length / 2, 0.0))
        for i in range(links)
    ]  # fmt: skip
    return Scene("pendulum_chain", tuple(bodies), actuators=tuple(Actuator(b.name) for b in bodies))


OWN = (flicking_finger, ball_drop, sliding_block, particle, grasp, pendulum_chain)
NAMED = {f.__name__: f for f in (*OWN, *scenes_contact.SCENES, *scenes_robots.SCENES)}

__all__ = [
    "NAMED", "ball_drop", "beam", "box_toss", "cart_pole", "flicking_finger", "grasp", "hopper",
    "opposing_limits", "painleve_rod", "particle", "pendulum_chain", "push_block", "rolling_disc",
    "sliding_block", "slope", "stack", "two_balls", "walker",
]  # fmt: skip
