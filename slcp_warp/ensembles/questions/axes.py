"""A number of a task that is given other values than what was drawn, by name, in worlds of a sweep."""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from ...description.columns import parameter_of
from ...inputs import checks, rules
from ...inputs.checks import shown
from ...inputs.errors import ArgumentError
from ...parameters import Parameters
from ...tasks.disturbances import LogNormal, Normal, Uniform, laws
from ...tasks.task import Task
from ..worlds import Worlds
from ..worlds.corners import columns_of_corners

KICKS = "kicks"
ITSELF = "="  # behind a name whose values are its own
Axis = tuple[str, np.ndarray]  # a name and its values


def set_twice(task: Task, x: str, y: str) -> bool:
    """Whether the values of both names are those of a number itself, of the same one."""
    names = [name.removesuffix(ITSELF) for name in (x, y) if name.endswith(ITSELF)]
    names = [name for name in names if name not in task.scene.state_names]
    if len(names) < 2:
        return False
    one, other = (_columns(task, name) for name in names)
    return bool(np.intersect1d(one, other).size)


def changed(task: Task, worlds: Worlds, name: str, values: np.ndarray) -> Worlds:
    """The worlds with one number changed, by (B,) values: factors, what is added to a start or a place, or
    its own.
    """
    itself, name = name.endswith(ITSELF), name.removesuffix(ITSELF)
    if name in task.scene.state_names:
        if itself and name in task.disturbances.follow:
            by = ", ".join(task.disturbances.follow[name])
            raise ArgumentError(
                f"{name + ITSELF!r} would be the start itself, which follows {by} (Disturbances.follow); "
                f"{name!r}, which is added to it, is needed"
            )
        x0, place = np.array(worlds.x0), task.scene.state_index(name)
        x0[:, place] = values if itself else x0[:, place] + values
        return replace(worlds, x0=x0)
    if name == KICKS:
        return replace(worlds, kicks=np.asarray(worlds.kicks) * values[:, None, None])
    params, columns = np.array(worlds.params), _columns(task, name)
    if itself:
        params[:, columns] = values[:, None]
    elif _added(name):
        params[:, columns] += values[:, None]
    else:
        params[:, columns] *= values[:, None]
    return replace(worlds, params=params)


def _added(name: str) -> bool:
    """Whether values are added to a parameter, which may be of either sign."""
    return parameter_of(name)[1] in laws.SIGNED


def meant(name: str) -> str:
    """What the values of an axis are of: its own, factors on what was drawn, or added to it."""
    if name.endswith(ITSELF):
        return name.removesuffix(ITSELF)
    known = parameter_of(name)[1] in laws.NAMES or name == KICKS
    return f"factor on {name}" if known and not _added(name) else f"added to {name}"


def _any_law(name: str) -> LogNormal | Normal | Uniform:
    if parameter_of(name)[1] in laws.SHARES:
        return Uniform(0.0, 1.0)
    return Normal(0.1) if _added(name) else LogNormal(0.1)


def _columns(task: Task, name: str) -> np.ndarray:
    """Columns of a parameter in the table, named as in `Disturbances.parameters`."""
    base = Parameters(task.scene).table()[0]
    return laws.parameter_laws(task.scene, base, {name: _any_law(name)}).varied


def checked_axis(label: str, task: Task, given: Any, own: Collection[str] = ()) -> Axis:
    """A checked name with its values; those in `own` are of a policy, whose values are its own."""
    if not isinstance(given, list | tuple) or len(given) != 2 or not isinstance(given[0], str):
        raise ArgumentError(f"{label} is {shown(given)}; (name, values) is needed")
    name, values = given[0], np.atleast_1d(checks.array(f"the values of {label}", given[1]))
    if values.ndim != 1 or not len(values):
        raise ArgumentError(f"the values of {label} have shape {values.shape}; at least one is needed")
    if len(np.unique(values)) < len(values):
        raise ArgumentError(f"the values of {label} are {shown(given[1])}; each of them once is needed")
    if name in own:
        return f"{name}{ITSELF}", values
    itself, whole, name = name.endswith(ITSELF), name, name.removesuffix(ITSELF)
    if name in task.scene.state_names:
        return whole, values
    if name == KICKS:
        if itself:
            raise ArgumentError(f"{label} is {whole!r}; kicks have factors alone")
        if not task.disturbances.kick_times:
            raise ArgumentError(f"{label} is 'kicks', but task {task.name!r} has none")
    else:
        try:
            laws.check_parameter(name, _any_law(name))
            _columns(task, name)
        except ArgumentError as error:
            states = ", ".join(task.scene.state_names)
            raise ArgumentError(f"{label} is {name!r}; a state ({states}) or a parameter: {error}") from None
    factors = not itself and not _added(name)
    if factors and ((values < 0.0).any() or (name != KICKS and (values == 0.0).any())):
        raise ArgumentError(f"the values of {label} hold {values.min():g}; {name!r} takes positive factors")
    if itself:
        rules.check(f"the values of {label}", values, ArgumentError, parameter_of(name)[1])
    if parameter_of(name)[1] == "corner_radius":
        _check_corners(label, task, whole, values)
    return whole, values


def _check_corners(label: str, task: Task, name: str, values: np.ndarray) -> None:
    """Raise an error for corner radii that the task's rectangles, as they are, cannot have."""
    table = np.repeat(Parameters(task.scene).table()[:1], len(values), 0)
    table = np.asarray(
        changed(task, Worlds(np.repeat(task.start[:1], len(values), 0), table), name, values).params
    )
    for corner, width, height in columns_of_corners(task.scene.structure):
        sides = table[:, [width, height]]
        rules.check_corners(
            f"the corner radius by {label}", "rectangle", sides, table[:, corner], ArgumentError
        )
