"""Scenes of the stability battery in MuJoCo: its defaults, and the best of its documented options per scene.

Planar bodies get two slides and a hinge; blocks are MuJoCo's boxes, discs spheres, the thin wall a box. Every
model's masses and first distance are compared with the scene's. MuJoCo is only imported when asked for.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..peers.mujoco_model import import_mujoco
from .case import Array, G

_GEOMS = {"solref": "H", "solimp": "0.99 0.9999 0.0001"}  # H: two steps, the stiffest that MuJoCo allows
_STIFF = {"cone": "elliptic", "impratio": "100", "noslip_iterations": "50", "iterations": "200",
          "tolerance": "1e-14", "integrator": "implicitfast"}  # fmt: skip
OPTIONS: dict[str, tuple[dict[str, str], dict[str, str], tuple[str, ...]]] = {
    # name: attributes of <option>, of every geom, flags
    "default": ({}, {}, ()),
    "noslip": ({"cone": "elliptic", "noslip_iterations": "50", "tolerance": "1e-14"}, {}, ()),
    "speculative": ({}, {}, ("speculative",)),
    "stiff": (_STIFF, _GEOMS, ()),
    "stiff, RK4": ({**_STIFF, "integrator": "RK4"}, _GEOMS, ()),
    "stiff, speculative": (_STIFF, _GEOMS, ("speculative",)),
}


@dataclass(frozen=True)
class Thing:
    """A planar body: MuJoCo geom, mass, inertia about z, and state (x, y, angle, rates)."""

    geom: str
    mass: float
    inertia: float
    state: tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Scenario:
    """A case of the battery as MuJoCo has it, compared under `name` and `variant` with the battery's rows.

    measure takes states (N + 1, bodies, 6); gap is the first pair's distance at the start.
    """

    name: str
    variant: float
    things: tuple[Thing, ...]
    world: str
    duration: float
    measure: Callable[[Array], float]
    unit: str
    gap: float = 0.0
    gravity: float = G


def model_xml(scene: Scenario, h: float, option: str) -> str:
    """The MJCF of a scenario."""
    options, geoms, flags = OPTIONS[option]
    geoms = {k: f"{2 * h} 1" if v == "H" else v for k, v in geoms.items()}
    attributes = " ".join(f'{k}="{v}"' for k, v in options.items())
    default = " ".join(f'{k}="{v}"' for k, v in geoms.items())
    bodies = ""
    for i, thing in enumerate(scene.things):
        bodies += f"""<body name="b{i}"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
        <joint type="hinge" axis="0 0 1"/><inertial pos="0 0 0" mass="{thing.mass}"
        diaginertia="{thing.inertia} {thing.inertia} {thing.inertia}"/><geom {thing.geom} mass="0"/></body>"""
    flag = "".join(f'<flag {name}="enable"/>' for name in flags)
    return f"""<mujoco><compiler angle="radian"/><option timestep="{h}" gravity="0 {-scene.gravity} 0"
    {attributes}>{flag}</option><default><geom friction="0.5 0.005 0.0001" {default}/></default>
    <worldbody>{scene.world}{bodies}</worldbody></mujoco>"""


def simulate(scene: Scenario, h: float, option: str) -> float:
    """The scenario's number under one set of options; inf where MuJoCo resets or is not finite."""
    mujoco: Any = import_mujoco()
    model = mujoco.MjModel.from_xml_string(model_xml(scene, h, option))
    data = mujoco.MjData(model)
    start = np.array([thing.state for thing in scene.things])
    data.qpos[:], data.qvel[:] = start[:, :3].ravel(), start[:, 3:].ravel()
    mujoco.mj_forward(model, data)
    _same_model(mujoco, model, data, scene)
    out = [start]
    for k in range(round(scene.duration / h)):
        mujoco.mj_step(model, data)
        now = np.concatenate([data.qpos.reshape(-1, 3), data.qvel.reshape(-1, 3)], 1)
        if not np.isfinite(now).all() or data.time < (k + 0.5) * h:
            return math.inf
        out.append(now)
    return scene.measure(np.array(out))


def _same_model(mujoco: Any, model: Any, data: Any, scene: Scenario) -> None:
    full, ends = np.zeros((model.nv, model.nv)), np.zeros(6)
    mujoco.mj_fullM(model, data, full)
    want = np.concatenate([[t.mass, t.mass, t.inertia] for t in scene.things])
    gap = mujoco.mj_geomDistance(model, data, 0, 1, 1e3, ends)
    if np.abs(np.diag(full) - want).max() > 1e-9 * want.max() or abs(gap - scene.gap) > 1e-6 * max(
        1.0, scene.gap
    ):
        raise RuntimeError(
            f"{scene.name}: MuJoCo's model differs: M {np.diag(full)}, distance {gap}, not {scene.gap}"
        )


