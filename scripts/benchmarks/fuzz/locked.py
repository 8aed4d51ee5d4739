"""Joints that are locked, or nearly: limits that meet, or all but meet, where the joint is or near it."""

from dataclasses import replace

import numpy as np

from slcp_warp import Scene

from .draws import Worlds, decades, draw_worlds, single
from .structures import JOINTS, Size, random_scene

Rng = np.random.Generator
FEWER = 3  # bodies less than other scenes have at most: more rows are limits
MEET, APART, HERE = 0.6, 0.3, 0.6  # shares: of what meets, of that what does not quite, and where it is


def locked_scene(rng: Rng, name: str, size: Size) -> Scene:
    """A random scene half of whose coordinates have both limits."""
    scene = random_scene(rng, name, replace(size, bodies=max(1, size.bodies - FEWER)))
    bodies = []
    for body in scene.bodies:
        has = rng.random(JOINTS[body.joint]) < 0.5
        lower, upper = (tuple(bound if on else None for on in has) for bound in (-1.0, 1.0))
        bodies.append(replace(body, lower=lower, upper=upper))
    return replace(scene, bodies=tuple(bodies))


def locked_worlds(rng: Rng, scene: Scene, worlds: int) -> Worlds:
    """States as elsewhere, between limits that meet."""
    out, s = draw_worlds(rng, scene, worlds), scene.structure
    lower, upper = out.numbers["lower"].copy(), out.numbers["upper"].copy()
    for j in np.flatnonzero(np.array(s.lower, bool) & np.array(s.upper, bool)):
        meets = rng.random(worlds) < MEET
        away = rng.choice([-1.0, 1.0], worlds) * decades(rng, -7, -1, worlds)
        place = single(out.x[:, j] + np.where(rng.random(worlds) < HERE, 0.0, away))
        width = np.where(rng.random(worlds) < APART, decades(rng, -12, -2, worlds), 0.0)
        lower[:, j] = np.where(meets, single(place - 0.5 * width), lower[:, j])
        upper[:, j] = np.where(meets, np.maximum(lower[:, j], single(place + 0.5 * width)), upper[:, j])
    return replace(out, numbers=out.numbers | {"lower": lower, "upper": upper})
