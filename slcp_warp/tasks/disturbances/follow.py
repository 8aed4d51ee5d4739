"""Starts that go with numbers of a world: a box of another size rests on the ground, too."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...description.columns import column_of, places_of
from ...description.scene import Scene
from ...inputs.checks import instance, number, shown
from ...inputs.errors import ArgumentError, ArgumentTypeError
from .laws import ONE_SIZE

Follow = Mapping[str, Mapping[str, float]]
LABEL = "Disturbances.follow"


def checked(follow: Any) -> dict[str, dict[str, float]]:
    """By state, factors of parameters: from a parameter's name, or a dict of factors by names.

    Raises:
        ArgumentTypeError: anything else.
    """
    given, out = instance(LABEL, follow, Mapping, "a dict of parameters by state name"), {}
    for state, of in given.items():
        if not isinstance(state, str):
            raise ArgumentTypeError(f"{LABEL} has the name {shown(state)}; a text is needed")
        label, by = f"{LABEL}[{state!r}]", {of: 1.0} if isinstance(of, str) else of
        if not isinstance(by, Mapping) or not by or not all(isinstance(name, str) for name in by):
            raise ArgumentTypeError(
                f"{label} is {shown(of)}; a parameter's name, as 'box.radius_1', or a dict of factors by "
                "such names is needed"
            )
        out[state] = {name: number(f"{label}[{name!r}]", factor) for name, factor in by.items()}
    return out


def columns(scene: Scene, follow: Follow) -> list[tuple[int, int, float]]:
    """(place in the state, column of the parameters, factor) of all that follows.

    Raises:
        ArgumentError: a name that the scene has not got, or one of several numbers.
    """
    out = []
    for state, by in follow.items():
        label = f"{LABEL}[{state!r}]"
        for name, factor in by.items():
            places = places_of(scene, name, label)
            if len(places) > 1 and not _is_one_size(scene, places):
                raise ArgumentError(
                    f"{label} names {name!r}, which are {len(places)} numbers; one is needed, as "
                    "'box.radius_1'"
                )
            out.append((scene.state_index(state), places[0], factor))
    return out


def _is_one_size(scene: Scene, places: list[int]) -> bool:
    """Whether numbers are the two equal ones of one disc or ring."""
    name, start, _ = column_of(scene, places[0])
    shapes = {(place - start) // 2 for place in places}
    return name == "radius" and len(shapes) == 1 and scene.shapes[shapes.pop()].kind in ONE_SIZE


def followed(scene: Scene, follow: Follow, x0: Any, table: Any, base: Any) -> np.ndarray:
    """Starts (B, nx) of worlds with these parameters (B, P), where those that they are of are (P,)."""
    out = np.array(x0, float)
    for state, column, factor in columns(scene, follow):
        out[:, state] += factor * (np.asarray(table, float)[:, column] - np.asarray(base, float)[column])
    return out
