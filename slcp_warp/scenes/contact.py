"""Named scenes of loose bodies: stacks, slopes, collisions, tosses, and contacts that hurt a solver."""

import math
from collections.abc import Sequence

from ..description.scene import Actuator, Body, Contact, Scene, Shape, box, touching
from ..inputs.checks import shown
from ..inputs.errors import SceneError
from .arguments import checked

GROUND = Shape("ground", None, "halfplane", angle=math.pi / 2)


def _box_inertia(mass: float, width: float, height: float) -> float:
    return mass * (width**2 + height**2) / 12.0


@checked
def stack(
    count: int = 3, masses: float | Sequence[float] = 1.0, friction: float = 0.5, size: float = 0.2
) -> Scene:
    """`count` square boxes on each other on the ground, at rest at gap 0; the lowest is first.

    State: (x, y, angle) of every box's centre, then rates. No controls. A box touches the top face below
    it, a half-plane, with its two lower corners: four rows a box.
    """
    each = list(masses) if isinstance(masses, Sequence) else [masses] * count
    if len(each) != count:
        raise SceneError(f"masses has {len(each)} entries; a stack of {count} needs {count}")
    bodies: list[Body] = []
    shapes: list[Shape] = [GROUND]
    contacts: list[Contact] = []
    heights: list[float] = []
    below = GROUND
    for i, mass in enumerate(each):
        bodies.append(Body(f"box{i}", mass, _box_inertia(mass, size, size), joint="free"))
        corners = box(f"box{i}_corner", f"box{i}", size, size)
        top = Shape(f"box{i}_top", f"box{i}", "halfplane", offset=(0.0, size / 2), angle=math.pi / 2)
        contacts += touching(corners[:2], (below,), friction)
        shapes += [*corners, top]
        heights += [0.0, (i + 0.5) * size, 0.0]
        below = top
    return Scene(
        name="stack", bodies=tuple(bodies), shapes=tuple(shapes), contacts=tuple(contacts), step_size=0.01,
        sigma=0.01, initial_state=(*heights, *(0.0 for _ in heights)),
    )  # fmt: skip


@checked
def painleve_rod(friction: float = 1.2, slope: float = 2.0, speed: float = 2.0, length: float = 1.0) -> Scene:
    """Painleve's rod: slender, pushed along the ground on its lower, leading end.

    State (x, y, angle) of the centre, then rates; 1 kg. With rigid Coulomb friction the end's normal
    acceleration per normal force is proportional to 1 + 3 cos^2 - 3 mu sin cos of the rod's inclination,
    negative beyond mu = 4/3 at tan = 2 (`slope` is that tangent): then no finite force keeps the end out.
    Either way the end is braked within a few steps, and the rod tips over it.
    """
    angle = math.atan(slope)
    height = length / 2 * math.sin(angle)
    return Scene(
        name="painleve_rod",
        bodies=(Body("rod", 1.0, length**2 / 12.0, joint="free"),),
        shapes=(Shape("rod", "rod", "capsule", (0.0, length / 2)), GROUND),
        contacts=(Contact("ground", "rod", friction),),
        step_size=0.002,
        sigma=0.01,
        initial_state=(-length / 2 * math.cos(angle), height, -angle, speed, 0.0, 0.0),
    )


@checked
def slope(kind: str = "block", angle: float = 0.3, friction: float = 0.4) -> Scene:
    """A block (.4 m x .2 m), a particle or a disc (radius .1 m) at rest on a slope of `angle` [rad].

    State (x, y, angle) of the centre, then rates; 1 kg. It sticks while tan(angle) < friction (a disc rolls).
    """
    up, ground = 0.1, Shape("ground", None, "halfplane", angle=math.pi / 2 + angle)
    if kind == "block":
        inertia, shapes = _box_inertia(1.0, 0.4, 2 * up), box("corner", "body", 0.4, 2 * up)
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
def two_balls(speed: float = 1.0, offset: float = 0.05, friction: float | None = 0.3) -> Scene:
    """Two discs (radius .1 m, 1 kg and 2 kg) that meet off centre in free space, without gravity.

    State (x, y, angle) of either, then rates; the impact is inelastic and sets both spinning.
    """
    bodies = tuple(
        Body(name, m, 0.5 * m * 0.01, joint="free") for name, m in (("light", 1.0), ("heavy", 2.0))
    )
    return Scene(
        name="two_balls",
        bodies=bodies,
        shapes=(Shape("light", "light", "disc", 0.1), Shape("heavy", "heavy", "disc", 0.1)),
        contacts=(Contact("light", "heavy", friction),),
        gravity=(0.0, 0.0),
        step_size=0.01,
        sigma=0.01,
        initial_state=(-0.4, offset, 0.0, 0.4, 0.0, 0.0, speed, 0.0, 0.0, -speed, 0.0, 0.0),
    )


@checked
def box_toss(friction: float = 0.4) -> Scene:
    """A box (.3 m x .2 m, 1 kg) thrown forward with spin; it lands on a corner, tumbles and comes to rest.

    State (x, y, angle) of the centre, then rates. No controls.
    """
    corners = box("corner", "box", 0.3, 0.2)
    return Scene(
        name="box_toss",
        bodies=(Body("box", 1.0, _box_inertia(1.0, 0.3, 0.2), joint="free"),),
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


@checked
def beam(
    count: int = 8, spread: bool = True, friction: float | None = None, drop: float = 0.15, tilt: float = 0.2
) -> Scene:
    """A beam (1 m x .1 m, 2 kg) that falls from `drop` [m] on `count` point supports: redundant contacts.

    State (x, y, angle) of the centre, then rates. The supports are spread over the beam's length, or
    coincident in two heaps under its ends. Its lower face is a half-plane that turns with it.
    """
    if count < 2:
        raise SceneError(f"count is {count}; a beam needs at least 2 supports")
    half = [-0.4] * (count // 2) + [0.4] * (count - count // 2)
    places = [-0.45 + 0.9 * i / (count - 1) for i in range(count)] if spread else half
    supports = tuple(Shape(f"support{i}", None, "disc", offset=(x, 0.0)) for i, x in enumerate(places))
    face = Shape("face", "beam", "halfplane", offset=(0.0, -0.05), angle=-math.pi / 2)
    return Scene(
        name="beam",
        bodies=(Body("beam", 2.0, _box_inertia(2.0, 1.0, 0.1), joint="free"),),
        shapes=(face, *supports, *box("corner", "beam", 1.0, 0.1)),
        contacts=touching(supports, (face,), friction),
        step_size=0.01,
        sigma=0.01,
        initial_state=(0.0, 0.05 + drop, tilt, 0.0, 0.0, 0.0),
    )


@checked
def opposing_limits(width: float = 1e-4) -> Scene:
    """A pendulum (1 kg, .5 m) held level between two joint limits `width` [rad] apart, swinging at 1 rad/s.

    State (angle, rate); control: a torque. The limits lie closer than the layer of smoothing h sigma.
    """
    pendulum = Body("pendulum", 1.0, 0.01, com=(0.5, 0.0), lower=-width / 2, upper=width / 2)
    return Scene(
        name="opposing_limits",
        bodies=(pendulum,),
        shapes=(Shape("bob", "pendulum", "disc", 0.08, offset=(0.5, 0.0)),),
        actuators=(Actuator("pendulum"),),
        step_size=0.01,
        sigma=0.1,
        initial_state=(0.0, 1.0),
    )


SCENES = (
    stack, painleve_rod, slope, two_balls, box_toss, rolling_disc, beam, opposing_limits,
)  # fmt: skip
