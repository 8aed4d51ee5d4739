"""A task of many contacts: a pusher moves a stack of boxes to a mark without toppling it."""

from dataclasses import replace

import slcp_warp as slcp
from slcp_warp import measures
from slcp_warp.costs import Term, effort, terms

SIZE = 0.2  # of a box [m]


def push_scene(count: int = 5) -> slcp.Scene:
    """A stack on the ground and, left of its lowest box, a pusher (1 kg) on a rail; control: its force [N].

    State: the pusher's shift, (x, y, angle) of every box from the lowest up, then rates.
    """
    base = slcp.scenes.stack(count, 1.0, 0.5, SIZE)
    face = slcp.Shape("face", "box0", "halfplane", offset=(-SIZE / 2, 0.0), angle=3.141592653589793)
    tip = slcp.Shape("pusher", "pusher", "disc", 0.05)
    pusher = slcp.Body("pusher", 1.0, 1e-3, joint="prismatic", anchor=(-SIZE / 2 - 0.05, 0.08), damping=1.0)
    rest = base.x0[: base.nv]
    return replace(
        base, name="push_stack", bodies=(pusher, *base.bodies), shapes=(*base.shapes, face, tip),
        contacts=(*base.contacts, slcp.Contact("face", "pusher", 0.2)), actuators=(slcp.Actuator("pusher"),),
        step_size=0.02, sigma=0.05, initial_state=(0.0, *rest, *(0.0 for _ in range(base.nv + 1))),
    )  # fmt: skip


def push_stack(count: int = 5, mark: float = 0.3) -> slcp.Task:
    """Every box comes to rest within .05 m of `mark` [m], on the one below it."""
    scene = push_scene(count)
    boxes = [f"box{i}" for i in range(count)]
    final = [
        Term("square", weight, state=f"{name}.{what}", target=target)
        for name in boxes
        for what, weight, target in (
            ("x", 50.0, mark), ("vx", 5.0, 0.0), ("angle", 20.0, 0.0), ("vangle", 1.0, 0.0)
        )
    ]  # fmt: skip
    places = {f"place{i}": measures.final(f"{name}.x") for i, name in enumerate(boxes)}
    top = measures.final(f"{boxes[-1]}.x")
    return slcp.Task(
        "push_stack", scene, horizon=60, control_limits=(-60.0, 60.0),
        cost=terms(scene, [effort(1e-4)], final),
        disturbances=slcp.Disturbances(torque=0.5, parameters={"mass": 0.1, "friction": 0.1}),
        measures={**places, "push": measures.impulse("face/pusher")},
        success=top.between(mark - 0.05, mark + 0.05) & places["place0"].between(mark - 0.05, mark + 0.05),
    )  # fmt: skip
