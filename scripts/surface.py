"""`slcp surface`: signed distances of the contact pairs on a grid of configurations (Fig. 2's data)."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp.simulated import Simulated

from .support.common import (
    Device,
    SceneName,
    make_simulator,
    named_scene,
    numbers,
    one_line_errors,
    prepared,
    wrote,
)
from .support.records import Record, device_facts

FINGER_RANGE = ((-np.pi, 0.0), (-2.0 * np.pi / 3.0, 2.0 * np.pi / 3.0), (0.0, np.pi))


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


@one_line_errors
def surface_command(
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("surface.npz"),
    scene: SceneName = "flicking_finger",
    resolution: Annotated[int, typer.Option(help="Points per coordinate.")] = 49,
    low: Annotated[str | None, typer.Option(help="Lower ends q1,q2,q3; default: the finger's.")] = None,
    high: Annotated[str | None, typer.Option(help="Upper ends q1,q2,q3.")] = None,
    device: Device = None,
) -> None:
    """Save the signed distance of a scene's first contact pair on a grid."""
    path = prepared(out)
    lower = numbers(low, "--low", 3) if low else np.array(FINGER_RANGE)[:, 0]
    upper = numbers(high, "--high", 3) if high else np.array(FINGER_RANGE)[:, 1]
    sim = make_simulator(named_scene(scene), device=device, dtype="float32")
    surface(sim, tuple(zip(lower, upper)), resolution).save(path)
    wrote(path)
