"""Stretches of MuJoCo's own rollouts in which every step touches: its distance is negative at their start."""

import numpy as np

from ..shared.ours import WINDOW
from ..shared.workload import Workload, windows
from .mujoco_model import Peer


def peer_windows(peer: Peer, work: Workload) -> tuple[Workload, float]:
    """MuJoCo's touching windows on the workload, and its share of touching steps."""
    states = np.concatenate([work.x0[:, None], peer.rollout(work)], axis=1)
    touching = peer.touching(states[:, :-1])
    return windows(states, work.controls, touching, WINDOW), float(touching.mean())
