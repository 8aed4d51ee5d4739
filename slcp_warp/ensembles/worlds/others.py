"""Given worlds that carry numbers of another design than the task's."""

import warnings

import numpy as np

from slcp_warp.kernels.structure import STEP_SIZE

from ...parameters import Parameters
from ...tasks.disturbances import laws
from ...tasks.task import Task
from .arrays import Worlds
from .corners import columns_of_corners, with_corners_within

SAME = 1e-5  # of a number: by so much single precision makes it another one
TOLD = 3  # numbers in a text


def warn_of_others(task: Task, worlds: Worlds, stacklevel: int) -> None:
    """Say which numbers all of the worlds (on the host) have in place of the task's scene's, where the task
    draws none there: of worlds that were drawn from another design.
    """
    structure, own = task.scene.structure, worlds.params
    base = with_corners_within(structure, Parameters(task.scene).table())[0]
    if own is None or not own.size or own.shape[1:] != base.shape:  # who takes them will say so
        return
    drawn = laws.parameter_laws(task.scene, base, task.disturbances.parameters)
    varied = {STEP_SIZE, *drawn.varied.tolist()}
    varied |= {
        int(corner) for corner, *sides in columns_of_corners(structure) if not varied.isdisjoint(sides)
    }
    size = np.maximum(np.abs(own[0]), np.abs(base))
    other = (np.ptp(own, axis=0) == 0.0) & (np.abs(own[0] - base) > SAME * size)
    places = [int(place) for place in np.flatnonzero(other) if place not in varied]
    if not places:
        return
    told = [f"{drawn.names[i]} {own[0, i]:.6g} in place of {base[i]:.6g}" for i in places[:TOLD]]
    more = f" and {len(places) - TOLD} more" if len(places) > TOLD else ""
    warnings.warn(
        f"worlds: all have {', '.join(told)}{more}, which the task's scene has and nothing draws: worlds of "
        "another design keep its numbers; slcp.draw_worlds(task, ...) has this one's",
        RuntimeWarning,
        stacklevel=stacklevel,
    )
