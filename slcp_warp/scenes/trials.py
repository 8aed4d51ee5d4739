"""Contacts that are hard on a solver: stacks, impacts, jams, redundant supports, limits."""

import math
from collections.abc import Sequence

from ..description.parts import Actuator, Body, Contact, Shape, box, touching
from ..description.scene import Scene
from ..inputs.errors import SceneError
from .arguments import checked
from .pieces import GROUND, box_inertia


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
        bodies.append(Body(f"box{i}", mass, box_inertia(mass, size, size), joint="free"))
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
        bodies=(Body("beam", 2.0, box_inertia(2.0, 1.0, 0.1), joint="free"),),
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
