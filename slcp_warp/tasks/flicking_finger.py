"""The paper's experiment (section V): a finger of two links spins an ellipse by flicking it."""

from .. import measures, scenes
from ..costs import Term, effort, terms
from ..inputs.checks import number
from ..options import Options
from .disturbances import Disturbances
from .task import Task


def flicking_finger(c_x: float = 1.0, c_u: float = 0.05) -> Task:
    """Turn the ellipse counter-clockwise; a run succeeds if its second half turns at more than .5 rad/s.

    The cost is section V's: l = -c_x theta_3 + c_u |u|^2, and no final one.
    """
    turn = Term("linear", -number("c_x", c_x), state="ellipse.angle")
    scene = scenes.flicking_finger()
    late = measures.rate("ellipse.angle", start=10.0)
    return Task(
        name="flicking_finger",
        scene=scene,
        cost=terms(scene, [effort(number("c_u", c_u)), turn]),
        horizon=75,
        options=Options(scaling="none"),
        duration=20.0,
        disturbances=Disturbances(
            velocity=2.0, torque=0.1, parameters={"mass": 0.1, "friction": 0.2, "damping": 0.2}
        ),
        measures={
            "rate": measures.rate("ellipse.angle"),
            "late_rate": late,
            "contact_share": measures.contact_share(),
            "lowest_gap": measures.lowest_gap(),
        },
        success=late > 0.5,
    )
