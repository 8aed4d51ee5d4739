"""Dry friction of joints: a pad that a spring presses on the body that the joint moves."""

import dataclasses
from typing import Any

import numpy as np

from ...inputs.checks import instance, number, whole
from ...inputs.errors import SceneError
from ..parts import Body, Contact, Shape

LIGHT = 1e-6  # of the pad's mass: its weight where g = 10 m/s^2, as a share of what the spring presses with
# of its armature, which weighs nothing: by the force [s^2/m], to be pressed faster than smoothing feels, and
# at least as a share of the body's mass, which single precision needs
INERT, LEAST = 1e-4, 1e-5
FAR = 1e6  # the spring's rest position, in lengths that the pad could move: it presses alike wherever that is


def brake(
    body: Body, holds: float, friction: float = 0.5, radius: float = 0.05, bit: int = 0
) -> tuple[Body, tuple[Shape, Shape], Contact]:
    """A body, two shapes and a contact that give the joint of a body dry friction.

    A pad on the joint's other side is pressed on a rim about a joint that turns, or on a face along one that
    shifts. It holds up to `holds`, and brakes with that what moves: exactly under Coulomb's law, to some 1e-3
    under Anitescu's relaxation; smoothed contact creeps below what it holds. What it holds goes with
    `"NAME_lining/NAME_rim.friction"`, which is drawn, mapped and differentiated as others are.

    The pad is one more coordinate, `NAME_pad.shift`, that stays where it is: bodies come in a scene's order,
    so put it last. Its weight is 1e-6 of what presses it.

    Args:
        body: whose joint it is, NAME its name; "revolute" or "prismatic".
        holds: [N m, N], > 0.
        friction: of pad and rim, > 0.
        radius: of the rim, and of a pad on a face [m], > 0.
        bit: under `contacts="auto"` a bit of contype that no other shape has, by which pad and rim find each
            other; 0: the contact stands in a scene's list.
    """
    instance("body", body, Body, "a Body")
    number("holds", holds, 0.0, above=True, error=SceneError)
    number("friction", friction, 0.0, above=True, error=SceneError)
    number("radius", radius, 0.0, above=True, error=SceneError)
    whole("bit", bit, 0, error=SceneError)
    if body.joint not in ("revolute", "prismatic"):
        raise SceneError(
            f"body {body.name!r}: its joint is {body.joint!r}; a brake needs a revolute or prismatic one"
        )
    turns = body.joint == "revolute"
    force = holds / (friction * radius) if turns else holds / friction
    along = np.array([1.0, 0.0] if turns else body.axis)
    across = np.array([-along[1], along[0]])
    # the face of a body that shifts is turned with it, and passes through its joint
    mass, armature = LIGHT * force / 10.0, max(INERT * force, LEAST * body.mass)
    pad = Body(
        f"{body.name}_pad", mass, mass * radius**2, body.parent, "prismatic", armature=armature,
        anchor=tuple((np.array(body.anchor) + radius * across).tolist()), axis=tuple(across.tolist()),
        stiffness=force / (FAR * radius), rest=-FAR * radius,
    )  # fmt: skip
    heading = float(np.arctan2(across[1], across[0]))
    names = f"{body.name}_lining", f"{body.name}_rim"
    if turns:
        lining = Shape(names[0], pad.name, "halfplane", angle=heading + np.pi)
        rim = Shape(names[1], body.name, "disc", radius)
    else:
        lining = Shape(names[0], pad.name, "disc", radius)
        rim = Shape(names[1], body.name, "halfplane", angle=heading - body.angle)
    if bit:
        alone: dict[str, Any] = {"contype": bit, "conaffinity": bit, "friction": friction, "restitution": 0.0}
        lining, rim = (dataclasses.replace(shape, **alone) for shape in (lining, rim))
    return pad, (lining, rim), Contact(lining.name, rim.name, friction)
