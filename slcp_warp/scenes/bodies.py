"""Single bodies that fall, slide, roll or are tossed."""

import math

from ..description.parts import Body, Contact, Shape, box, touching
from ..description.scene import Scene
from ..inputs.checks import shown
from ..inputs.errors import SceneError
from .arguments import checked
from .pieces import GROUND, box_inertia


@checked
def ball_drop(
    radius: float = 0.1, mass: float = 1.0, height: float = 1.0, friction: float | None = None
) -> Scene:
    """A disc above a horizontal half-plane (y = 0), its lowest point `height` above it."""
    return Scene(
        name="ball_drop",
        bodies=(Body("ball", mass, 0.5 * mass * radius**2, joint="free"),),
        shapes=(Shape("ball", "ball", "disc", radius), GROUND),
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
def slope(kind: str = "block", angle: float = 0.3, friction: float = 0.4) -> Scene:
    """A block (.4 m x .2 m), a particle or a disc (radius .1 m) at rest on a slope of `angle` [rad].

    State (x, y, angle) of the centre, then rates; 1 kg. It sticks while tan(angle) < friction (a disc rolls).
    """
    up, ground = 0.1, Shape("ground", None, "halfplane", angle=math.pi / 2 + angle)
    if kind == "block":
        inertia, shapes = box_inertia(1.0, 0.4, 2 * up), box("corner", "body", 0.4, 2 * up)
    elif kind == "disc":
        inertia, shapes = 0.5 * up**2, (Shape("disc", "body", "disc", up),)
    elif kind == "particle":
        up, inertia, shapes = 0.0, 1.0, (Shape("particle", "body", "disc"),)
    else:
        raise SceneError(f"kind is {shown(kind)}; choose block, particle or disc")
    return Scene(
        name="slope", bodies=(Body("body", 1.0, inertia, joint="free"),), shapes=(*shapes, ground),
        contacts=touching(shapes, (ground,), friction), step_size=0.01, sigma=0.01,
        initial_state=(-math.sin(angle) * up, math.cos(angle) * up, angle, 0.0, 0.0, 0.0),
    )  # fmt: skip


@checked
def box_toss(friction: float = 0.4) -> Scene:
    """A box (.3 m x .2 m, 1 kg) thrown forward with spin; it lands on a corner, tumbles and comes to rest.

    State (x, y, angle) of the centre, then rates. No controls.
    """
    corners = box("corner", "box", 0.3, 0.2)
    return Scene(
        name="box_toss",
        bodies=(Body("box", 1.0, box_inertia(1.0, 0.3, 0.2), joint="free"),),
        shapes=(*corners, GROUND),
        contacts=touching(corners, (GROUND,), friction),
        step_size=0.005,
        sigma=0.02,
        initial_state=(0.0, 0.5, 0.5, 1.5, 1.5, -5.0),
    )


@checked
def rolling_disc(speed: float = 1.0, friction: float = 0.5, radius: float = 0.1) -> Scene:
    """A disc (1 kg) that rolls without slip on the ground, at the gap where the smoothed contact carries it.

    State (x, y, angle) of the centre, then rates. No controls.
    """
    h, sigma = 0.01, 0.01
    gap = -h * sigma * math.log(-math.expm1(-(1.0 + 3.0 * friction**2) * 9.81 * h / (2.0 * sigma)))
    return Scene(
        name="rolling_disc",
        bodies=(Body("disc", 1.0, 0.5 * radius**2, joint="free"),),
        shapes=(Shape("disc", "disc", "disc", radius), GROUND),
        contacts=(Contact("ground", "disc", friction),),
        step_size=h,
        sigma=sigma,
        initial_state=(0.0, radius + gap, 0.0, speed, 0.0, -speed / radius),
    )
