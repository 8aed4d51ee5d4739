"""A cart-pole between two walls: swing the pole up and hold it there."""

import math
from dataclasses import replace

from .. import measures, scenes
from ..costs import Term, effort, terms
from .disturbances import Disturbances
from .task import Task


def cart_pole_walls() -> Task:
    """The pole hangs; at the end it stands, within a quarter radian, and the cart rests in the middle."""
    scene = replace(scenes.cart_pole(wall=0.8), step_size=0.02, sigma=0.05)
    pole, cart = "pole.angle", "cart.shift"
    running = [
        Term("cosine", 0.5, state=pole),
        effort(0.002),
    ]
    final = [
        Term("cosine", 200.0, state=pole),
        Term("square", 20.0, state=cart),
        Term("square", 20.0, state="pole.vangle"),
        Term("square", 20.0, state="cart.vshift"),
    ]
    up = measures.final(measures.cosine(pole))
    return Task(
        name="cart_pole_walls",
        scene=scene,
        cost=terms(scene, running, final),
        horizon=150,
        control_limits=(-20.0, 20.0),
        periods={pole: "turn"},
        start={pole: math.pi, "pole.vangle": 0.0},
        disturbances=Disturbances(
            start={pole: 0.05, "pole.vangle": 0.05},
            torque=0.2,
            parameters={"mass": 0.03, "damping": 0.1},
            sensor={pole: 0.03, "pole.vangle": 0.15, cart: 0.01, "cart.vshift": 0.05},
        ),
        measures={
            "up": up,
            "cart": measures.final(cart),
            "upright_from": measures.settled(measures.cosine(pole) > 0.97),
            "contact_share": measures.contact_share(),
        },
        success=(up > 0.97) & measures.final("pole.vangle").between(-1.0, 1.0),
    )
