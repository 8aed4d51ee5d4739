"""A parallel gripper takes boxes of uncertain size, mass and friction from a table, and lifts them."""

import numpy as np

import slcp_warp as slcp
from slcp_warp import measures, policies

HALF = 0.03  # of the box's width and height [m]


def scene() -> slcp.Scene:
    """A rail and a lift on servos; of two fingers one tendon keeps the middle, another closes them."""
    rail, across = slcp.servo(slcp.Body("rail", 2.0, 0.01, joint="prismatic"), 2e4, 400.0)
    up = slcp.Body("lift", 1.0, 0.01, parent="rail", joint="prismatic", axis=(0.0, 1.0), anchor=(0.0, 0.035))
    lift, upwards = slcp.servo(up, 2e4, 400.0)
    finger = {"parent": "lift", "joint": "prismatic", "damping": 5.0, "lower": -0.02, "upper": 0.05}
    left = slcp.Body("left", 0.2, 1e-4, anchor=(-0.06, 0.0), axis=(1.0, 0.0), **finger)
    right = slcp.Body("right", 0.2, 1e-4, anchor=(0.06, 0.0), axis=(-1.0, 0.0), **finger)
    box = slcp.Body("box", 0.3, 1.8e-4, joint="free")
    pad = {"kind": "rectangle", "radius": (0.01, 0.02), "corner_radius": 0.003}
    return slcp.Scene(
        "lift",
        bodies=(rail, lift, left, right, box),
        shapes=(
            slcp.Shape("table", None, "halfplane", angle=np.pi / 2),
            slcp.Shape("pad_left", "left", **pad),
            slcp.Shape("pad_right", "right", **pad),
            slcp.Shape("box", "box", "rectangle", (HALF, HALF)),
        ),
        contacts=tuple(slcp.Contact(other, "box", 0.5) for other in ("table", "pad_left", "pad_right")),
        tendons=(
            slcp.Tendon("middle", ("left.shift", "right.shift"), (1.0, -1.0), stiffness=1e5, damping=1e3),
            slcp.Tendon("grip", ("left.shift", "right.shift"), (1.0, 1.0)),
        ),
        actuators=(across, upwards, slcp.Actuator(tendon="grip")),
        initial_state={"box.y": HALF},
        step_size=0.005,
    )


DISTURBED = slcp.Disturbances(
    parameters={
        "box.radius_0, box.radius_1": slcp.UniformFactor(0.85, 1.15),
        "box.mass, box.inertia": slcp.UniformFactor(0.7, 1.3),
        "pad_left/box.friction, pad_right/box.friction": slcp.Uniform(0.2, 0.8, shared=True),
    },
    follow={"box.y": "box.radius_1"},
    pushes=(slcp.Push("box", slcp.Uniform(2.0, 2.2), 0.1, (slcp.Normal(1.0), slcp.Normal(1.0))),),
)
held = measures.time() > 0.5  # when the lift begins
touching = measures.contact("left/box") > 0.5
lift = slcp.Task(
    "lift",
    scene(),
    duration=2.5,
    options=slcp.Options("hard", friction="coulomb"),
    disturbances=DISTURBED,
    measures={
        "height": measures.final("box.y"),
        "slid": measures.integral(abs(measures.slip("left/box")), where=held),
        "slip speed": measures.largest(abs(measures.slip("left/box")), where=held),
        "grip": measures.mean(measures.normal_force("left/box"), where=held & touching),
        "on the box": measures.largest(measures.normal_force("box"), start=0.5),
        "dropped": measures.first_time((measures.contact("left/box") < 0.5) & held),
    },
    success=(measures.final("box.y") > 0.16) & (measures.largest(abs(measures.state("box.angle"))) < 0.3),
)


def script(force: float) -> policies.OpenLoop:
    """Close at 0.1 s, lift by 15 cm from 0.5 to 1.3 s, hold."""
    t = lift.scene.step_size * np.arange(lift.steps)
    share = np.clip((t - 0.5) / 0.8, 0.0, 1.0)
    u = np.zeros((lift.steps, 3))
    u[:, 1], u[:, 2] = 0.15 * share**2 * (3.0 - 2.0 * share), np.where(t < 0.1, 0.0, force)
    return policies.OpenLoop(u, lift.scene.step_size)
