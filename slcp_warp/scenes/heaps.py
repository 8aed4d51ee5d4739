"""Heaps: many bodies that may all touch each other, on the ground or between walls."""

import math
from dataclasses import replace

from ..description.parts import Body, Shape, box
from ..description.scene import Scene
from ..inputs.errors import SceneError
from .arguments import checked
from .pieces import GROUND, box_inertia

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0  # its multiples are spread evenly over the circle


@checked
def heap(
    count: int = 3,
    width: float | None = None,
    friction: float | None = 0.5,
    radius: float = 0.1,
    variety: float = 0.0,
    spacing: float = 1.0,
) -> Scene:
    """`count` discs of 1 kg on the ground, in rows that rest in each other's hollows; the lowest row first.

    State: (x, y, angle) of every disc, then rates. No controls. Everything may touch everything.

    Args:
        width: between two walls [m]; None: no walls, a pyramid.
        radius: of the largest [m].
        variety: the smallest disc's radius is this part less than the largest one's, 0 to .9.
        spacing: of the discs at the start, in diameters: above 1 they fall, and far above they are dilute.
    """
    _check_rows(variety, spacing)
    bodies: list[Body] = []
    shapes: list[Shape] = []
    rows: list[float] = []
    for i, (x, y) in enumerate(_places(count, width, radius * spacing)):
        size = radius * (1.0 - variety * ((i * GOLDEN) % 1.0))
        bodies.append(Body(f"disc{i}", 1.0, 0.5 * size**2, joint="free"))
        shapes.append(Shape(f"disc{i}", f"disc{i}", "disc", size))
        rows += [x, y - radius * spacing + size, 0.0]
    return _scene("heap", bodies, shapes, width, friction, rows, [0.0] * len(rows))


@checked
def tumbling_boxes(
    count: int = 1, width: float | None = None, friction: float | None = 0.5, size: float = 0.2
) -> Scene:
    """`count` square boxes of 1 kg with rounded corners, thrown at the ground in rows above it; they tumble.

    State: (x, y, angle) of every box's centre, then rates. No controls. Everything may touch everything:
    corners of a box the sides of the others.

    Args:
        width: between two walls [m]; None: no walls.
        size: of a side [m]; corners are rounded off by a tenth of it.
    """
    bodies: list[Body] = []
    shapes: list[Shape] = []
    rows: list[float] = []
    rates: list[float] = []
    for i, (x, y) in enumerate(_places(count, width, 0.75 * size)):
        name, turn = f"box{i}", 2.0 * math.pi * ((i * GOLDEN) % 1.0)
        bodies.append(Body(name, 1.0, box_inertia(1.0, size, size), joint="free"))
        shapes += box(f"{name}_corner", name, size, size, corner_radius=0.1 * size, sides=True)
        rows += [x, y, turn]
        rates += [math.cos(5.0 * turn), -1.0, 5.0 * math.sin(3.0 * turn)]
    return _scene("tumbling_boxes", bodies, shapes, width, friction, rows, rates)


def _check_rows(variety: float, spacing: float) -> None:
    if not 0.0 <= variety <= 0.9:
        raise SceneError(f"variety is {variety}; a number from 0 to 0.9 is needed")
    if not spacing >= 1.0:
        raise SceneError(f"spacing is {spacing}; at least 1 is needed, or discs would overlap")


def _places(count: int, width: float | None, half: float) -> list[tuple[float, float]]:
    """Centres of circles of radius `half` above the ground: a pyramid, or rows from wall to wall, where every
    other row is shifted by a radius.
    """
    if width is None:
        longest = math.ceil((math.sqrt(8.0 * count + 1.0) - 1.0) / 2.0)
    else:
        longest = math.floor(width / (2.0 * half) * (1.0 + 1e-12))
        if longest < 2:
            raise SceneError(f"width is {width}; at least {4.0 * half:.4g} is needed: two beside each other")
    places: list[tuple[float, float]] = []
    level = 0
    while len(places) < count:
        fewer = level if width is None else level % 2
        for j in range(min(longest - fewer, count - len(places))):
            x = (2.0 * j - (longest - 1.0) + fewer) * half
            places.append((x, half + level * math.sqrt(3.0) * half))
        level += 1
    return places


def _scene(
    name: str, bodies: list[Body], shapes: list[Shape], width: float | None, friction: float | None,
    places: list[float], rates: list[float],
) -> Scene:  # fmt: skip
    container = [replace(GROUND, contype=0)]  # corners of boxes touch it, their sides need not
    if width is not None:
        left = Shape("left_wall", None, "halfplane", offset=(-width / 2.0, 0.0), contype=0)
        right = replace(left, name="right_wall", offset=(width / 2.0, 0.0), angle=math.pi)
        container += [left, right]
    return Scene(
        name=name, bodies=tuple(bodies), shapes=(*container, *shapes), contacts="auto",
        friction=friction, step_size=0.01, sigma=0.01, initial_state=(*places, *rates),
    )  # fmt: skip
