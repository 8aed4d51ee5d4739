"""Parcels of uncertain size, mass and friction go over from a belt to a faster one, which parts them."""

import slcp_warp as slcp
from slcp_warp import measures

NAMES = ("first", "second", "third")
PITCH, HALF, SLOW, FAST = 0.25, 0.08, 0.3, 0.5  # between parcels, of their size [m]; of the belts [m/s]


def scene() -> slcp.Scene:
    """Two decks with a gap of two centimetres; a belt is a heavy body that runs on, and runs its deck."""
    belts = tuple(slcp.Body(name, 500.0, 1.0, joint="prismatic") for name in ("feed", "sorter"))
    parcels = tuple(slcp.Body(name, 1.0, 4.3e-3, joint="free") for name in NAMES)
    deck = {"kind": "rectangle", "corner_radius": 0.02, "surface_ratio": -1.0}  # carries to the right
    boxes = tuple(slcp.Shape(n, n, "rectangle", (HALF, HALF), corner_radius=0.003) for n in NAMES)
    on = [slcp.Contact(deck, name, 0.5) for deck in ("feed", "sorter") for name in NAMES]
    between = [slcp.Contact(a, b, 0.3) for a, b in zip(NAMES, NAMES[1:])]
    return slcp.Scene(
        "conveyor",
        bodies=(*belts, *parcels),
        shapes=(
            slcp.Shape("feed", None, radius=(0.6, 0.05), offset=(-0.61, -0.05), driven_by="feed", **deck),
            slcp.Shape("sorter", None, radius=(1.5, 0.05), offset=(1.51, -0.05), driven_by="sorter", **deck),
            *boxes,
        ),
        contacts=(*on, *between),
        initial_state={
            "feed.vshift": SLOW,
            "sorter.vshift": FAST,
            **{f"{name}.x": -PITCH * (i + 1) for i, name in enumerate(NAMES)},
            **{f"{name}.y": HALF for name in NAMES},
        },
        step_size=0.005,
    )


FRICTION = slcp.Uniform(0.2, 0.8, shared=True)  # of all corners of a parcel on a deck
PARTS = {name: f"{name}.radius_0, {name}.radius_1, {name}.mass, {name}.inertia" for name in NAMES}
conveyor = slcp.Task(
    "conveyor",
    scene(),
    duration=4.0,
    options=slcp.Options("hard", friction="coulomb"),
    disturbances=slcp.Disturbances(
        parameters={
            **{part: slcp.UniformFactor(0.7, 1.3) for part in PARTS.values()},
            **{f"{deck}/{name}.friction": FRICTION for deck in ("feed", "sorter") for name in NAMES},
        },
        start={f"{name}.x": 0.01 for name in NAMES},
        follow={f"{name}.y": f"{name}.radius_1" for name in NAMES},
    ),
    measures={
        "apart": measures.smallest(measures.gap("first/second"), start=3.9),
        "behind": measures.smallest(measures.gap("second/third"), start=3.9),
        "tilted": measures.largest(abs(measures.state("second.angle"))),
        "place": measures.final("third.x"),
        "slid": measures.integral(abs(measures.slip("sorter/second"))),
    },
    success=(measures.smallest(measures.gap("first/second"), start=3.9) > 0.12)
    & (measures.smallest(measures.gap("second/third"), start=3.9) > 0.12)
    & (measures.final("third.x") > 0.1)
    & (measures.final("first.y") > 0.0),
)
