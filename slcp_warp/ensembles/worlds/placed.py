"""Where worlds begin: at their starts, and what goes with their numbers."""

from dataclasses import replace

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.device.tables import empty_table
from slcp_warp.kernels.ensembles.draws import make_follow_kernel

from ...simulator import Simulator
from ...tasks.disturbances import Disturbances
from ...tasks.disturbances.follow import columns
from .arrays import Worlds


def placed(sim: Simulator, disturbances: Disturbances, worlds: Worlds) -> Worlds:
    """Worlds on a simulator's device with starts that follow their parameters, `Disturbances.follow`."""
    if not disturbances.follow or worlds.params is None:
        return worlds
    found = columns(sim.scene, disturbances.follow)
    base = sim.params.table()[0]
    by = np.array([each[:2] for each in found], np.int32)
    numbers = np.array([[factor, base[column]] for _, column, factor in found])
    out = empty_table(worlds.x0.shape, sim.dtype, sim.device)
    inputs = [
        wp.array(by, dtype=wp.int32, device=sim.device),
        wp.array(numbers, dtype=sim.dtype, device=sim.device),
        *(worlds.params, worlds.x0, out),
    ]
    launch(make_follow_kernel(sim.dtype), len(worlds), inputs, sim.device)
    return replace(worlds, x0=out)
