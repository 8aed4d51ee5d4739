"""The named scenes, each with a picture of its motion, on one sheet."""

from pathlib import Path

import numpy as np

import slcp_warp as slcp
from slcp_warp import StrategyError
from slcp_warp.results.pictures.drawing import Drawing, view
from slcp_warp.results.pictures.mechanism import Mechanism

from ..support.simulators import default_scaling
from .style import plt, save

GHOSTS = 4
COLUMNS = 6
SECONDS = {  # shown; 1 where a scene is not named
    "flicking_finger": 1.5, "ball_drop": 0.45, "sliding_block": 0.35, "particle": 0.5, "grasp": 0.6,
    "pendulum_chain": 0.5, "stack": 0.5, "painleve_rod": 0.6, "two_balls": 1.2, "box_toss": 1.2,
    "rolling_disc": 0.5, "beam": 0.3, "opposing_limits": 0.3, "hopper": 0.9, "walker": 0.6,
    "cart_pole": 0.85, "push_block": 0.4,
}  # fmt: skip
CONTROLS = {"grasp": (20.0, -20.0)}  # constant; zero where a scene is not named
RATES = {"sliding_block": {3: 1.5}, "particle": {3: 1.0, 4: 2.0}}  # initial, by state component


def motion(scene: slcp.Scene, device: str | None = None) -> np.ndarray:
    """Coordinates (GHOSTS + 1, nv) at equal times of a scene's shown motion, the start first."""
    options = slcp.Options(scaling=default_scaling(scene))
    try:  # one set of kernels serves most scenes
        sim = slcp.Simulator(scene, options, device=device, strategy="generic")
    except StrategyError:
        sim = slcp.Simulator(scene, options, device=device)
    x0 = scene.x0
    for component, rate in RATES.get(scene.name, {}).items():
        x0[component] = rate
    steps = round(SECONDS.get(scene.name, 1.0) / scene.step_size)
    u = np.tile(CONTROLS.get(scene.name, (0.0,) * scene.nu), (1, steps, 1))
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
        view(ax, square(mechanism.bounds(qs, margin=0.06)))
        ax.set_title(name, fontsize=9)
    return save(figure, path)


def square(bounds: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """The window widened to a square around its middle."""
    left, right, bottom, top = bounds
    half = max(right - left, top - bottom) / 2.0
    x, y = (left + right) / 2.0, (bottom + top) / 2.0
    return x - half, x + half, y - half, y + half
