"""What a failing disturbance is looked for among: a task's own kinds of disturbance, alone or all of them."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from slcp_warp.kernels.structure import WALLS

from ....inputs.checks import choice, number, shown
from ....inputs.errors import ArgumentError, ArgumentTypeError
from ....tasks.disturbances import Disturbances, Normal, Push, Uniform
from ....tasks.task import Task

KINDS = ("kick", "push", "start", "parameters", "all")
PUSHED = 0.1  # [s], where nothing says for how long
GRAVITY = 9.81  # [m/s^2]: forces are in weights of what is pushed


def without_noise(disturbances: Disturbances) -> Disturbances:
    """The same without what is drawn in single steps."""
    return replace(disturbances, torque=0.0, sensor=0.0, dropped=0.0)


def kinds_of(disturbances: Disturbances) -> tuple[str, ...]:
    """The names of what is disturbed, of `KINDS` or in words."""
    d = disturbances
    drawn = {
        "kick": d.kick_times, "push": d.pushes, "start": d.position or d.velocity or d.start,
        "parameters": d.parameters, "dropouts": d.dropouts,
        "noise of single steps": d.torque or d.sensor or d.dropped,
    }  # fmt: skip
    return tuple(name for name, given in drawn.items() if given)


def searched(
    task: Task, by: Any, time: float | None, body: str | None, duration: float | None, point: Any = None
) -> Disturbances:
    """Disturbances of the kind `by`, or those that are given, with standard deviations as units of size.

    Args:
        task: whose own standard deviations are taken where it has some.
        by: one of `KINDS`, or `Disturbances` of the caller's own.
        time: of a kick or a push [s]; None: the task's first, or 0.
        body: that is pushed; None: the task's first, or the scene's last.
        duration: of a push [s]; None: of the task's first, or 0.1.
        point: of a push, in the body's frame [m]; None: the task's first, if it is on this body, or the end
            of the body's first shape.

    Raises:
        ArgumentError: a kind that the task has nothing of, times after the end, or what this kind has no use
            for.
    """
    own = task.disturbances
    of_kind = by if isinstance(by, str) else "Disturbances"
    _has_use("time", time, of_kind, ("kick", "push"))
    for name, given in (("body", body), ("duration", duration), ("at", point)):
        _has_use(name, given, of_kind, ("push",))
    if isinstance(by, Disturbances):
        return without_noise(by if by.follow else replace(by, follow=own.follow))
    if not isinstance(by, str):
        raise ArgumentTypeError(f"by is {shown(by)}; slcp_warp.Disturbances or a name is needed")
    choice("by", by, KINDS)
    timing = [
        0.5 * (span.low + span.high) if isinstance(span, Uniform) else span for span in (own.delay, own.hold)
    ]
    delay, hold = (span if span >= 0.5 * task.scene.step_size else 0.0 for span in timing)
    # drawn times at their mean, what rounds to no step none
    alone = Disturbances(delay=delay, hold=hold, follow=own.follow)
    assert task.duration is not None
    if time is not None:
        time = number("time", time, 0.0)
        if time >= task.duration:
            raise ArgumentError(f"time is {time} s; a run of task {task.name!r} ends after {task.duration} s")
    if by == "kick":
        at = time if time is not None else min(own.kick_times, default=0.0)
        return replace(alone, kick_times=(at,), kicks=_kicks(task))
    if by == "push":
        return replace(alone, pushes=(_push(task, time, body, duration, point),))
    if by == "start":
        found = replace(alone, position=own.position, velocity=own.velocity, start=own.start)
        drawn = bool(np.any(found.deviation(task.scene) > 0.0))
    elif by == "parameters":
        found = replace(alone, parameters=own.parameters)
        drawn = bool(own.parameters)
    else:
        found = without_noise(own)
        drawn = replace(found, delay=0.0, hold=0.0).any()
    if not drawn:
        raise ArgumentError(
            f"by is {by!r}; task {task.name!r} disturbs nothing of this kind: give Disturbances"
        )
    return found


def _has_use(name: str, given: Any, by: str, kinds: tuple[str, ...]) -> None:
    """Raise ArgumentError for what is given and would do nothing, as disturbances of other kinds use it."""
    if given is not None and by in (*KINDS, "Disturbances") and by not in kinds:
        raise ArgumentError(f"{name} is {shown(given)}, and by is {by!r}; it is for {' and '.join(kinds)}")


def _kicks(task: Task) -> dict[str, Any]:
    """Of every velocity: as the task kicks it, or as its starts spread; where not, the widest of its unit, or
    1.
    """
    own, scene = task.disturbances, task.scene
    names = scene.state_names[scene.nv :]
    if own.kick_times and (own.kick > 0.0 or own.kicks):
        return {name: own.kicks.get(name, Normal(own.kick)) for name in names}
    spread = own.deviation(scene)[scene.nv :]
    units = np.array(scene.state_units[scene.nv :])
    widest = {unit: spread[units == unit].max() or 1.0 for unit in units}
    spread = np.where(spread > 0.0, spread, [widest[unit] for unit in units])
    return {name: Normal(float(sd)) for name, sd in zip(names, spread)}


def _push(task: Task, time: float | None, body: str | None, duration: float | None, at: Any) -> Push:
    """The task's first push with what is given of another, or a force in any direction, in weights of the
    body that it pushes.
    """
    first, names = next(iter(task.disturbances.pushes), None), [each.name for each in task.scene.bodies]
    name = names[-1] if first is None else first.body
    name = name if body is None else choice("body", body, names)
    push = first
    if push is None or push.body != name:
        sd = float(next(each.mass for each in task.scene.bodies if each.name == name)) * GRAVITY
        start, lasts = (0.0, PUSHED) if first is None else (first.start, first.duration)
        push = Push(name, start, lasts, force=(Normal(sd), Normal(sd)), at=_end(task, name))
    if duration is not None:
        push = replace(push, duration=number("duration", duration, 0.0, above=True))
    push = push if time is None else replace(push, start=time)
    return push if at is None else replace(push, at=at)


def _end(task: Task, body: str) -> tuple[float, float] | None:
    """The end of a body's first shape along its first axis, where a hand would take it."""
    for shape in task.scene.shapes:
        if shape.body == body and shape.kind not in WALLS:
            radii = np.ravel(shape.radius)
            reach = float(radii.sum()) if shape.kind == "capsule" else float(radii[0])
            x, y = shape.offset
            return x + reach * math.cos(shape.angle), y + reach * math.sin(shape.angle)
    return None
