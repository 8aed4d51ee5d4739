"""The structures of the stability battery: few, because every structure compiles kernels of its own.

Numbers (masses, radii, offsets, slopes, limits) come from the cases as parameters.
"""

import math

from slcp_warp import Actuator, Body, Contact, Scene, Shape, Spring

UP = math.pi / 2


def _ground(**where: float) -> Shape:
    return Shape("ground", None, "halfplane", angle=where.get("angle", UP))


def disc() -> Scene:
    """A free disc (a point by default) on a half-plane with friction: 3 degrees of freedom, 2 rows."""
    return Scene(
        "disc",
        (Body("disc", 1.0, 1.0, joint="free"),),
        (Shape("disc", "disc", "disc"), _ground()),
        (Contact("ground", "disc", 0.5),),
    )


def two_points() -> Scene:
    """A free body on two points (the lower corners of a block, the ends of a rod, coincident supports)."""
    return Scene(
        "two_points",
        (Body("block", 1.0, 1.0 / 60.0, joint="free"),),
        (Shape("left", "block", "disc", offset=(-0.2, -0.1)),
         Shape("right", "block", "disc", offset=(0.2, -0.1)), _ground()),
        (Contact("ground", "left", 0.5), Contact("ground", "right", 0.5)),
    )  # fmt: skip


def box() -> Scene:
    """A box of .4 m x .2 m on its four corners: 8 rows."""
    corners = [(x, y) for y in (-0.1, 0.1) for x in (-0.2, 0.2)]
    shapes = [Shape(f"corner{i}", "box", "disc", offset=at) for i, at in enumerate(corners)]
    return Scene(
        "box",
        (Body("box", 1.0, 1.0 / 60.0, joint="free"),),
        (*shapes, _ground()),
        tuple(Contact("ground", shape.name, 0.5) for shape in shapes),
    )


def column(bodies: int = 3, radius: float = 0.1) -> Scene:
    """Discs that slide along one vertical line, each on the one below: one frictionless row a body."""
    names = [f"disc{i}" for i in range(bodies)]
    return Scene(
        f"column{bodies}",
        tuple(Body(n, 1.0, 1.0, joint="prismatic", axis=(0.0, 1.0), anchor=(0.0, radius * (2 * i + 1)))
              for i, n in enumerate(names)),
        (_ground(), *(Shape(n, n, "disc", radius) for n in names)),
        tuple(Contact(a, b) for a, b in zip(["ground", *names], names)),
    )  # fmt: skip


def ellipses() -> Scene:
    """A free ellipse against one that the world holds, without friction: 1 row."""
    return Scene(
        "ellipses",
        (Body("free", 1.0, 1.0, joint="free"),),
        (Shape("wall", None, "ellipse", (0.025, 1.0)), Shape("free", "free", "ellipse", (0.05, 0.05))),
        (Contact("wall", "free"),),
        gravity=(0.0, 0.0),
    )


def slider() -> Scene:
    """One prismatic joint between a lower and an upper limit, pushed by a control: 2 rows."""
    return Scene(
        "slider",
        (Body("slider", 1.0, 1.0, joint="prismatic", lower=-1.0, upper=1.0),),
        actuators=(Actuator("slider"),),
        gravity=(0.0, 0.0),
    )


def damped() -> Scene:
    """One damped prismatic joint between far limits: 2 rows that never act."""
    return Scene(
        "damped",
        (Body("slider", 1.0, 1.0, joint="prismatic", lower=-100.0, upper=100.0, damping=1.0),),
        gravity=(0.0, 0.0),
    )


def sprung() -> Scene:
    """One prismatic joint on a spring between far limits: 2 rows that never act."""
    return Scene(
        "sprung",
        (Body("slider", 1.0, 1.0, joint="prismatic", lower=-100.0, upper=100.0, stiffness=1.0),),
        gravity=(0.0, 0.0),
    )


def tied() -> Scene:
    """A disc tied to the origin by a spring of length .5, over ground that is far: 1 row that never acts."""
    return Scene(
        "tied",
        (Body("ball", 1.0, 0.01, joint="free"),),
        (
            Shape("ball", "ball", "disc", 0.1),
            Shape("ground", None, "halfplane", offset=(0.0, -100.0), angle=UP),
        ),
        (Contact("ground", "ball"),),
        gravity=(0.0, 0.0),
        springs=(Spring(None, "ball", stiffness=1.0, length=0.5),),
    )


def guide() -> Scene:
    """A disc that slides along a guide, without gravity, above a half-plane with friction that `shape_angle`
    tilts towards it: 2 rows, whose normal part is small where the tilt is.
    """
    return Scene(
        "guide",
        (Body("slider", 1.0, 0.1, joint="prismatic"),),
        (Shape("disc", "slider", "disc", 0.1), _ground()),
        (Contact("ground", "disc", 0.5),),
        gravity=(0.0, 0.0),
    )


def lever() -> Scene:
    """A body turning about its centre of mass, with a point at `shape_offset` above a half-plane: 1 row."""
    return Scene(
        "lever",
        (Body("lever", 1.0, 1.0),),
        (Shape("tip", "lever", "disc", offset=(0.1, 0.0)), _ground()),
        (Contact("ground", "tip"),),
        (Actuator("lever"),),
    )


def stack(boxes: int, width: float = 0.4, height: float = 0.2) -> Scene:
    """Free boxes on each other by their lower corners, with friction; each carries a half-plane on top."""
    names = [f"box{i}" for i in range(boxes)]
    bodies, shapes, contacts = [], [_ground()], []
    for i, name in enumerate(names):
        bodies.append(Body(name, 1.0, (width**2 + height**2) / 12.0, joint="free"))
        shapes.append(Shape(f"top{i}", name, "halfplane", offset=(0.0, height / 2), angle=UP))
        for side, x in (("left", -width / 2), ("right", width / 2)):
            shapes.append(Shape(f"{side}{i}", name, "disc", offset=(x, -height / 2)))
            contacts.append(Contact("ground" if i == 0 else f"top{i - 1}", f"{side}{i}", 0.5))
    x0 = [c for i in range(boxes) for c in (0.0, height * (i + 0.5), 0.0)] + [0.0] * (3 * boxes)
    return Scene(f"stack{boxes}", tuple(bodies), tuple(shapes), tuple(contacts), initial_state=tuple(x0))


def beam(supports: int, spread: bool = True) -> Scene:
    """A beam of 2 m on many points, spread along it or all in one place, with friction."""
    at = [(-1.0 + 2.0 * i / (supports - 1) if spread else 0.0, -0.1) for i in range(supports)]
    shapes = [Shape(f"point{i}", "beam", "disc", offset=p) for i, p in enumerate(at)]
    kind = "spread" if spread else "coincident"
    return Scene(
        f"beam{supports}_{kind}",
        (Body("beam", 1.0, 1.0 / 3.0, joint="free"),),
        (*shapes, _ground()),
        tuple(Contact("ground", shape.name, 0.5) for shape in shapes),
        initial_state=(0.0, 0.1, 0.0, 0.0, 0.0, 0.0),
    )
