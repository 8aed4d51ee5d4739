"""Tasks in files: TOML or JSON, `format = "slcp-task"`, `version = 1`, or a name in a Python file."""

import dataclasses
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.kernels.control.cost_terms import FIELDS, KINDS

from ..costs import NO_COST, Cost, Point, Term, terms
from ..costs.terms import ALWAYS, SUMS, numbers_of_term
from ..description.points import AXES
from ..description.scene import Scene
from ..description.scene_file import load_scene, scene_content, scene_of
from ..description.scene_schema import FORMAT as SCENE
from ..description.scene_schema import NO_VALUE, file_fields
from ..inputs import checks
from ..inputs.checks import shown
from ..inputs.errors import InputError
from ..options import Options
from ..scenes import NAMED as SCENES
from ..storage.files import MOST_TEXT, MOST_TOML, parse_json, parse_toml, read_text, reading, write_text
from ..storage.python import python_name
from ..storage.tables import entries, place, table
from .disturbances.notation import disturbances_content, disturbances_of
from .notation import (
    condition_content,
    condition_of,
    measure_content,
    measure_of,
    success_content,
    success_of,
)
from .registry import NAMED
from .task import Task, TaskError

FORMAT, VERSION = "slcp-task", 2
SCENE_VERSION = {1: 2, 2: 3}  # of scenes inside, by the version of a task file: all that are read
TEXT = (".toml", ".json")
OF_SCENE = ("step_size", "sigma")  # numbers of the scene that a task file may change
FIELDS_OF_FILE = (
    *("$schema", "format", "version", "name", "scene", *OF_SCENE, "cost", "horizon", "duration", "options"),
    *("control_limits", "state_limits", "start", "disturbances", "measures", "success", "failure"),
    *("observation", "periods"),
)
NEEDED = ("name", "scene")


class TaskFileError(TaskError):
    """A file that is no task; the message names the file, the place in it, what came and what is needed."""


def load_task(name: str | os.PathLike[str]) -> Task:
    """A task by its name (`slcp_warp.tasks.NAMED`), from a .toml or .json file, or `file.py:name`.

    In a Python file the name is a `Task`, or a function that makes one; the file is run.

    Raises:
        TaskFileError: no task: too large, another version, a field that is unknown, missing, twice or of a
            wrong type, names that the scene has not got; the message names the place.
        FileNotFoundError: no such file.
    """
    if isinstance(name, str) and name in NAMED:
        return NAMED[name]()
    path = checks.path("name", name)
    file, colon, attribute = str(path).rpartition(":")
    if colon and file.endswith(".py"):
        return _from_python(Path(file), attribute)
    if path.suffix not in TEXT:
        raise TaskFileError(
            f"{shown(str(path))} is no task; a .toml or .json file, file.py:name or one of "
            f"{', '.join(NAMED)} is needed"
        )
    with reading(path, "a task", TaskFileError):
        return task_of(_parse(path), path.parent)


def task_of(content: Any, folder: Path | None = None) -> Task:
    """The task of a task file's content; `folder`: where its scene's file is.

    Raises:
        TaskFileError: as `load_task`, without a file's name.
    """
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = (
            f"{content.get('format')!r:.60}" if isinstance(content, dict) else f"a {type(content).__name__}"
        )
        scene = isinstance(content, dict) and content.get("format") == SCENE
        hint = "; a scene alone is given by --scene, or by load_scene" if scene else ""
        raise TaskFileError(f"format is {found}; a task file has format = {FORMAT!r}{hint}")
    version = content.get("version")
    if isinstance(version, bool) or not isinstance(version, int) or version not in SCENE_VERSION:
        reads = ", ".join(map(str, SCENE_VERSION))
        raise TaskFileError(f"version is {version!r:.60}; this program reads {reads}")
    values = table("", content, FIELDS_OF_FILE, NEEDED, TaskFileError)
    scene = _scene(values, folder)
    fields: dict[str, Any] = {
        name: values[name] for name in ("name", "horizon", "duration") if name in values
    }
    fields |= {"scene": scene}
    if "cost" in values:
        fields["cost"] = _cost(values["cost"], scene)
    if "options" in values:
        fields["options"] = _build(Options, values["options"], "options")
    if "disturbances" in values:
        given = values["disturbances"]
        fields["disturbances"] = _said("disturbances", disturbances_of, given, "disturbances")
    if "control_limits" in values:
        fields["control_limits"] = _limits(values["control_limits"], "control_limits")
    if "state_limits" in values:
        given = table("state_limits", values["state_limits"], values["state_limits"], (), TaskFileError)
        fields["state_limits"] = {key: _limits(each, f"state_limits, {key}") for key, each in given.items()}
    if "start" in values:
        fields["start"] = values["start"]
    given = table("measures", values.get("measures", {}), values.get("measures", {}), (), TaskFileError)
    measures = {
        key: _said(f"measures, {key}", measure_of, each, f"measures, {key}") for key, each in given.items()
    }
    fields["measures"] = measures
    if "success" in values:
        fields["success"] = _said("success", success_of, values["success"], measures, "success")
    if "failure" in values:
        fields["failure"] = _said("failure", condition_of, values["failure"], "failure")
    fields |= {name: values[name] for name in ("observation", "periods") if name in values}
    task: Task = _said("", lambda: Task(**fields))
    return task


