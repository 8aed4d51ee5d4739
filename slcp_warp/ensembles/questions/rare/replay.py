"""A given world of a task, step by step."""

from typing import Any

import numpy as np

from ....inputs.times import nearest_steps
from ....measures.reductions import first_time
from ....options import Options
from ....parameters import Parameters
from ....results import Trajectory
from ....results.simulated import Simulated
from ....simulator import Simulator
from ....tasks.task import Task
from ...launch import Recorded
from ...tasks import case_of
from ...worlds import Worlds
from ...worlds.draws import Given


def replayed(task: Task, policy: Any, world: Worlds, options: Options) -> Trajectory:
    """The states of given worlds in every step, as the sweep's own kernels make them, in float64.

    Recorded in single precision of the distance from the start.
    """
    assert task.duration is not None
    given = world.numpy()
    h = task.scene.step_size if given.params is None else float(given.params[0, 0])
    sim = Simulator(task.scene, options, dtype="float64")
    steps = nearest_steps("Task.duration", task.duration, h)
    judged = [] if task.failure is None else [first_time(task.failure)]
    case = case_of(
        task, sim, policy, Given(sim, task, given, h), judged, h, worlds=len(given), duration=steps * h,
        record=Recorded(tuple(range(sim.nx)), h),
    )  # fmt: skip
    found = case.launch(0, len(given))
    states = given.x0[:, None] + found["records"].astype(float)
    parameters = sim.params
    if given.params is not None:
        layout = sim.params.layout
        own = {
            name: given.params[:, start : start + int(np.prod(shape, dtype=int))].reshape(len(given), *shape)
            for name, start, shape in layout.columns
        }
        parameters = Parameters(sim.scene).replace(**own)
    return Trajectory(states, found["status"], simulated=Simulated.of(sim, parameters))
