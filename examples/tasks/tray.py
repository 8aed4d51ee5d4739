"""A task of many rows: a tray on a cart carries a stack of boxes to a mark, by friction alone."""

import math
from typing import Any

import slcp_warp as slcp
from slcp_warp import measures
from slcp_warp.costs import Term, effort, terms

WIDTH, HEIGHT = 0.12, 0.15  # of a box [m]


def cart_with_boxes(count: int = 2) -> slcp.Scene:
    """A cart of 2 kg on a rail, its top a tray, and a stack of boxes on it. Control: the cart's force [N].

    State: the cart's shift, (x, y, angle) of every box from the lowest up, then rates; two contacts a box.
    """
    lid = slcp.Shape("tray", "cart", "halfplane", angle=math.pi / 2)
    bodies = [slcp.Body("cart", 2.0, 0.1, joint="prismatic", axis=(1.0, 0.0))]
    shapes, contacts, start = [lid], [], [0.0]
    for i in range(count):
        name, mass = f"box{i}", 0.5 * 0.8**i
        bodies.append(slcp.Body(name, mass, mass * (WIDTH**2 + HEIGHT**2) / 12, joint="free"))
        corners = slcp.box(name, name, WIDTH, HEIGHT)
        contacts += slcp.touching((lid,), corners, friction=0.4)
        lid = slcp.Shape(f"lid{i}", name, "halfplane", offset=(0.0, HEIGHT / 2), angle=math.pi / 2)
        shapes += [*corners, lid] if i + 1 < count else [*corners]
        start += [0.0, (i + 0.5) * HEIGHT, 0.0]
    numbers: dict[str, Any] = {
        "step_size": 0.02,
        "sigma": 0.05,
        "initial_state": (*start, *[0.0] * len(start)),
    }
    return slcp.Scene(
        name="tray", bodies=tuple(bodies), shapes=tuple(shapes), contacts=tuple(contacts),
        actuators=(slcp.Actuator("cart"),), **numbers,
    )  # fmt: skip


def tray(count: int = 2, mark: float = 1.0) -> slcp.Task:
    """The cart stands at `mark` [m] after 1.5 s, and every box above it within .05 m."""
    scene, boxes = cart_with_boxes(count), [f"box{i}.x" for i in range(count)]
    running = [effort(1e-3), *(Term("square", 2.0, state=box, minus="cart.shift") for box in boxes)]
    final = [
        Term("square", 500.0, state="cart.shift", target=mark),
        Term("square", 100.0, state="cart.vshift"),
    ]
    final += [Term("square", 100.0, state=box, target=mark) for box in boxes]
    places = {"cart": measures.final("cart.shift"), **{box: measures.final(box) for box in boxes}}
    success = places["cart"].between(mark - 0.02, mark + 0.02)
    for box in boxes:
        success &= places[box].between(mark - 0.05, mark + 0.05)
    return slcp.Task(
        "tray", scene, horizon=75, control_limits=(-20.0, 20.0), cost=terms(scene, running, final),
        disturbances=slcp.Disturbances(
            start={box: 0.01 for box in boxes}, parameters={"mass": 0.1, "friction": 0.1}
        ),
        measures=places, success=success,
    )  # fmt: skip