def plane(slope: float = 0.0) -> str:
    """A ground that rises to the right by `slope` [rad]."""
    return f'<geom type="plane" size="0 0 1" zaxis="{-math.sin(slope)} {math.cos(slope)} 0"/>'


def box(mass: float, *state: float) -> Thing:
    """The battery's block of .4 m x .2 m."""
    x, y, angle, vx, vy, spin = state
    return Thing('type="box" size="0.2 0.1 0.2"', mass, mass / 60.0, (x, y, angle, vx, vy, spin))


def scenarios(h: float) -> list[Scenario]:
    """What is compared at step size h."""
    tilt, radius = 0.3, 0.05

    def toss_gain(s: Array) -> float:
        energy = 0.5 * (s[:, 0, 3] ** 2 + s[:, 0, 4] ** 2 + s[:, 0, 5] ** 2 / 60.0) + G * s[:, 0, 1]
        return float(max(energy.max() / energy[0] - 1.0, 0.0))

    def through(s: Array) -> float:
        return float(max(s[:, 0, 0].max() + 0.075, 0.0))

    out = [
        Scenario("block sticks", 1.0, (box(1.0, -0.1 * math.sin(tilt), 0.1 * math.cos(tilt), tilt, 0, 0, 0),),
                 plane(tilt), 10.0, lambda s: float(np.hypot(*(s[-1, 0, :2] - s[0, 0, :2]))), "m"),
        Scenario("block stops", 3.0, (box(1.0, 0, 0.1, 0, 3.0, 0, 0),), plane(), 2.0,
                 lambda s: abs(float(s[-1, 0, 0]) - 9.0 / G), "m"),
        Scenario("box toss", 8.0, (box(1.0, 0, 0.6, 0.2, 2.0, 0, 8.0),), plane(), 2.0, toss_gain, "",
                 gap=0.6 - 0.2 * math.sin(0.2) - 0.1 * math.cos(0.2)),
    ]  # fmt: skip
    for ratio in (1.0, 1e3, 1e6):
        pair = (box(1.0, 0, 0.1, 0, 0, 0, 0), box(ratio, 0, 0.3, 0, 0, 0, 0))
        out.append(Scenario("stack of 2", ratio, pair, plane(), 1.0,
                            lambda s: float(np.abs(s[-1, :, :2] - s[0, :, :2]).max()), "m"))  # fmt: skip
    ten = tuple(box(1.0, 0, 0.1 + 0.2 * i, 0, 0, 0, 0) for i in range(10))
    out.append(Scenario("stack of 10", 1.0, ten, plane(), 1.0,
                        lambda s: float(np.abs(s[-1, :, :2] - s[0, :, :2]).max()), "m"))  # fmt: skip
    for speed in (10.0, 100.0, 1000.0):
        gap = 0.37 * h * speed + 0.2
        ball = Thing(f'type="sphere" size="{radius}"', 1.0, 1.0, (-0.075 - gap, 0, 0, speed, 0, 0))
        wall = '<geom type="box" size="0.025 1 1"/>'
        out.append(Scenario("thin wall", speed, (ball,), wall, 40 * h, through, "m", gap=gap, gravity=0.0))
        ball = Thing(
            f'type="sphere" size="{radius}"', 1.0, 1.0, (0, radius + 0.37 * h * speed, 0, 0, -speed, 0)
        )
        out.append(Scenario("rebound", speed, (ball,), plane(), 40 * h, lambda s: float(s[:, 0, 4].max()),
                            "m/s", gap=0.37 * h * speed, gravity=0.0))  # fmt: skip
    return out


def compare(h: float, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row per scenario: the battery's own float64 numbers at this h in hard mode, MuJoCo's of every option.

    Numbers of hard mode are the euler integrator's, one for each friction model that the rows hold.
    """
    out = []
    for s in scenarios(h):
        line: dict[str, Any] = {"case": s.name, "variant": s.variant, "unit": s.unit}
        mine = [r for r in rows if (r["case"], r["variant"], r["h"]) == (s.name, s.variant, h)]
        mine = [
            r for r in mine if (r["residual"], r["integrator"], r["dtype"]) == ("hard", "euler", "float64")
        ]
        for row in mine:
            line[f"hard, {row['friction']}"] = row["value"] if row["status"] == "SOLVED" else math.nan
        out.append(line | {f"MuJoCo, {name}": simulate(s, h, name) for name in OPTIONS})
    return out
