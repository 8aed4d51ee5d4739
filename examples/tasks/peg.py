"""A gripper that yields puts a peg into a slot whose place, angle, width and friction are uncertain."""

import numpy as np
import warp as wp

import slcp_warp as slcp
from slcp_warp import measures, policies
from slcp_warp.costs import Point

HALF, LENGTH, DEPTH = 0.005, 0.06, 0.03  # half width and length of the peg, depth of the slot [m]
ROUNDED, ABOVE = 0.001, 0.005  # corners of both; where the tip begins, above the mouth [m]
PEG, LIFT = 0.2, 0.3  # masses [kg]
STEP = 1e-3  # [s]


def scene(stiffness: float = 5e3, turning: float = 20.0, centre: float = 0.03) -> slcp.Scene:
    """A slot in the ground; above it a rail on a servo, a lift that is driven, and the peg on a wrist.

    Args:
        stiffness: of the rail's servo [N/m].
        turning: of the wrist's [N m/rad].
        centre: how far above the peg's tip the wrist turns [m].
    """
    inertia = PEG * (LENGTH**2 + 4.0 * HALF**2) / 12.0
    rail, across = slcp.servo(slcp.Body("rail", 0.5, 1e-3, joint="prismatic"), stiffness)
    lift = slcp.Body(
        "lift", LIFT, 1e-3, parent="rail", joint="prismatic", axis=(0.0, 1.0), anchor=(0.0, ABOVE + centre)
    )
    middle = (0.0, 0.5 * LENGTH - centre)
    peg, turn = slcp.servo(slcp.Body("peg", PEG, inertia, parent="lift", com=middle), turning)
    wall = {"kind": "rectangle", "radius": (0.01, 0.5 * DEPTH), "corner_radius": ROUNDED}
    beside = HALF + 0.001 + 0.01
    return slcp.Scene(
        "peg",
        bodies=(rail, lift, peg),
        shapes=(
            slcp.Shape("left", None, offset=(-beside, -0.5 * DEPTH), **wall),
            slcp.Shape("right", None, offset=(beside, -0.5 * DEPTH), **wall),
            slcp.Shape("floor", None, "halfplane", offset=(0.0, -DEPTH), angle=np.pi / 2),
            slcp.Shape("pin", "peg", "rectangle", (HALF, 0.5 * LENGTH), offset=middle, corner_radius=ROUNDED),
        ),
        contacts=tuple(slcp.Contact(side, "pin", 0.3) for side in ("left", "right", "floor")),
        actuators=(across, slcp.Actuator("lift"), turn),
        step_size=STEP,
    )


DISTURBED = slcp.Disturbances(
    parameters={
        "rail.anchor_x": slcp.Uniform(-0.002, 0.002),  # of the gripper above the slot
        "rail.angle": slcp.Uniform(-0.035, 0.035),  # to which all hangs
        "friction": slcp.Uniform(0.1, 0.6, shared=True),
        "pin.radius_0": slcp.Uniform(HALF - 0.0005, HALF + 0.0005),  # .5 to 1.5 mm of room on either side
    }
)


def insertion(stiffness: float = 5e3, turning: float = 20.0, centre: float = 0.03) -> slcp.Task:
    """The task for a gripper (see `scene`): the tip is at the bottom in the end, to a millimetre."""
    tip = measures.point(Point("peg", (0.0, -centre)), "y")
    in_place = measures.final(tip) < 0.001 - DEPTH
    return slcp.Task(
        "peg",
        scene(stiffness, turning, centre),
        duration=1.2,
        options=slcp.Options("hard", friction="coulomb"),
        disturbances=DISTURBED,
        measures={
            "depth": measures.final(tip),
            "in place": measures.first_time(tip < 0.001 - DEPTH),
            "force": measures.largest(measures.normal_force("pin"), start=0.05),
            "tilt": measures.largest(abs(measures.state("peg.angle"))),
        },
        success=in_place,
    )


def feed(dtype, VX, VU, Data, Memory):
    """Down with a speed, by no more than a force; sways while nothing moves, and remembers for how long."""

    @wp.func
    def control(data: Data, world: int, step: int, x: VX, memory: Memory):
        speed = x[4]  # of the lift
        after = Memory()
        stuck = dtype(0.0)
        if step > 100 and wp.abs(speed) < dtype(0.005) and x[1] > data.bottom:
            stuck = dtype(1.0)
        after[0] = memory[0] + dtype(0.02) * (stuck - memory[0])
        sway = after[0] * wp.sin(dtype(2.0 * wp.pi * 7.0 * STEP) * dtype(step))
        u = VU()
        u[0] = data.across * sway
        u[1] = data.weight + wp.clamp(-dtype(200.0) * (speed + dtype(0.05)), -data.force, data.force)
        u[2] = data.turn * sway
        return u, after

    return control


def push(force: float, across: float = 0.0, turn: float = 0.0) -> policies.Function:
    """By at most `force` [N]; while it is stuck it sways by `across` [m] and `turn` [rad]."""
    weight, bottom = 9.81 * (LIFT + PEG), 0.001 - DEPTH - ABOVE
    numbers = {"force": force, "across": across, "turn": turn, "weight": weight, "bottom": bottom}
    return policies.Function(feed, memory=1, **numbers)
