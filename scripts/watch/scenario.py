"""A task's kicks and pushes as buttons of the page: what a sweep draws, or what `slcp falsify` found."""

import math
from collections.abc import Callable

import numpy as np

import slcp_warp as slcp
from slcp_warp.kernels.ensembles.draws import LAWS
from slcp_warp.tasks.disturbances.distributions import Distribution

from .world import Shove, Worlds

Button = Callable[[Worlds], None]


def buttons_of(task: slcp.Task, name: str = "", seed: int = 0) -> dict[str, Button]:
    """Buttons for what disturbs a task while it runs; every press draws anew.

    Args:
        task: whose disturbances they are.
        name: before theirs.
        seed: of the draws.
    """
    found: dict[str, Button] = {}
    own, scene, rng = task.disturbances, task.scene, np.random.default_rng(seed)
    before = f"{name}: " if name else ""
    if own.kick or own.kicks:
        found[f"{before}kick"] = _kick(own, scene, rng)
    for i, push in enumerate(own.pushes):
        label = f"{before}push {push.body}"
        found[label if label not in found else f"{label} {i + 1}"] = _push(push, scene, rng)
    return found


def drawn(value: float | Distribution, rng: np.random.Generator) -> float:
    """A number of its distribution; a number itself."""
    if not isinstance(value, Distribution):
        return float(value)
    law, base, first, second = value.row(None)
    if LAWS[law] == "uniform":
        return float(rng.uniform(first, second))
    z = rng.standard_normal()
    return float(base * math.exp(first * z) if LAWS[law] == "log-normal" else base + first * z)


def _kick(own: slcp.Disturbances, scene: slcp.Scene, rng: np.random.Generator) -> Button:
    def kick(worlds: Worlds) -> None:
        for row in worlds.state:
            row[scene.nv :] += [
                drawn(own.kicks[n], rng) if n in own.kicks else own.kick * rng.standard_normal()
                for n in scene.state_names[scene.nv :]
            ]

    return kick


def _push(push: slcp.Push, scene: slcp.Scene, rng: np.random.Generator) -> Button:
    body = next(i for i, each in enumerate(scene.bodies) if each.name == push.body)
    at = scene.default_parameters()["com"][body] if push.at is None else np.array(push.at, float)

    def shove(worlds: Worlds) -> None:
        force = np.array([drawn(each, rng) for each in push.force])
        worlds.shoves.append(Shove(body, at, force, drawn(push.torque, rng), drawn(push.duration, rng)))

    return shove
