"""Heaps as random scenes: the named ones of many bodies on each other, and states near where they start."""

from dataclasses import replace
from typing import Any

import numpy as np

from slcp_warp import Scene, scenes
from slcp_warp.description.kinematics import Array
from slcp_warp.description.topology import contact_ends

from ..mechanics.contact import gaps
from ..mechanics.tree import Mechanics
from .draws import CLASSES, COARSE, Worlds, decades, single
from .structures import Size

Rng = np.random.Generator
MOST_ROWS = 140
TOWER = (46, 71)  # boxes; from 46 blocks on an island is large (`kernels/generic/friction/direct.py`)
PILE = {"stack": (21, 46), "heap": (12, 41)}  # bodies of what is neither small nor large there
SHIFTS = (0.0, 1e-6, 1e-3, 2e-2)  # standard deviations of positions [m, rad]
TOUCH = 1e-3  # a pair this near touches [m]


def random_heap(rng: Rng, name: str, size: Size) -> Scene:
    """A stack, a heap, tumbling boxes or a beam, of at most MOST_ROWS rows; `size` is of mechanisms."""
    while True:
        scene = replace(_drawn(rng), name=name)
        if scene.structure.nr <= MOST_ROWS:
            return scene


def _drawn(rng: Rng) -> Scene:
    kind, friction = str(rng.choice(["stack", "heap", "boxes", "beam"])), float(rng.uniform(0.0, 1.2))
    mu = None if rng.random() < 0.2 else friction
    walls = float(rng.uniform(0.7, 1.2)) if rng.random() < 0.5 else None
    if kind == "stack":
        count = int(rng.integers(2, 9))
        return scenes.stack(count, masses=tuple(10.0 ** rng.uniform(-3.0, 3.0, count)), friction=friction)
    if kind == "heap":
        return scenes.heap(int(rng.integers(3, 10)), walls, mu, variety=float(rng.uniform(0.0, 0.8)),
                           spacing=float(rng.choice([1.0, 1.0, 1.2])))  # fmt: skip
    if kind == "boxes":
        return scenes.tumbling_boxes(int(rng.integers(2, 5)), walls, mu)
    return scenes.beam(int(rng.integers(3, 30)), bool(rng.random() < 0.5), mu)


def random_tower(rng: Rng, name: str, size: Size) -> Scene:
    """A stack of so many boxes that common kernels solve its friction as that of a large island."""
    count = int(rng.integers(*TOWER))
    masses = tuple(10.0 ** rng.uniform(-1.0, 1.0, count)) if rng.random() < 0.5 else 1.0
    return replace(scenes.stack(count, masses=masses, friction=float(rng.uniform(0.0, 1.2))), name=name)


def random_pile(rng: Rng, name: str, size: Size) -> Scene:
    """A stack or a heap of so many bodies that passes come before a path; of any masses."""
    kind, friction = str(rng.choice(list(PILE))), float(rng.uniform(0.0, 1.2))
    count = int(rng.integers(*PILE[kind]))
    if kind == "stack":
        masses = tuple(10.0 ** rng.uniform(-1.0, 1.0, count)) if rng.random() < 0.5 else 1.0
        return replace(scenes.stack(count, masses=masses, friction=friction), name=name)
    walls = 0.1 * max(2, round(count**0.5)) * float(rng.uniform(2.0, 2.4))
    made = scenes.heap(count, walls, friction, variety=float(rng.choice([0.0, 0.3])))
    return replace(made, name=name)


def heap_worlds(rng: Rng, scene: Scene, worlds: int) -> Worlds:
    """Worlds near the scene's start: shifted, thrown, of other masses, step sizes, noise and friction."""
    s, base = scene.structure, scene.default_parameters()
    numbers: dict[str, Any] = {n: np.repeat(np.asarray(v)[None], worlds, 0) for n, v in base.items()}
    factor = np.where(rng.random((worlds, 1)) < 0.5, 1.0, decades(rng, -2.0, 2.0, worlds, s.nb))
    numbers["mass"], numbers["inertia"] = numbers["mass"] * factor, numbers["inertia"] * factor
    numbers["step_size"] = np.where(rng.random(worlds) < 0.5, 0.01, decades(rng, -3.0, -1.0, worlds))
    numbers["sigma"] = decades(rng, -4.0, -1.0, worlds, 1) * np.ones(s.nr)
    first = 0  # pair of a contact; all of its pairs have one coefficient
    for contact in scene.all_contacts:
        pairs = range(first, first + len(contact_ends(scene.shapes, contact)))
        if contact.friction is not None:
            some = rng.uniform(0.0, 1.5, worlds)
            numbers["friction"][:, pairs] = np.where(rng.random(worlds) < 0.5, some, contact.friction)[
                :, None
            ]
        first = pairs.stop
    shift = rng.choice(SHIFTS, (worlds, 1))
    q = scene.x0[: s.nv] + shift * rng.standard_normal((worlds, s.nv))
    fast = np.where(rng.random((worlds, 1)) < 0.4, 0.0, decades(rng, -3.0, 1.0, worlds, 1))
    v = scene.x0[s.nv :] + fast * rng.standard_normal((worlds, s.nv))
    x, numbers = single(np.concatenate([q, v], 1)), {name: single(v) for name, v in numbers.items()}
    return Worlds(numbers, x, np.zeros((worlds, s.nu)), _classes(scene, numbers, x, fast[:, 0]))


def _classes(scene: Scene, numbers: dict[str, Array], x: Array, fast: Array) -> Array:
    """deep: something overlaps by more than TOUCH; entering: it touches, and is fast; touching; far."""
    gap = gaps(Mechanics(scene, numbers), x[:, : scene.nv], COARSE).min(1, initial=np.inf)
    names = np.where(gap < -TOUCH, "deep", np.where(gap > TOUCH, "far", "touching"))
    names = np.where((names == "touching") & (fast > 0.1), "entering", names)
    return np.array([CLASSES.index(name) for name in names])
