"""The named scenes, each with a picture of its motion, on one sheet."""

from pathlib import Path

import numpy as np

import slcp_warp as slcp
from slcp_warp import StrategyError
from slcp_warp.results.pictures.drawing import Drawing, square, view
from slcp_warp.results.pictures.mechanism import Mechanism
from slcp_warp.scenes.shown import shown

from ..support.simulators import default_scaling
from .style import plt, save

GHOSTS = 4
COLUMNS = 6


def motion(scene: slcp.Scene, device: str | None = None) -> np.ndarray:
    """Coordinates (GHOSTS + 1, nv) at equal times of a scene's shown motion, the start first."""
    options = slcp.Options(scaling=default_scaling(scene))
    try:  # one set of kernels serves most scenes
        sim = slcp.Simulator(scene, options, device=device, strategy="generic")
    except StrategyError:
        sim = slcp.Simulator(scene, options, device=device)
    moving, x0 = shown(scene)
    steps = round(moving.seconds / scene.step_size)
    u = np.tile(moving.controls or (0.0,) * scene.nu, (1, steps, 1))
    states = sim.rollout(x0[None], u).states[0]
    return states[np.linspace(0, steps, GHOSTS + 1).round().astype(int), : scene.nv]


def sheet(motions: dict[str, tuple[slcp.Scene, np.ndarray]], path: Path) -> Path:
    """Draw the scenes: the last pose in full, the start and what lies between as ghosts."""
    rows = -(-len(motions) // COLUMNS)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=(2.1 * COLUMNS, 2.1 * rows), layout="constrained")
    for ax in axes.flat:
        ax.set_axis_off()
    for ax, (name, (scene, qs)) in zip(axes.flat, motions.items()):
        mechanism = Mechanism(scene, scene.default_parameters())
        for q in qs[:-1]:
            Drawing(ax, mechanism, q, ghost=True)
        Drawing(ax, mechanism, qs[-1])
        view(ax, square(mechanism.bounds(qs, margin=0.03)))
        ax.set_title(name, fontsize=9)
    return save(figure, path)
