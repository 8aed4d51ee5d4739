"""Signed distances of a contact pair on a grid of configurations (Fig. 2's data)."""

import numpy as np

import slcp_warp as slcp
from slcp_warp.results.simulated import Simulated

from ..support.records import Record, device_facts


def surface(sim: slcp.Simulator, ranges: tuple[tuple[float, float], ...], resolution: int) -> Record:
    """Gap of the first contact pair over the first three coordinates; the others stay as at the start.

    Args:
        ranges: (low, high) of every coordinate [rad, m].
        resolution: points per axis.
    """
    if resolution < 2:
        raise ValueError(f"--resolution is {resolution}; it must be at least 2")
    scene = sim.scene
    rows = [i for i, row in enumerate(scene.structure.rows) if row.kind == "contact"]
    if not rows or scene.nv < 3:
        raise ValueError(f"scene {scene.name!r} needs a contact pair and three coordinates for a surface")
    axes = [np.linspace(low, high, resolution) for low, high in ranges]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    x = np.tile(scene.x0, (grid[..., 0].size, 1))
    x[:, :3], x[:, scene.nv :] = grid.reshape(-1, 3), 0.0
    gap = sim.step(x).gap[:, rows[0]].reshape(grid.shape[:3])
    arrays = {f"axis{i}": axis for i, axis in enumerate(axes)}
    return Record("surface", arrays | {"gap": gap}, Simulated.of(sim), device_facts(sim))
