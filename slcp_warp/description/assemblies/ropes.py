"""Ropes: what two points of bodies are apart at most."""

from typing import Any

from ...inputs.checks import number, shown, whole
from ...inputs.errors import SceneError
from ..parts import Contact, Pair2, Shape
from .ends import body_of, point_of


def rope(
    name: str,
    body_a: str | None,
    body_b: str | None,
    length: float,
    point_a: Pair2 = (0.0, 0.0),
    point_b: Pair2 = (0.0, 0.0),
    bit: int = 0,
) -> tuple[tuple[Shape, Shape], Contact]:
    """Shapes and the contact of a rope, which ties a point of a body to one of another and cannot push: a
    point that a ring of the rope's length around the other point holds in, without friction.

    It is a row like those of other contacts, hard or smoothed, with impulses (`name/name_end`), gaps (what it
    has left) and derivatives, of its length, "name.radius", too. A rope that bends over others is not what it
    is; it is straight when it pulls.

    Args:
        name: of the ring; its point is called this with "_end" behind it.
        body_a, body_b: names of bodies, or None for the world.
        length: [m], > 0.
        point_a, point_b: where it is tied, in the frame of their body [m].
        bit: under `contacts="auto"` a bit of contype that no other shape has, by which both find each other,
            unless a joint ties their bodies (`Body.touches_parent`); 0: the contact stands in a scene's list.
    """
    if not (isinstance(name, str) and name):
        raise SceneError(f"name is {shown(name)}; a name is needed")
    body_a, body_b = body_of("body_a", body_a), body_of("body_b", body_b)
    point_a, point_b = point_of("point_a", point_a), point_of("point_b", point_b)
    number("length", length, 0.0, above=True, error=SceneError)
    whole("bit", bit, 0, error=SceneError)
    mine, its = dict[str, Any](), dict[str, Any]()
    if bit:
        smooth = {"friction": 0.0, "restitution": 0.0}
        mine, its = smooth | {"contype": bit, "conaffinity": 0}, smooth | {"contype": 0, "conaffinity": bit}
    rim = Shape(name, body_a, "ring", length, point_a, **mine)
    end = Shape(f"{name}_end", body_b, "disc", 0.0, point_b, **its)
    return (rim, end), Contact(rim.name, end.name)
