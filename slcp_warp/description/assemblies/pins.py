"""Loops of bodies: a pin closes one, where a tree of joints cannot."""

import math

from ...inputs.checks import number, shown
from ...inputs.errors import SceneError
from ..parts import Pair2, Spring
from .ends import body_of, point_of

SHARE, SHORT = 1e-3, 1e-5  # of (M26): eps = length SHARE + SHORT


def pin(
    body_a: str | None,
    body_b: str | None,
    point_a: Pair2,
    point_b: Pair2,
    stiffness: float,
    damping: float,
    arm: float = 1.0,
) -> tuple[Spring, Spring]:
    """Two springs with dampers that hold a point of one body at a point of another: a hinge that closes a
    loop of bodies (a four-bar linkage, a parallel gripper), but for what it yields.

    Both go from the point of `body_b` to points of `body_a` that are `arm` away from its own, one along x and
    one along y of its frame, and pull at right angles while the points are close together. Where these
    coincide nothing is pulled. A force F holds them F/stiffness apart. With m the mass that is felt there,
    the lighter way, and h the time step,

        stiffness = 100 m / h^2,   damping = 2 stiffness h

    leaves less than half of a gap after every step, in either precision and under every contact law. Links of
    length r that turn by w in a step part by about r w^2, whatever the stiffness, and are pulled together in
    the next; a stiffer pin does that harder, and gives or takes more energy.

    Args:
        body_a, body_b: names of bodies, or None for the world. `body_a` carries the springs' other ends: best
            the world, which does not turn (cut a loop through the world there), else what is heavier to turn.
        point_a, point_b: in the frame of their body [m].
        stiffness: > 0 [N/m].
        damping: >= 0 [N s/m].
        arm: > 0 [m]. Of a pull F, what turns with the bodies is not met late (M50): h^2 F must stay below
            twice m arm and, unless `body_a` is the world, below twice I/arm, with I its inertia. A fifth of
            sqrt(I/m) or of a link's length is best; long ones cost energy there, and digits everywhere.

    Raises:
        SceneError: an argument of another kind or size, or two points of one body.
    """
    if body_of("body_a", body_a) == body_of("body_b", body_b):
        raise SceneError(
            f"body_a and body_b are {shown(body_a)}; a pin needs two bodies, or a body and the world (None)"
        )
    (x, y), other = point_of("point_a", point_a), point_of("point_b", point_b)
    number("stiffness", stiffness, 0.0, above=True, error=SceneError)
    number("damping", damping, 0.0, error=SceneError)
    length = _length_that_is(number("arm", arm, 0.0, above=True, error=SceneError))
    return (
        Spring(body_a, body_b, (x + arm, y), other, stiffness, damping, length),
        Spring(body_a, body_b, (x, y + arm), other, stiffness, damping, length),
    )


def _length_that_is(distance: float) -> float:
    """The rest length L of a spring that pulls nothing at a distance: sqrt(distance^2 + eps(L)^2) = L."""
    rest, both = 1.0 - SHARE**2, SHARE * SHORT
    return (both + math.sqrt(both**2 + rest * (distance**2 + SHORT**2))) / rest
