"""Scenes of many contacts by name, `stack:10`, their starts, and what MuJoCo makes of them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slcp_warp import Scene, Shape, scenes

from ..peers.mujoco_model import Geoms

STEP = 0.01  # [s], of every scene
FRICTION = 0.5
RADIUS = 0.1  # of a heap's discs [m]
MOTIONS = ("rest", "tumbling")


@dataclass(frozen=True)
class World:
    """A scene of many contacts.

    Attributes:
        name: as on the command line.
        bodies: how many move.
        geoms: further models of it in MuJoCo, by name, beside that of the scene's own shapes and pairs.
    """

    name: str
    scene: Scene
    bodies: int
    geoms: dict[str, Geoms]

    def starts(self, motion: str, worlds: int, seed: int) -> np.ndarray:
        """States (worlds, nx): the scene's own, `tumbling` with velocities N(0, 1)."""
        x = np.tile(np.asarray(self.scene.x0, float), (worlds, 1))
        nv = self.scene.nv
        x[:, nv:] = np.random.default_rng(seed).standard_normal((worlds, nv)) if motion == "tumbling" else 0.0
        return x


def stack(count: int) -> World:
    """`count` boxes on each other; in MuJoCo also its own boxes, which touch in four points each."""
    scene = scenes.stack(count, friction=FRICTION)
    box = {"type": "box", "size": "0.1 0.1 0.1"}
    geoms: Geoms = {f"box{i}": [box] for i in range(count)}
    return World(f"stack:{count}", scene, count, {"boxes": geoms | {None: [_ground()]}})


def heap(count: int, room: float = 1.05, name: str = "heap") -> World:
    """A heap of `count` discs between two walls: rows of k and k - 1 in each other's hollows.

    k is sqrt(count), and there is `room` for k discs. Everything may touch everything. In MuJoCo also
    spheres, whose pairs its broad phase finds.
    """
    side = RADIUS * max(2, round(math.sqrt(count))) * room
    scene = scenes.heap(count, width=2.0 * side, friction=FRICTION, radius=RADIUS)
    return World(f"{name}:{count}", scene, count, {"spheres": _spheres(scene, side)})


def discs(count: int) -> World:
    """A heap whose rows fit exactly between the walls: what is wedged may be infeasible by a rounding."""
    return heap(count, 1.0, "discs")


def boxes(count: int) -> World:
    """`count` rectangles with rounded corners above ground and between walls; in MuJoCo sharp boxes, which
    touch in up to eight points, and whose pairs its broad phase finds.
    """
    side = RADIUS * max(2, round(math.sqrt(count))) * 1.5
    thrown = scenes.tumbling_boxes(count, width=2.0 * side, friction=FRICTION)
    shapes = [replace(s, contype=1) for s in thrown.shapes if s.body is None]
    shapes += [Shape(b.name, b.name, "rectangle", (RADIUS, RADIUS), corner_radius=0.2 * RADIUS)
               for b in thrown.bodies]  # fmt: skip
    start = np.concatenate([thrown.x0[: thrown.nv], np.zeros(thrown.nv)])
    scene = replace(thrown, name="boxes", shapes=tuple(shapes), initial_state=tuple(start.tolist()))
    cube = {"type": "box", "size": f"{RADIUS!r} {RADIUS!r} {RADIUS!r}"}
    geoms: Geoms = {body.name: [cube] for body in scene.bodies}
    walls = [_ground(), _plane(-side, 0.0, "1 0 0"), _plane(side, 0.0, "-1 0 0")]
    return World(f"boxes:{count}", scene, count, {"boxes": geoms | {None: walls}})


def gas(count: int) -> World:
    """`count` discs far apart, four diameters at the start, that fly between two walls without gravity."""
    side = 4.0 * RADIUS * max(2, round(math.sqrt(count)))
    scene = replace(scenes.heap(count, 2.0 * side, FRICTION, RADIUS, spacing=4.0), gravity=(0.0, 0.0))
    return World(f"gas:{count}", scene, count, {"spheres": _spheres(scene, side)})


def _spheres(scene: Scene, side: float) -> Geoms:
    """MuJoCo's spheres for the discs, between planes: all pairs may touch."""
    geoms: Geoms = {body.name: [{"type": "sphere", "size": repr(RADIUS)}] for body in scene.bodies}
    return geoms | {None: [_ground(), _plane(-side, 0.0, "1 0 0"), _plane(side, 0.0, "-1 0 0")]}


def beam(count: int) -> World:
    """A beam at rest on `count` point supports."""
    scene = scenes.beam(count, friction=FRICTION, drop=0.0, tilt=0.0)
    return World(f"beam:{count}", scene, 1, {})


def _plane(x: float, y: float, normal: str) -> dict[str, str]:
    return {"type": "plane", "size": "0 0 1", "pos": f"{x!r} {y!r} 0", "zaxis": normal}


def _ground() -> dict[str, str]:
    return _plane(0.0, 0.0, "0 1 0")


SIZED: dict[str, Callable[[int], World]] = {
    "stack": stack,
    "heap": heap,
    "discs": discs,
    "boxes": boxes,
    "gas": gas,
    "beam": beam,
}
SINGLE: dict[str, Callable[..., Any]] = {"walker": scenes.walker, "hopper": scenes.hopper}
ALL = ("stack:3", "stack:10", "stack:30", "stack:100", "heap:10", "heap:30", "heap:60", "heap:100",
       "discs:10", "discs:30", "walker", "hopper", "beam:8", "beam:32")  # fmt: skip


def world(name: str) -> World:
    """The world of a name.

    Raises:
        ValueError: there is no such scene, or it needs a number.
    """
    kind, _, size = name.partition(":")
    if kind in SINGLE and not size:
        scene = SINGLE[kind]()
        found = World(name, scene, len(scene.bodies), {})
    elif kind in SIZED and size.isdecimal() and 0 < int(size) < 10_000:
        found = SIZED[kind](int(size))
    else:
        known = [*(f"{kind}:N" for kind in SIZED), *SINGLE]
        raise ValueError(f"--scene is {name!r}; choose from {', '.join(known)}, N a number such as 10")
    return replace(found, scene=replace(found.scene, step_size=STEP))
