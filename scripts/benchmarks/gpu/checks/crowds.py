"""World steps a second of scenes of many contacts, in generic kernels, over worlds, beside mujoco_warp."""

import time
from functools import partial
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp

from ...contacts.cost import LAWS
from ...contacts.worlds import MOTIONS, World, world
from ...peers.mujoco_warp import TIMED, MuJoCoWarp
from ...peers.peer import installed
from ..record import Found
from ..setting import SINGLE, Setting
from ..timing import seconds

SCENES = ("stack:3", "stack:10", "heap:10", "walker", "stack:30")
MOST = 2**17  # worlds
PATIENCE = 100.0  # seconds after which nothing more is begun
LONG = 4.0  # seconds of a call beyond which no more worlds are tried
STEPS = 20


def run(setting: Setting, found: Found) -> None:
    """At rest and tumbling, under each law, in single precision."""
    setting.keep_memory()
    begin = time.monotonic()
    peers = installed([lambda: MuJoCoWarp(setting.device)], found.note) if setting.gpu else []
    counts = [count for count in setting.sizes.worlds[::2] if count <= MOST]
    for name in SCENES if setting.gpu else SCENES[:1]:
        of = world(name)
        for motion in MOTIONS:
            for law in LAWS:
                if time.monotonic() - begin > PATIENCE:
                    found.note(f"no time for {name}, {motion}, {law}")
                    continue
                _ours(setting, found, of, motion, law, counts)
            for peer in peers if time.monotonic() - begin < PATIENCE else ():
                _theirs(setting, found, peer, of, motion, counts[-2:-1])


def _ours(setting: Setting, found: Found, of: World, motion: str, law: str, counts: list[int]) -> None:
    options = slcp.Options(**LAWS[law])
    sim = slcp.Simulator(of.scene, options, device=setting.device, dtype=SINGLE, strategy="generic")
    for count in counts:
        x = of.starts(motion, count, setting.seed)
        kind: Any = {"dtype": sim.dtype, "device": setting.device}
        start: Any = wp.array(x, **kind)
        us: Any = wp.zeros((count, STEPS, sim.nu), **kind)
        middle, least = seconds(setting, partial(sim.rollout, start, us), 3)
        status = sim.rollout(start, us).status.numpy()
        found.row(f"{of.name}, {motion}, {law}, {count} worlds", scene=of.name, motion=motion, law=law,
                  worlds=count, rate=count * STEPS / middle, best_rate=count * STEPS / least,
                  unsolved=np.mean(status != slcp.Status.SOLVED))  # fmt: skip
        if middle > LONG:
            break


def _theirs(setting: Setting, found: Found, peer: Any, of: World, motion: str, counts: list[int]) -> None:
    h = of.scene.step_size
    for count in counts:
        peer.batch = count
        case = f"mujoco_warp: {of.name}, {motion}, {count} worlds"
        try:
            timed = peer.prepare(of.scene, of.starts(motion, 16, setting.seed), 4 * h, h, "default")
            middle, _ = seconds(setting, timed.simulate, 3)
        except Exception as error:
            found.row(case, error=f"{type(error).__name__}: {error}"[:500])
            return
        found.row(case, scene=of.name, motion=motion, worlds=count, mujoco_warp_steps=count * TIMED / middle)
