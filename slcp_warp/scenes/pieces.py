"""What several named scenes share."""

import math

from ..description.parts import Shape

GROUND = Shape("ground", None, "halfplane", angle=math.pi / 2)


def box_inertia(mass: float, width: float, height: float) -> float:
    """Of a box about its centre [kg m^2]."""
    return mass * (width**2 + height**2) / 12.0
