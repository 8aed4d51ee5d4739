"""Catch a falling ball with a concave paddle on a cart."""

from .. import measures
from ..costs import Term, effort, terms
from ..description.parts import Actuator, Body, Contact, Shape
from ..description.scene import Scene
from .disturbances import Disturbances
from .task import Task

TILT = 0.35  # of either half of the paddle [rad]


def paddle_scene() -> Scene:
    """A cart on a rail (1 kg) with a paddle of two capsules that turns on a spring, and a ball above it.

    Controls: force on the cart [N], torque on the paddle [N m].
    """
    halves = [
        Shape("left", "paddle", "capsule", (0.02, 0.16), offset=(-0.15, 0.055), angle=-TILT),
        Shape("right", "paddle", "capsule", (0.02, 0.16), offset=(0.15, 0.055), angle=TILT),
    ]
    return Scene(
        name="catch",
        bodies=(
            Body("cart", 1.0, 0.05, joint="prismatic", damping=0.5, lower=-1.0, upper=1.0),
            Body("paddle", 0.3, 0.01, parent="cart", damping=0.5, stiffness=20.0, lower=-0.7, upper=0.7),
            Body("ball", 0.2, 0.5 * 0.2 * 0.05**2, joint="free"),
        ),
        shapes=(*halves, Shape("ball", "ball", "disc", 0.05)),
        contacts=tuple(Contact(half.name, "ball", 0.3) for half in halves),
        actuators=(Actuator("cart"), Actuator("paddle")),
        step_size=0.02,
        sigma=0.05,
        initial_state=(0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, -0.3, 0.0, 0.0),
        implicit_stiffness=False,
    )


def catch() -> Task:
    """The ball lies in the paddle at the end and rests there."""
    scene = paddle_scene()
    running = [
        Term("absolute", 1.0, state="paddle.angle", width=0.3),
        effort(0.001),
        Term("absolute", 4.0, state="ball.x", minus="cart.shift"),
        Term("square", 0.2, state="ball.vx", minus="cart.vshift"),
        Term("square", 0.02, state="paddle.vangle"),
        Term("square", 0.1, state="cart.shift"),
    ]
    final = [
        Term("square", 50.0, state="ball.x", minus="cart.shift"),
        Term("square", 5.0, state="ball.vx", minus="cart.vshift"),
        Term("square", 5.0, state="cart.vshift"),
        Term("below", 200.0, state="ball.y", target=0.05),
        Term("square", 5.0, state="ball.vy"),
    ]
    off, height = measures.final(measures.state("ball.x", "cart.shift")), measures.final("ball.y")
    return Task(
        name="catch",
        scene=scene,
        cost=terms(scene, running, final),
        horizon=80,
        control_limits=(-20.0, 20.0),
        disturbances=Disturbances(
            start={"ball.x": 0.15, "ball.vx": 0.5}, torque=2.0, parameters={"mass": 0.3, "friction": 0.3}
        ),
        measures={"off": off, "height": height, "touched": measures.first_time(measures.contact() > 0.5)},
        success=off.between(-0.15, 0.15) & (height > 0.0),
    )
