"""One given world as a task of its own: a start, and disturbances that are numbers and no distributions."""

from dataclasses import replace

import numpy as np

from ....tasks.disturbances import Disturbances, Dropout, LogNormal, Normal, Push, Uniform, laws
from ....tasks.task import Task
from ...worlds import Worlds
from .numbers import Numbers


def scenario_of(task: Task, numbers: Numbers, world: Worlds) -> Task | None:
    """The task whose only disturbed world is the first of `world`.

    None where a task cannot say it: kicks at several times that differ.
    """
    given, own = world.numpy(), task.disturbances
    found = Disturbances(delay=own.delay, hold=own.hold)
    if given.timing is not None:
        delay, hold = map(float, given.timing[0, 0])
        least = 0.5 * task.scene.step_size  # what rounds to no step is none
        found = Disturbances(delay=delay * (delay >= least), hold=hold * (hold >= least))
    if given.kicks is not None:
        kicks = given.kicks[0]
        if len(kicks) > 1 and np.ptp(kicks, axis=0).any():
            return None
        names = task.scene.state_names[task.scene.nv :]
        mean = {name: Normal(0.0, mean=float(value)) for name, value in zip(names, kicks[0])}
        found = replace(found, kick_times=own.kick_times, kicks=mean)
    if given.pushes is not None:
        pushes = [_push(push, row) for push, row in zip(own.pushes, given.pushes[0])]
        found = replace(found, pushes=tuple(pushes))
    if given.dropouts is not None:
        found = replace(found, dropouts=tuple(Dropout(*map(float, row)) for row in given.dropouts[0]))
    parameters: dict[str, LogNormal | Uniform] = {}
    table = numbers.tables["params"]
    for c in table.varied:
        key = laws.key_of(task.scene, int(c))
        value, base = float(given.params[0, c]), float(table.base[c])
        name = laws.parameter_of(key)[1]
        factor = name in laws.FACTORS or (name not in laws.SIGNED and base > 0.0)
        parameters[key] = LogNormal(0.0, median=value / base) if factor else Uniform(value, value)
    return task.replace(
        name=f"{task.name}_falsified", start=given.x0[:1], disturbances=replace(found, parameters=parameters)
    )


def _push(push: Push, row: np.ndarray) -> Push:
    start, duration, fx, fy, torque = map(float, row)
    return Push(push.body, start, duration, (fx, fy), torque, push.at)
