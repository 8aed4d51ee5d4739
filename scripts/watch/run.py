"""A trajectory's file as the page shows it: as of `slcp simulate`, `slcp falsify` or `slcp.replay`."""

from pathlib import Path

import numpy as np

import slcp_warp as slcp
from slcp_warp.results.simulated import Simulated

from .world import VARIANTS

MOST_WORLDS = 64
PLACES = (
    "step_size",
    "radius",
    "corner_radius",
    "shape_offset",
    "shape_angle",
    "anchor",
    "angle",
)  # parameters


class Run:
    """Worlds of a trajectory, with what a `Replay` has; a world that failed stands still from there on.

    Args:
        path: of the file.

    Raises:
        FileError: no trajectory, or a damaged one.
        ValueError: of more worlds than the page shows, of worlds of other sizes or step sizes, or of
            checkpoints alone.
    """

    knobs: tuple[str, ...] = ()

    def __init__(self, path: Path) -> None:
        run = slcp.Trajectory.load(path)
        states, status = np.array(run.recorded("states")), run.recorded("status")
        if len(states) > MOST_WORLDS:
            raise ValueError(
                f"--replay is a run of {len(states)} worlds; at most {MOST_WORLDS} are shown: save some of "
                "them, trajectory[:64]"
            )
        if run.kept is not None or states.shape[1] < 2:
            raise ValueError("--replay is a run without the states of every step, which are needed")
        self.parameters = _of_all(run)
        scene, steps = run.scene, states.shape[1] - 1
        self.subject, self.simulated = path.stem, Simulated(scene, run.options, self.parameters)
        self.variants = (VARIANTS[1] if run.options.hard else VARIANTS[0],)
        last = _last_finite(states, status)
        for i, k in enumerate(last):
            states[i, k:] = states[i, k]
        controls = (
            np.zeros((len(states), steps, scene.nu)) if run.controls is None else run.recorded("controls")
        )
        failed = np.arange(steps)[None] >= last[:, None]
        self.arrays = {
            "states": states.swapaxes(0, 1),
            "controls": np.nan_to_num(controls).swapaxes(0, 1),
            "forces": np.zeros((steps, len(states), scene.structure.nb, 3)),
            "values": np.zeros((steps, 0)),
            "variant": np.zeros(steps, int),
            "status": np.where(failed, status[:, None], slcp.Status.SOLVED).T,
        }

    def task(self) -> tuple[str, slcp.Scene, slcp.Options]:
        """Name, scene and options of what is shown."""
        return self.subject, self.simulated.scene, self.simulated.options


def _of_all(run: slcp.Trajectory) -> slcp.Parameters:
    """Parameters of the first world, as far as a picture shows them those of all."""
    plain = run.scene.default_parameters()
    for name in (each for each in PLACES if each in plain):
        values = np.asarray(run.params[name])
        if values.ndim > np.ndim(plain[name]) and np.ptp(values, axis=0).any():
            raise ValueError(
                f"--replay is a run of worlds that differ in {name}; one is shown at a time: save "
                "trajectory[i:i + 1]"
            )
    return run[0].params if run.batched else run.params


def _last_finite(states: np.ndarray, status: np.ndarray) -> np.ndarray:
    """(B,) the last step that a world came to: of one that failed the last with another state."""
    finite = np.isfinite(states).all(axis=2)
    last = np.where(finite.all(axis=1), states.shape[1] - 1, finite.argmin(axis=1) - 1)
    for i in np.flatnonzero(status != slcp.Status.SOLVED):
        moved = (states[i, 1 : last[i] + 1] != states[i, : last[i]]).any(axis=1)
        last[i] = np.flatnonzero(moved)[-1] + 1 if moved.any() else 0
    return last
