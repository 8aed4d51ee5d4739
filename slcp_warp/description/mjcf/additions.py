"""What a scene read from MJCF gets beside what touches by MuJoCo's rules, for `reader.py`: ropes, brakes."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..assemblies.brakes import brake
from ..parts import Body, Contact, Shape
from ..scene import Scene
from .motors import Coordinate
from .names import named
from .plane import MjcfError


def with_contacts(scene: Scene, shapes: Sequence[Shape], contacts: Sequence[Contact], **more: Any) -> Scene:
    """A scene with further shapes, which touch each other as listed and nothing else, and other fields."""
    if not shapes:
        return scene
    listed = scene.with_listed_contacts()
    return replace(listed, shapes=(*listed.shapes, *shapes), contacts=(*listed.contacts, *contacts), **more)


def with_brakes(scene: Scene, m: Any, coordinates: Mapping[int, Coordinate]) -> Scene:
    """A scene with a brake for every joint of its model that has dry friction, in the order of joints.

    Args:
        coordinates: here, of every joint.

    Raises:
        MjcfError: a joint of a free body has some.
    """
    bodies = {body.name: body for body in scene.bodies}
    pads, shapes, contacts = list[Body](), list[Shape](), list[Contact]()
    for j, at in coordinates.items():
        holds = float(m.dof_frictionloss[m.jnt_dofadr[j]])
        if holds == 0.0:
            continue
        if bodies[at.body].joint == "free":
            raise MjcfError(
                f"joint {named(m, 'joint', j)!r}: frictionloss is {holds:g}; a joint that turns or shifts by "
                "itself can have a brake, those of a free body cannot"
            )
        pad, shoes, contact = brake(bodies[at.body], holds)
        pads.append(pad)
        shapes += shoes
        contacts.append(contact)
    q, v = np.split(np.array(scene.initial_state), 2)
    rest = np.zeros(len(pads))
    state = tuple(np.concatenate([q, rest, v, rest]).tolist())
    return with_contacts(scene, shapes, contacts, bodies=(*scene.bodies, *pads), initial_state=state)
