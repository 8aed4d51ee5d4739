"""A task in Python: a ball on a rail knocks a second one into a third, which is to stop at a mark."""

import slcp_warp as slcp
from slcp_warp import measures
from slcp_warp.costs import Term, effort, terms


def knock(mark: float = 0.2) -> slcp.Task:
    """The last ball comes to rest within .05 m of `mark` [m] from where it lay."""
    names, places = ("cue", "middle", "last"), (-0.4, 0.0, 0.15)
    scene = slcp.Scene(
        name="knock",
        bodies=tuple(
            slcp.Body(name, 0.2, 1e-4, joint="prismatic", anchor=(x, 0.0), damping=0.4)
            for name, x in zip(names, places)
        ),
        shapes=tuple(slcp.Shape(name, name, "disc", 0.05) for name in names),
        contacts=(slcp.Contact("cue", "middle"), slcp.Contact("middle", "last")),
        actuators=(slcp.Actuator("cue"),),
        gravity=(0.0, 0.0), step_size=0.02, sigma=0.05,
    )  # fmt: skip
    place = measures.final("last.shift")
    return slcp.Task(
        "knock", scene, horizon=100, control_limits=(-2.0, 2.0),
        cost=terms(scene, [effort(0.01)], [Term("square", 200.0, state="last.shift", target=mark),
                                           Term("square", 20.0, state="last.vshift")]),
        disturbances=slcp.Disturbances(parameters={"mass": 0.1, "damping": 0.1}),
        measures={"place": place, "impulse": measures.impulse("middle/last")},
        success=place.between(mark - 0.05, mark + 0.05),
    )  # fmt: skip
