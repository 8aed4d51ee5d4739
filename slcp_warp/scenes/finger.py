"""The paper's system: a finger that flicks an ellipse."""

import math

from ..description.parts import Actuator, Body, Contact, Shape
from ..description.scene import Scene
from .arguments import checked

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