def task_content(task: Task) -> dict[str, Any]:
    """What a task's file holds, as JSON values.

    Raises:
        TaskFileError: a cost or a measure that is no data.
    """
    checks.instance("task", task, Task, "a slcp_warp.Task")
    content: dict[str, Any] = {"format": FORMAT, "version": VERSION, "name": task.name}
    scene = scene_content(task.scene)
    content["scene"] = {key: value for key, value in scene.items() if key not in ("format", "version")}
    content["duration"] = task.duration
    if task.horizon is not None:
        content["horizon"] = task.horizon
    if task.cost is not NO_COST:
        content["cost"] = _cost_content(task.cost, task.scene)
    for name, changed in (
        ("options", _changed(task.options, Options())),
        ("disturbances", disturbances_content(task.disturbances)),
    ):
        if changed:
            content[name] = changed
    if task.control_limits is not None:
        content["control_limits"] = [_with_none(limit) for limit in task.control_limits]
    if task.state_limits:
        content["state_limits"] = {
            name: [_with_none(limit) for limit in pair] for name, pair in task.state_limits.items()
        }
    content["start"] = task.start.tolist()
    content["measures"] = {
        key: _said(f"measures, {key}", measure_content, each) for key, each in task.measures.items()
    }
    if task.success is not None:
        content["success"] = _said("success", success_content, task.success, task.measures)
    if task.failure is not None:
        content["failure"] = _said("failure", condition_content, task.failure)
    if task.observation is not None:
        if not isinstance(task.observation, tuple):
            raise TaskFileError("observation: a function is no data; write the task in Python")
        content["observation"] = list(task.observation)
    if task.periods:
        content["periods"] = dict(task.periods)
    return content


def save_task(task: Task, path: str | os.PathLike[str]) -> None:
    """Write a task to a .json file, its scene with it: reading it gives an equal task.

    The file appears whole or not at all.

    Raises:
        TaskFileError: a cost that is no sum of terms, or a measure of a function, which are no data.
    """
    path = checks.path("path", path)
    if path.suffix != ".json":
        raise TaskFileError(
            f"{path}: tasks are written as .json, not as {path.suffix or 'a file without ending'}"
        )
    write_text(path, json.dumps(task_content(task), indent=2, allow_nan=False) + "\n")


def says_task(path: Path) -> bool:
    """Whether a .toml or .json file says that it is a task."""
    try:
        content = _parse(path)
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("format") == FORMAT


def _parse(path: Path) -> Any:
    text = read_text(path, MOST_TEXT if path.suffix == ".json" else MOST_TOML)
    try:
        return parse_json(text) if path.suffix == ".json" else parse_toml(text)
    except ValueError as error:  # what both parsers raise
        raise TaskFileError(f"not readable as {path.suffix[1:].upper()}: {error}") from error


def _from_python(path: Path, attribute: str) -> Task:
    """A task of a Python file, which is run as a module of its own."""
    try:
        found, names = python_name(path, attribute)
        task = found() if callable(found) else found
    except FileNotFoundError:
        raise
    except Exception as error:
        raise TaskFileError(f"{path}:{attribute}: {type(error).__name__}: {error}") from error
    if not isinstance(task, Task):
        there = [key for key, value in names.items() if isinstance(value, Task)]
        hint = f"; tasks in it: {', '.join(there)}" if there else ""
        need = "a slcp_warp.Task, or a function that makes one,"
        raise TaskFileError(f"{path}: {attribute} is {shown(task)}; {need} is needed{hint}")
    return task


def _scene(values: dict[str, Any], folder: Path | None) -> Scene:
    given = values["scene"]
    if isinstance(given, dict):
        head = {"format": "slcp-scene", "version": SCENE_VERSION[values["version"]]}
        scene = _said("scene", scene_of, head | given)
    elif isinstance(given, str) and given in SCENES:
        scene = SCENES[given]()
    elif isinstance(given, str) and Path(given).suffix in (*TEXT, ".xml"):
        scene = _said("scene", load_scene, _beside(given, folder))
    else:
        need = f"a table, a .toml, .json or .xml file or one of {', '.join(SCENES)}"
        raise TaskFileError(f"scene: {given!r:.60}; {need} is needed")
    changes = {name: values[name] for name in OF_SCENE if name in values}
    changed: Scene = _said("", lambda: dataclasses.replace(scene, **changes)) if changes else scene
    return changed


