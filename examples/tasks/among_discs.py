"""A task where everything may touch: a two-link finger on a table pushes one of several discs to a mark."""

import slcp_warp as slcp
from slcp_warp import measures
from slcp_warp.costs import Term, effort, terms

RADIUS = 0.1  # of a disc [m]
PLACES = ((0.45, -0.55), (1.05, -0.45), (0.3, -0.8), (0.8, -0.6), (0.55, -0.85))


def table(count: int = 5) -> slcp.Scene:
    """The finger and `count` discs, at most five, seen from above. Controls: torques of the two joints [N m].

    State: angles of the links, (x, y, angle) of every disc, then rates.
    """
    links = (
        slcp.Body("upper", 1.0, 0.03, com=(0.25, 0.0), damping=0.2),
        slcp.Body("lower", 0.7, 0.02, parent="upper", anchor=(0.5, 0.0), com=(0.2, 0.0), damping=0.2),
    )
    drag = (0.5, 0.5, 0.02)
    discs = tuple(
        slcp.Body(f"disc{i}", 0.5, 0.25 * RADIUS**2, joint="free", damping=drag) for i in range(count)
    )
    start = (-0.3, -0.3, *(value for place in PLACES[:count] for value in (*place, 0.0)))
    return slcp.Scene(
        name="among_discs",
        bodies=(*links, *discs),
        shapes=(
            slcp.Shape("upper", "upper", "capsule", (0.25, 0.04), offset=(0.25, 0.0)),
            slcp.Shape("lower", "lower", "capsule", (0.2, 0.04), offset=(0.2, 0.0)),
            *(slcp.Shape(f"disc{i}", f"disc{i}", "disc", RADIUS) for i in range(count)),
        ),
        contacts="auto",
        friction=0.4,
        actuators=(slcp.Actuator("upper"), slcp.Actuator("lower")),
        gravity=(0.0, 0.0),
        step_size=0.02,
        sigma=0.05,
        initial_state=start + (0.0,) * len(start),
    )


def among_discs(count: int = 5) -> slcp.Task:
    """The first disc comes to rest within .1 m of (0, -.6), in 1.5 s."""
    scene = table(count)
    mark = {"disc0.x": 0.0, "disc0.y": -0.6}
    final = [Term("square", 100.0, state=name, target=value) for name, value in mark.items()]
    final += [Term("square", 5.0, state=name) for name in ("disc0.vx", "disc0.vy")]
    place = {name: measures.final(name) for name in mark}
    return slcp.Task(
        "among_discs",
        scene,
        horizon=75,
        control_limits=(-5.0, 5.0),
        cost=terms(scene, [effort(1e-3)], final),
        disturbances=slcp.Disturbances(torque=0.1, parameters={"mass": 0.1}),
        measures=place,
        success=place["disc0.x"].between(-0.1, 0.1) & place["disc0.y"].between(-0.7, -0.5),
    )
