"""What decides the table of a sweep, as JSON values: equal ones mean equal tables, in every process."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.digest import OpaqueError, content_digest

from ...inputs.checks import shown
from ...inputs.errors import ArgumentError
from ...policies.saved import content_of
from ...simulator import Simulator
from ...stepping.arguments import checked_kernel
from ...stepping.host import acts_on_host
from ...tasks.task import Task
from ..worlds import Worlds

LONGEST = 64  # numbers of an array that are written out
OF_PLANS = ("name", "cost", "horizon", "options")  # fields of a task that decide no run of given cases
COST = "cost"  # kind of the signals that decide by it nevertheless


def task_identity(task: Task) -> dict[str, Any]:
    """What of a task decides its runs: all but its name and what is of plans: its cost if it is measured.

    Raises:
        ArgumentError: a function in it whose code cannot be told.
    """
    names = [field.name for field in dataclasses.fields(task) if field.name not in OF_PLANS]
    found = {name: told(getattr(task, name), f"Task.{name}") for name in names}
    signals = [signal for _, measure in task.judged for signal in measure.signals()]
    return found | (_told_cost(task) if any(signal.kind == COST for signal in signals) else {})


def _told_cost(task: Task) -> dict[str, Any]:
    functions = task.cost.functions(wp.float64, 2 * task.scene.nv, task.scene.nu)
    code = [each for each in functions if each is not None]
    weights = told(task.cost.weights, "Task.cost.weights")
    return {"cost": {"functions": told(code, "Task.cost"), "weights": weights}}


def policy_identity(policy: Any, sim: Simulator, text: str | None = None) -> dict[str, Any]:
    """What a policy does: its class and numbers, or where it is no data its code and its numbers in kernels.

    Args:
        text: `file.py:name`, where it was given so; of a policy that acts on the host that file tells.

    Raises:
        ArgumentError: no policy, or nothing tells what it does.
    """
    try:
        values, arrays = content_of(policy)
    except ArgumentError as error:
        if not acts_on_host(policy):
            kernel, struct = checked_kernel(policy, sim)
            return {"kernel": kernel.key, "numbers": _digest(dict(_numbers(struct)))}
        if text is None:
            raise ArgumentError(f"{error}; nothing else tells later whether it is the same") from None
        file, _, name = text.rpartition(":")
        return {"file": hashlib.sha256(Path(file).read_bytes()).hexdigest(), "name": name}
    name = values["class"].partition(":")[2]
    return {"class": name, "numbers": _digest({"values": json.dumps(values, sort_keys=True)} | arrays)}


def told(value: Any, what: str) -> Any:
    """A value as JSON values that tell all of it; functions by their code.

    Raises:
        ArgumentError: something that cannot be told; `what` names it.
    """
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | float | np.integer | np.floating):
        return _number(value)
    if isinstance(value, Mapping):
        return {str(key): told(each, f"{what}[{key!r}]") for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [told(each, f"{what}[{i}]") for i, each in enumerate(value)]
    if isinstance(value, np.ndarray):
        if value.size > LONGEST:
            return {"shape": list(value.shape), "sha256": _digest({"": value})}
        return told(value.tolist(), what)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _told_fields(value, what)
    return {"function": _told_function(value, what)}


def _number(value: Any) -> int | float | str:
    """A number as a person would write it, however it came: 20 for 20.0."""
    if not np.isfinite(value):
        return str(float(value))
    whole = int(value)
    return whole if whole == value else float(value)


def _told_fields(value: Any, what: str) -> dict[str, Any]:
    """A dataclass by what was given to make it, without what is as it is by itself."""
    out: dict[str, Any] = {"class": type(value).__name__}
    for field in dataclasses.fields(value):
        if not field.init:
            continue
        found = told(getattr(value, field.name), f"{what}.{field.name}")
        given = field.default is dataclasses.MISSING
        if given or found != told(field.default, what):
            out[field.name] = found
    return out


def worlds_identity(worlds: Worlds) -> str:
    """Of given worlds, their numbers."""
    own = {each.name: getattr(worlds.numpy(), each.name) for each in dataclasses.fields(worlds)}
    return _digest({name: value for name, value in own.items() if value is not None})


def _told_function(value: Any, what: str) -> dict[str, str]:
    function: Any = value.func if isinstance(value, wp.Function) else value
    if not hasattr(function, "__code__"):
        raise ArgumentError(f"{what} is {shown(value)}, which a specification of a sweep cannot tell")
    try:
        return {"name": function.__name__, "code": content_digest(function)}
    except OpaqueError as error:
        raise ArgumentError(f"{what}: the code of {function.__name__} cannot be told: {error}") from error


def _numbers(struct: Any, prefix: str = "") -> list[tuple[str, Any]]:
    """The numbers of a policy's struct by name, those of structs in it too."""
    out: list[tuple[str, Any]] = []
    for name in struct._cls.vars:
        value = getattr(struct, name)
        if hasattr(value, "_cls"):
            out += _numbers(value, f"{prefix}{name}.")
        else:
            out.append((prefix + name, value.numpy() if isinstance(value, wp.array) else np.asarray(value)))
    return out


def _digest(values: Mapping[str, Any]) -> str:
    """SHA-256 of texts and arrays by name: types, shapes and bytes."""
    digest = hashlib.sha256()
    for name in sorted(values):
        value = values[name]
        if isinstance(value, str):
            data, form = value.encode(), "text"
        else:
            array = np.ascontiguousarray(value)
            data, form = array.tobytes(), f"{array.dtype.str} {np.shape(value)}"
        digest.update(f"{name}\0{form}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()