def _beside(given: str, folder: Path | None) -> Path:
    """A scene's file in the folder of the task's file, or below it."""
    if Path(given).is_absolute() or ".." in Path(given).parts:
        raise TaskFileError(
            f"scene: {given!r:.60}; a file beside the task's, or in a folder there, is needed"
        )
    path = (Path() if folder is None else folder) / given
    if not path.is_file():
        raise TaskFileError(f"scene: no file {str(path)!r:.200}")
    return path


def _cost(values: Any, scene: Scene) -> Cost:
    groups = table("cost", values, ("running", "final"), (), TaskFileError)
    made = {}
    for name in ("running", "final"):
        listed = entries(f"cost, {name}", groups.get(name, []), TaskFileError)
        made[name] = [_term(each, f"cost, {name}[{i}]") for i, each in enumerate(listed)]
    cost: Cost = _said("cost", terms, scene, made["running"], made["final"])
    return cost


def _term(values: Any, where: str) -> Any:
    """A term; points that it is of are tables."""
    given = dict(values) if isinstance(values, dict) else values
    for name in ("point", "minus"):
        if isinstance(given, dict) and isinstance(given.get(name), dict):
            given[name] = _build(Point, given[name], f"{where}, {name}")
    return _build(Term, given, where)


def _cost_content(cost: Cost, scene: Scene) -> dict[str, Any]:
    """The terms of a cost, from its weights."""
    if cost.make not in SUMS or cost.weights.ndim > 1:
        raise TaskFileError("cost: no sum of costs.Term, which alone are data; write the task in Python")
    if cost.windows is not None and cost.windows.begun:
        raise TaskFileError(f"cost: it begins {cost.windows.begun:g} s after its plan does, which is no data")
    each = numbers_of_term(cost)
    count = int(cost.weights[-1]) if cost.points else (len(cost.weights) - 1) // each
    running = int(cost.weights[0])
    spans = [ALWAYS] * count if cost.windows is None else [*cost.windows.spans, *[ALWAYS] * (count - running)]
    found = []
    for row, (start, end) in zip(cost.weights[1 : 1 + each * count].reshape(-1, each), spans):
        kind, component, weight, target, width, minus = row[:FIELDS]
        of = _component(cost, scene, int(component), int(minus))
        term = Term(KINDS[int(kind)], weight, target=target, width=width, start=start, end=end, **of)
        own = _changed(term, Term(term.kind, 0.0, control=0)) | of
        points = {name: _changed(value, Point()) for name, value in of.items() if isinstance(value, Point)}
        found.append({"kind": term.kind, "weight": term.weight} | own | points)
    groups = {"running": found[:running], "final": found[running:]}
    return {name: group for name, group in groups.items() if group}


def _component(cost: Cost, scene: Scene, i: int, minus: int) -> dict[str, Any]:
    """What a term is of, by its fields."""
    nx, points = 2 * scene.nv, 2 * scene.nv + max(scene.nu, 1)
    if i >= points:
        point, axis = divmod(i - points, 2)
        of = {"point": cost.points[point], "axis": AXES[axis]}
        return of | ({} if minus < 0 else {"minus": cost.points[(minus - points) // 2]})
    of = {"control": scene.control_names[i - nx]} if i >= nx else {"state": scene.state_names[i]}
    return of | ({} if minus < 0 else {"minus": scene.state_names[minus]})


def _changed(item: Any, default: Any) -> dict[str, Any]:
    """Fields of an object that differ from another's, as plain values."""
    out = {}
    for field in dataclasses.fields(item):
        value = getattr(item, field.name)
        if value != getattr(default, field.name) and value is not None:
            out[field.name] = list(value) if isinstance(value, tuple) else value
    return out


def _limits(given: Any, where: str) -> Any:
    """(lower, upper) with infinite ones where the file has no value."""
    if not isinstance(given, list) or len(given) != 2:
        raise TaskFileError(f"{where}: {given!r:.60}; [lower, upper] is needed")
    return tuple(_without_none(limit, sign * np.inf, where) for limit, sign in zip(given, (-1.0, 1.0)))


def _without_none(limit: Any, instead: float, where: str) -> Any:
    if isinstance(limit, list):
        return [_without_none(each, instead, where) for each in entries(where, limit, TaskFileError)]
    return instead if limit is None or limit == NO_VALUE else limit


def _with_none(limit: Any) -> Any:
    values = np.asarray(limit, float)
    if values.ndim:
        return [_with_none(each) for each in values]
    return float(values) if np.isfinite(values) else None


def _build(kind: type, values: Any, where: str) -> Any:
    """An object of a class from a table of its fields."""
    fields = file_fields(kind)
    needed = [name for name, (_, required) in fields.items() if required]
    given = table(where, values, fields, needed, TaskFileError)
    return _said(where, lambda: kind(**given))


def _said(where: str, make: Callable[..., Any], *arguments: Any) -> Any:
    """What `make` gives; its error says the place in the file, once."""
    try:
        return make(*arguments)
    except TaskFileError:
        raise
    except (InputError, TypeError) as error:
        text = str(error)
        raise TaskFileError(text if text.startswith(where) else place(where, text)) from error
