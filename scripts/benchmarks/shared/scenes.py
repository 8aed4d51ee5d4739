"""Scenes of any size: a chain along the ground, a beam over points of which some are within reach; and two
seconds of the finger's impacts.
"""

import numpy as np

from slcp_warp import Body, Contact, Scene, Shape

LINK, RADIUS = 0.2, 0.02  # [m]
IMPACTS_START = np.array([-2.2, -0.6, 0.4, 1.0, -1.0, 0.0])  # the finger strikes, misses, strikes again
IMPACTS_DURATION = 2.0  # [s]
IMPACTS_SPREAD = 0.01  # half width of an ensemble's starts


def chain_on_ground(links: int, rows: int) -> Scene:
    """A chain of links along the ground under `rows` rows of contact."""
    bodies = tuple(
        Body(f"link{i}", 0.5, 0.5 * LINK**2 / 12, parent=f"link{i - 1}" if i else None, com=(LINK / 2, 0.0),
             anchor=(LINK, 0.0) if i else (0.0, RADIUS), damping=0.01) for i in range(links)
    )  # fmt: skip
    pairs = rows // 2 + rows % 2
    shapes = [Shape("ground", None, "halfplane", angle=np.pi / 2)]
    contacts = []
    for k in range(pairs):
        at = LINK * (1 + k // links) / (1 + -(-pairs // links))
        shapes.append(Shape(f"foot{k}", f"link{k % links}", "disc", RADIUS, offset=(at, 0.0)))
        frictionless = rows % 2 == 1 and k == pairs - 1
        contacts.append(Contact("ground", f"foot{k}", None if frictionless else 0.5))
    return Scene(f"chain{links}x{rows}", bodies, tuple(shapes), tuple(contacts))


def beam_on_supports(supports: int, near: int) -> Scene:
    """A beam over frictional points, of which `near` carry it and the others are a metre lower."""
    at = np.linspace(-1.0, 1.0, supports)
    order = np.argsort(np.abs(at), kind="stable")[::-1]  # the ends carry first
    height = np.full(supports, -1.0)
    height[order[:near]] = 0.0
    points = [Shape(f"p{i}", None, "disc", 0.0, offset=(at[i], height[i])) for i in range(supports)]
    side = Shape("under", "beam", "halfplane", offset=(0.0, -0.05), angle=-np.pi / 2)
    contacts = tuple(Contact("under", p.name, 0.5) for p in points)
    start = (0.0, 0.05, 0.0, 0.0, 0.0, 0.0)
    return Scene(
        "beam", (Body("beam", 2.0, 0.5, joint="free"),), (side, *points), contacts, initial_state=start
    )
