"""mujoco_warp on the same device in the same run: its step of the finger beside ours."""

from functools import partial

from slcp_warp.runs.origin import version

from ...peers.mujoco_warp import TIMED, MuJoCoWarp
from ...peers.peer import installed
from ..record import Found
from ..setting import SINGLE, Setting
from ..timing import seconds
from .rates import arrays

MOST = 2**17  # worlds of mujoco_warp


def run(setting: Setting, found: Found) -> None:
    """World steps a second of both over the number of worlds, from the same kind of states, at equal step."""
    setting.keep_memory()
    peers = installed([lambda: MuJoCoWarp(setting.device)], found.note)
    for peer in peers:
        sim = setting.finger(SINGLE, "hard")
        scene = sim.scene
        found.row("mujoco_warp", version=version("mujoco-warp"))
        starts = setting.workload(16).x0
        for worlds in [count for count in setting.sizes.worlds[::2] if count <= MOST]:
            peer.batch = worlds
            h = scene.step_size
            timed = peer.prepare(scene, starts, 4 * h, h, peer.settings(True)[0])
            middle, least = seconds(setting, timed.simulate)
            x, us = arrays(setting, sim, worlds)
            ours, best = seconds(setting, partial(sim.rollout, x, us))
            theirs, count = worlds * TIMED / middle, worlds * setting.sizes.steps
            found.row(f"{worlds} worlds", worlds=worlds, mujoco_warp_steps=theirs, rate=count / ours,
                      times_faster=count / ours / theirs, best_rate=count / best,
                      mujoco_warp_best=worlds * TIMED / least)  # fmt: skip
