"""One given world as a task of its own: a start, and disturbances that are numbers and no distributions."""

from dataclasses import replace

import numpy as np

from ....description.columns import parameter_of
from ....parameters import Parameters
from ....tasks.disturbances import Disturbances, Dropout, LogNormal, Normal, Push, Uniform, laws
from ....tasks.task import Task
from ...worlds import Worlds
from .numbers import Numbers


def scenario_of(task: Task, numbers: Numbers, world: Worlds) -> Task | None:
    """The task whose only disturbed world is the first of `world`.

    None where a task cannot say it: kicks at several times that differ.
    """
    given, own = world.numpy(), task.disturbances
    found = Disturbances(delay=own.delay, hold=own.hold, before=own.before)
    if given.timing is not None:
        delay, hold = map(float, given.timing[0, 0])
        least = 0.5 * task.scene.step_size  # what rounds to no step is none
        delay *= delay >= least
        found = Disturbances(delay=delay, hold=hold * (hold >= least), before=own.before if delay else None)
    found = replace(found, follow=own.follow)
    if given.kicks is not None:
        kicks = given.kicks[0]
        if len(kicks) > 1 and np.ptp(kicks, axis=0).any():
            return None
        names = task.scene.state_names[task.scene.nv :]
        mean = {name: Normal(0.0, mean=float(value)) for name, value in zip(names, kicks[0])}
        found = replace(found, kick_times=own.kick_times, kicks=mean)
    if given.pushes is not None:
        pushes = [_push(push, row) for push, row in zip(own.pushes, given.pushes[0]) if _acts(task, row)]
        found = replace(found, pushes=tuple(pushes))
    if given.dropouts is not None:
        dropouts = tuple(Dropout(*map(float, row)) for row in given.dropouts[0] if _acts(task, row))
        found = replace(found, dropouts=dropouts)
    parameters = _parameters(task, numbers, given.params[0])
    if parameters is None:
        return None
    return task.replace(
        name=f"{task.name}_falsified", start=given.x0[:1], disturbances=replace(found, parameters=parameters)
    )


def _parameters(task: Task, numbers: Numbers, row: np.ndarray) -> dict[str, LogNormal | Uniform] | None:
    """What the parameters of a world (P,) are, by name, where the task's disturbances name them."""
    out: dict[str, LogNormal | Uniform] = {}
    origin = Parameters(task.scene).table()[0].astype(float)
    for c in np.flatnonzero(numbers.tables["params"].law):
        key = laws.key_of(task.scene, int(c))
        name, value, base = parameter_of(key)[1], float(row[c]), float(origin[c])
        if name in laws.FACTORS and base == value == 0.0:
            continue
        own = (*laws.SIGNED, *laws.SHARES)  # numbers, not factors
        factor = base != 0.0 if name in laws.FACTORS else name not in own and base > 0.0
        before = out.get(key)
        out[key] = LogNormal(0.0, median=value / base) if factor else Uniform(value, value)
        if before is not None and not np.isclose(_number(before), _number(out[key]), rtol=1e-9, atol=0.0):
            return None
    return out


def _number(drawn: LogNormal | Uniform) -> float:
    return drawn.median if isinstance(drawn, LogNormal) else drawn.low


def _acts(task: Task, row: np.ndarray) -> bool:
    """Whether a push or a dropout (start, duration, ..) lies in a run of the task, if in part."""
    assert task.duration is not None
    start, duration = map(float, row[:2])
    return duration > 0.0 and 0.0 < start + duration and start < task.duration


def _push(push: Push, row: np.ndarray) -> Push:
    start, duration, fx, fy, torque = map(float, row)
    return Push(push.body, start, duration, (fx, fy), torque, push.at)
